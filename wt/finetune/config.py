"""The keys of ``conf/finetune_*.yaml``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import omegaconf

from wt.config import Alignment, TrackingConfig
from wt.errors import ConfigError, suggest
from wt.schema import check_numbers, parse, read

Variant = Literal["none", "randomization", "translation", "stance", "diagnosed"]
"""The way in which a policy is adapted.

``none``: the base policy as it is; ``randomization``: in S with random physics and noisy
observations; ``translation``: in S, whose every transition is translated; ``stance``: likewise,
and feet that stand stay where they are, whatever ``alignment`` says; ``diagnosed``: as
``translation``, in an S that ``wt diagnose`` has repaired first.
"""

VARIANTS: tuple[Variant, ...] = get_args(Variant)


@dataclass
class Randomization:
    """Ranges from which the variant ``randomization`` draws each robot (``randomization:``)."""

    base_mass: list[float] = field(default_factory=lambda: [-1.0, 3.0])  # added, from … to [kg]
    friction: list[float] = field(default_factory=lambda: [0.3, 1.2])  # of the floor
    gains: list[float] = field(default_factory=lambda: [0.8, 1.25])  # factors on both gains
    gyro_noise: float = 0.2  # [rad/s], half the width of a uniform distribution, as all below
    gravity_noise: float = 0.05
    position_noise: float = 0.01  # [rad]
    velocity_noise: float = 1.5  # [rad/s]


@dataclass
class Diagnosed:
    """Inputs of the variant ``diagnosed`` (``diagnosed:``)."""

    mjcf: str | None = None
    model: str | None = None


@dataclass
class EvaluationConfig:
    """Evaluation of policies in R (``evaluation:``)."""

    episodes: int = 20
    seed: int = 1000
    commands: list[list[float]] = omegaconf.MISSING  # rows of [s, m/s, m/s, rad/s]


@dataclass
class Finetune:
    """Everything ``wt-finetune`` reads."""

    task: str = omegaconf.MISSING
    model: str = omegaconf.MISSING
    policy: str | None = None
    variants: list[Variant] = field(default_factory=lambda: list(VARIANTS[:3]))
    seeds: list[int] = field(default_factory=lambda: [0, 1, 2])
    workers: int = 0  # trainings side by side; 0 for one per core
    alignment: Alignment = "state"
    share: float = 1.0  # of the robots in translated dynamics; the others stay in S
    training: dict[str, Any] = field(default_factory=dict)
    randomization: Randomization = field(default_factory=Randomization)
    diagnosed: Diagnosed = field(default_factory=Diagnosed)
    evaluation: EvaluationConfig = omegaconf.MISSING
    tracking: TrackingConfig = field(default_factory=TrackingConfig)


def load(path: str | Path, overrides: Sequence[str] = ()) -> Finetune:
    """Read a configuration, apply overrides, check it.

    Args:
        path: a YAML file.
        overrides: ``key=value`` words.

    Raises:
        ConfigError: file missing, not YAML, an unknown key, a wrong type, impossible values.
    """
    tree = read(Path(path), overrides)
    for name in tree.get("variants") or ():
        if name not in VARIANTS:
            raise ConfigError(f"variants holds {name!r}; {suggest(str(name), VARIANTS)}")
    config = parse(Finetune, tree, "")
    check_numbers(config, {"episodes", "share"})
    if config.share > 1.0:
        raise ConfigError(f"share is {config.share}; it must be at most 1, all of the robots")
    for key, values in (("variants", config.variants), ("seeds", config.seeds)):
        if not values or len(set(values)) != len(values):
            raise ConfigError(f"{key} {values} must be a list of different values, at least one")
    for key in ("physics", "scene", "seed", "name", "robot"):
        if key in config.training:
            raise ConfigError(
                f"training.{key} is not for the trainer: task, policy or seeds say it"
            )
    if "diagnosed" in config.variants and not (config.diagnosed.mjcf and config.diagnosed.model):
        raise ConfigError(
            "variants holds diagnosed, which needs diagnosed.mjcf, the model.xml of wt diagnose, "
            "and diagnosed.model, a model that was trained with that file as S"
        )
    _check_ranges(config.randomization)
    _check_commands(config.evaluation.commands)
    return config


def _check_ranges(section: Randomization) -> None:
    lowest = {"base_mass": -math.inf, "friction": 0.0, "gains": 0.0}
    for key, least in lowest.items():
        low_high = getattr(section, key)
        if len(low_high) != 2 or not least < low_high[0] <= low_high[1] < math.inf:
            above = "" if math.isinf(least) else " above zero"
            raise ConfigError(f"randomization.{key} is {low_high}; it must be [low, high]{above}")


def _check_commands(rows: list[list[float]]) -> None:
    good = all(len(row) == 4 and all(map(math.isfinite, row)) and row[0] > 0 for row in rows)
    if not rows or not good:
        raise ConfigError(
            "evaluation.commands must be rows of [seconds above zero, forward m/s, sideways m/s, "
            f"turn rad/s]; it is {rows}"
        )
