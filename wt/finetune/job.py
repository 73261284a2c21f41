"""What ``wt-finetune`` does: train every variant with every seed, judge all of them in R.

The folder of a run holds ``config.yaml``, ``results.json`` and ``results.md``, the models that were
pulled, and a folder for each variant and seed with what a training of wt-train-policy leaves:
policy, card, checkpoint, ``training.csv``, and ``rollout.rrd``, a recording of the policy in R.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from registry.card import MODEL_FILE, Card
from registry.parity import verify
from registry.pull import pull
from wt.errors import ConfigError
from wt.finetune.config import Finetune, Variant, load
from wt.finetune.evaluate import Downstream, evaluate
from wt.finetune.results import plain, save
from wt.finetune.setting import Setting
from wt.finetune.training import adapt
from wt.registered import Registered
from wt.schema import flat, to_yaml
from wt.show.files import write_whole
from wt.track import Run
from wt.track import run as tracking

CONFIG = "config.yaml"
RUN_ID = "mlflow_run_id"

Show = Callable[[str, float], None]
"""Told what is being done and which share of it is behind."""


def open_folder(config: Finetune, folder: Path, resume: bool) -> Finetune:
    """Claim a run's folder and keep the configuration in it.

    Args:
        config: the resolved configuration.
        folder: the run's folder.
        resume: continue the run in it.

    Raises:
        ConfigError: it is a file, holds another run, or none to resume.
    """
    kept = folder / CONFIG
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"--out: {folder} is a file; name a folder, new or empty")
    if resume and not kept.exists():
        raise ConfigError(f"--resume: {folder} holds no run ({CONFIG} is missing)")
    if resume and to_yaml(load(kept)) != to_yaml(config):
        raise ConfigError(
            f"--resume: the configuration differs from {kept}, with which the run began; "
            f"resume with --config {kept} and no overrides, or choose a new --out"
        )
    if not resume and kept.exists():
        raise ConfigError(f"{folder} already holds a run; add --resume, or choose a new --out")
    return config


def run(config: Finetune, folder: Path, *, made_by: str, show: Show) -> tuple[dict[str, Any], Run]:
    """Train what is not trained yet, judge everything in R, and leave the table.

    Args:
        config: what is done, checked.
        folder: of the run; trainings found in it are continued, finished ones kept.
        made_by: the command line, for the cards.
        show: told of progress.

    Returns:
        The results, as in ``results.json``, and the run in MLflow.

    Raises:
        ConfigError: the task, or what is said of the training, cannot be used.
        ModelError: policy or model do not fit the task.
        RegistryError: a model is not in the registry, or not as it was registered.
    """
    setting = Setting.of(config)
    iterations = setting.training("none", config.seeds[0]).ppo.iterations
    models = _models(setting, folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / CONFIG, to_yaml(config))
    kept = folder / RUN_ID
    run_id = kept.read_text().strip() if kept.exists() else None
    where = config.tracking
    with tracking(where.experiment, folder.name, uri=where.uri, run_id=run_id) as tracked:
        write_whole(kept, tracked.id)
        tracked.params(flat(config))
        tracked.text(to_yaml(config), CONFIG)
        found = _figures(setting, folder, made_by, show, tracked)
        about = {
            "task": setting.world().spec.task,
            "policy": setting.base.card.name,
            "models": {v: {"name": c.name, "sha256": c.sha256} for v, c in models.items()},
            "alignment": config.alignment,
            "iterations": iterations,
            "episodes": config.evaluation.episodes,
        }
        results = plain(found, about)
        save(results, folder)
        for name in ("results.json", "results.md"):
            tracked.artifact(folder / name)
    return results, tracked


def _models(setting: Setting, folder: Path) -> dict[Variant, Card]:
    """Pull what variants translate with, unless a run that began has it, and see that it fits."""
    config, cards = setting.config, {}
    references = {"translation": config.model, "diagnosed": config.diagnosed.model}
    for variant in config.variants:
        reference, home = references.get(variant), _model_home(folder, variant)
        if reference is None:
            continue
        begun = (folder / CONFIG).exists() and home.exists()
        cards[variant] = (
            verify(home) if begun else pull(reference, home, uri=config.tracking.uri)[1]
        )
        Registered(home / MODEL_FILE, cards[variant], setting.world(variant).spec)
    return cards


def _model_home(folder: Path, variant: Variant) -> Path:
    return folder / f"model-{variant}"


def _figures(
    setting: Setting, folder: Path, made_by: str, show: Show, tracked: Run
) -> dict[str, dict[int, Downstream]]:
    """Figures by variant and seed; the base policy needs no training and has one."""
    config = setting.config
    judged = config.evaluation
    jobs = [
        (variant, seed)
        for variant in config.variants
        for seed in (config.seeds if variant != "none" else config.seeds[:1])
    ]
    found: dict[str, dict[int, Downstream]] = {}
    for k, (variant, seed) in enumerate(jobs):
        name = f"{variant}-seed{seed}"

        def progress(
            done: int, total: int, row: Mapping[str, float], k: int = k, name: str = name
        ) -> None:
            show(
                f"{name} {done}/{total} reward {row['reward']:.2f}", (k + done / total) / len(jobs)
            )
            values = {f"{name}/{key}": value for key, value in row.items()}
            tracked.metrics(values, done)

        policy = setting.base
        if variant != "none":
            model = _model_home(folder, variant)
            policy = adapt(
                setting, variant, seed, folder / name, model if model.exists() else None,
                made_by, progress,
            )  # fmt: skip
            tracked.artifact(folder / name / "rollout.rrd", name)
        show(f"judging {name}", (k + 1) / len(jobs))
        herd = setting.reality(judged.episodes)
        figures = evaluate(herd, policy, judged.commands, judged.seed)
        found.setdefault(variant, {})[seed] = figures
        tracked.metrics({f"{variant}/{key}": value for key, value in vars(figures).items()}, seed)
    return found
