"""One training of one variant: environment, start, PPO, export, figures, recording."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

from registry.card import MODEL_FILE, sha256
from wt.errors import ModelError
from wt.finetune.config import Variant
from wt.finetune.randomized import Randomized
from wt.finetune.setting import Setting
from wt.finetune.translated import translated
from wt.locomotion import export
from wt.locomotion.evaluate import evaluate
from wt.locomotion.parts import Make
from wt.locomotion.start import take_over
from wt.locomotion.train import CHECKPOINT, Progress, train
from wt.locomotion.watch import record
from wt.worlds.policy import CARD, Policy, PolicyCard

SCALE_ROWS = 5000
"""Transitions of S by which differences of states are measured where actions are corrected."""


def environment(setting: Setting, variant: Variant, model: Path | None) -> Make:
    """Factory of a variant's environment.

    Args:
        setting: the task.
        variant: any but ``none``.
        model: folder of the model of a variant that translates.
    """
    if variant == "randomization":
        ranges, timestep = setting.config.randomization, setting.options.timestep
        return functools.partial(Randomized, ranges=ranges, timestep=timestep)
    if model is None:
        raise ModelError(f"variant {variant} has nothing to translate with")
    world = setting.world(variant)
    alignment = "stance" if variant == "stance" else setting.config.alignment
    scale = None
    if alignment == "action":
        scale = world.collect("sim", SCALE_ROWS, seed=0).s_next.std(axis=0)
    simulator = setting.simulator(variant)
    simulator.compile()
    return functools.partial(
        translated,
        folder=model,
        spec=world.spec,
        alignment=alignment,
        scale=scale,
        mjcf=simulator.to_xml(),
        share=setting.config.share,
    )


def adapt(
    setting: Setting,
    variant: Variant,
    seed: int,
    home: Path,
    model: Path | None,
    origin: export.Origin,
    progress: Progress,
    seconds: float | None = None,
) -> Policy | None:
    """Fine-tune the base policy, or continue, or find it finished; None if no update was made.

    Args:
        setting: task and base policy.
        variant: how.
        seed: of the training.
        home: its folder.
        model: as in :func:`environment`.
        origin: what makes it, for the card, but for the model.
        progress: told about every iteration.
        seconds: wall clock after which no further update begins [s].
    """
    training, begun = setting.training(variant, seed), (home / CHECKPOINT).exists()
    if not begun and seconds == 0.0:
        return None
    if not _finished(home, training.ppo.iterations):
        trained = train(
            training,
            home,
            resume=begun,
            seconds=seconds,
            progress=progress,
            make=environment(setting, variant, model),
            start_from=functools.partial(
                take_over,
                policy=setting.base,
                path=setting.options.policy,
                warm_up=training.ppo.warm_up,
            ),
        )
        if not trained.iterations:
            return None
        if model is not None:
            sources = {**origin.sources, "model": sha256(model / MODEL_FILE)}
            origin = replace(origin, sources=sources)
        export.write(trained, training, home, origin)
        policy = Policy.load(home, setting.robot, setting.options.sim)
        record(setting.shown(), policy.act, home / "rollout.rrd")
        figures = evaluate(training, policy.act, threads=training.threads * training.processes)
        export.judged(home, figures)
    return Policy.load(home, setting.robot, setting.options.sim)


def _finished(home: Path, updates: int) -> bool:
    """Whether a folder has a policy of so many updates that has been judged."""
    if not (home / CARD).exists():
        return False
    card = PolicyCard.read(home / CARD)
    return bool(card.evaluation) and card.training["iterations"] >= updates
