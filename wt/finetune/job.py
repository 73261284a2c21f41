"""The work of ``wt-finetune``: train every variant with every seed, evaluate all of them in R.

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
from wt.finetune.config import Finetune, Variant
from wt.finetune.evaluate import Downstream, evaluate
from wt.finetune.results import plain, save
from wt.finetune.setting import Setting
from wt.finetune.training import adapt
from wt.locomotion.export import Origin
from wt.registered import Registered
from wt.run.folder import CONFIG, keep, tracked
from wt.run.track import NOTE, Run, machine

Show = Callable[[str, float], None]
"""Told what is being done and which share of it is behind."""


def run(config: Finetune, folder: Path, *, made_by: str, show: Show) -> tuple[dict[str, Any], Run]:
    """Train what is not trained yet, evaluate every policy in R, and leave the table.

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
    keep(config, folder)
    task = setting.world().spec.task
    with tracked(config, folder) as current, machine(current):
        current.tags({"task": task, NOTE: _note(config, task)})
        by_variant = _figures(setting, folder, made_by, show, current)
        about = {
            "task": task,
            "policy": setting.base.card.name,
            "models": {v: {"name": c.name, "sha256": c.sha256} for v, c in models.items()},
            "alignment": config.alignment,
            "iterations": iterations,
            "episodes": config.evaluation.episodes,
        }
        results = plain(by_variant, about)
        save(results, folder)
        for name in ("results.json", "results.md"):
            current.artifact(folder / name)
    return results, current


def _note(config: Finetune, task: str) -> str:
    """A description of the run, for people."""
    variants = ", ".join(f"`{v}`" for v in config.variants)
    return (
        f"The walking policy of the task `{task}`, trained on {variants}, seeds "
        f"{', '.join(map(str, config.seeds))}, and judged in the real domain."
    )


def _models(setting: Setting, folder: Path) -> dict[Variant, Card]:
    """Pull what variants translate with, unless a run that began has it, and see that it fits."""
    config, cards = setting.config, {}
    model, diagnosed = config.model, config.diagnosed.model
    references = {"translation": model, "stance": model, "diagnosed": diagnosed}
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
    setting: Setting, folder: Path, made_by: str, show: Show, current: Run
) -> dict[str, dict[int, Downstream]]:
    """Figures by variant and seed; the base policy needs no training and has one."""
    config = setting.config
    evaluation = config.evaluation
    jobs = [
        (variant, seed)
        for variant in config.variants
        for seed in (config.seeds if variant != "none" else config.seeds[:1])
    ]
    run_path = f"{config.tracking.experiment}/{current.id}"
    sources = {"start_policy": setting.base.card.sha256}
    origin = Origin(made_by, setting.world().spec.task, run_path, sources)
    by_variant: dict[str, dict[int, Downstream]] = {}
    for k, (variant, seed) in enumerate(jobs):
        name = f"{variant}-seed{seed}"

        def progress(
            done: int, total: int, row: Mapping[str, float], k: int = k, name: str = name
        ) -> None:
            show(
                f"{name} {done}/{total} reward {row['reward']:.2f}", (k + done / total) / len(jobs)
            )
            values = {f"{name}/{key}": value for key, value in row.items()}
            current.metrics(values, done)

        policy = setting.base
        if variant != "none":
            model = _model_home(folder, variant)
            policy = adapt(
                setting, variant, seed, folder / name, model if model.exists() else None,
                origin, progress,
            )  # fmt: skip
            current.artifact(folder / name / "rollout.rrd", name)
        show(f"evaluating {name}", (k + 1) / len(jobs))
        herd = setting.reality(evaluation.episodes)
        figures = evaluate(herd, policy, evaluation.commands, evaluation.seed)
        by_variant.setdefault(variant, {})[seed] = figures
        current.metrics({f"{variant}/{key}": value for key, value in vars(figures).items()}, seed)
    return by_variant
