"""The keys of ``conf/*.yaml``: structured dataclasses, cross-field checks, one reader.

A YAML file may name another one under ``base:``; its own keys win over that file's. Overrides
from the command line (``key=value``, dotted) win over both. Every key is typed; an unknown key
or a value of the wrong type is refused before anything runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import omegaconf

from wt.errors import ConfigError
from wt.schema import check_numbers, parse, read, to_yaml, varied

__all__ = ["parse", "to_yaml"]


Adversarial = Literal["bce", "lsgan"]
"""Adversarial loss: cross-entropy as in the paper, or least squares (Mao et al. 2017)."""

MeanKind = Literal["none", "average", "mode"]
"""The carrier of the difference of the domains that needs no translation.

``none``: nothing, as in the paper; ``average``: least squares; ``mode``: the most frequent answer,
for hidden variables that are often absent.
"""

SimulatorUseName = Literal["base", "read", "mean", "blend", "encoded", "ignored"]
"""The mean field's use of the simulator's own answer; a class each in ``wt.nets.simulator_use``.

``base``: it is added to; ``read``: it is added to and is also an input of the correction;
``mean``: the same, but with S's own average answer to (o, a) instead of its answer with nothing
hidden, and with only such a share of what S then says of the hidden variable as helps: where
hidden variables are never absent.
``blend``: as ``mean``, and beside it a correction that reads S's answer, as with ``read``, gives an
answer of its own: pairs, where they select, tell the share of each in every channel, which is a
half without.
``encoded``: as ``read``, and while it learns the answer is what S would have answered to R, made
of R's recording: the simulator is the encoder (``wt.train.answers``).
``ignored``: R's change is regressed on (o, a) alone.
"""

ModelSelection = Literal["unpaired", "pairs"]
"""The held-out data that choose between models; see ``wt.train.selection``."""

Device = Literal["auto", "cpu", "cuda"]
"""The device that networks are trained on; ``auto`` is CUDA where there is any."""

Precision = Literal["32-true", "bf16-mixed"]
"""Lightning's name for the numbers that networks compute with."""

Strategy = Literal["auto", "ddp", "ray"]
"""What starts the processes that train one model, replicas that average their gradients.

``ddp``: the one that leads, on this machine; ``ray``: a Ray cluster, on its other machines;
``auto``: the latter where there is more than one machine. See ``wt.train.replicas``.
"""

Jobs = Literal["here", "ray"]
"""Where shards of collections are made; see ``wt.worlds.spread``."""

Alignment = Literal["state", "stance", "action"]
"""The way in which a simulator follows the translation; see ``wt.evaluate.alignment``.

``state``: what a robot observes of itself is overwritten; ``stance``: the same, and the trunk's
height and velocity move so that standing feet stay where they are; ``action``: the action is
corrected.
"""


@dataclass
class DataConfig:
    """Amount of data, and the folder that keeps it (``data:``)."""

    dir: str = "data"
    transitions: int = 300_000
    validation_pairs: int = 10_000
    test_pairs: int = 25_000
    seed: int = 0
    real_transitions: int | None = None  # of R, where it has fewer
    held_out: float = 0.1
    in_memory: int = 500_000
    lessons: int | None = None  # of simulators around S; None for as many as of S


@dataclass
class CollectConfig:
    """Where transitions are collected (``collect:``)."""

    jobs: Jobs = "here"


@dataclass
class Mean:
    """The regressors in front of the translation (``mean:``); unused when kind is ``none``."""

    kind: MeanKind = "none"
    simulator: SimulatorUseName = "base"
    members: int = 1
    input_noise: float = 0.0
    mode_width: float = 0.05
    width: int = 256
    depth: int = 3
    steps: int = 8000
    batch: int = 512
    learning_rate: float = 4e-3


@dataclass
class Nets:
    """Sizes of encoder, decoders, classifier, generators, discriminators (``nets:``)."""

    latent: int = 16
    width: int = 128
    depth: int = 3
    film: bool = True
    translator_width: int = 128
    translator_depth: int = 2


@dataclass
class Vae:
    """Weights of L_VAE (``vae:``), beside a reconstruction error that is summed over channels."""

    beta: float = 0.12
    blind_weight: float = 1.2
    blind_temperature: float = 0.5
    classifier_weight: float = 1.2


@dataclass
class TranslationConfig:
    """The unpaired translation (``translation:``)."""

    conditioned: bool = False
    adversarial: Adversarial = "bce"
    cycle: float = 3.0
    identity: float = 1.0
    transport: bool = False
    anchored: bool = False
    average: float = 0.0
    reach: float = 0.0
    alignment: Alignment = "state"


@dataclass
class Train:
    """Algorithm 1's loop (``train:``)."""

    steps: int = 8000
    batch: int = 512
    learning_rate: float = 1e-3
    gan_learning_rate: float = 3e-4
    validate_every: int = 500
    log_every: int = 50
    segment: int = 1
    segment_weight: float = 1.0
    precision: Precision = "32-true"
    compile: bool = False
    cuda_graphs: bool = True
    devices: int = 1
    nodes: int = 1
    strategy: Strategy = "auto"
    rerun: bool = False


@dataclass
class Online:
    """Adaptation to a stream of transitions while a model is in use (``online:``)."""

    iterations: int = 0
    memory: int = 10_000
    learning_rate: float = 2e-4


@dataclass
class Method:
    """One World Translation model: the paper's or ours (``paper:``, ``plus:``)."""

    mean: Mean = field(default_factory=Mean)
    nets: Nets = field(default_factory=Nets)
    vae: Vae = field(default_factory=Vae)
    translation: TranslationConfig = field(default_factory=TranslationConfig)
    train: Train = field(default_factory=Train)
    online: Online = field(default_factory=Online)


@dataclass
class Baselines:
    """The rivals, all of the same size and budget (``baselines:``)."""

    names: list[str] = field(
        default_factory=lambda: [
            "RawSim", "DirectPred", "ResDyn", "ResDynSim", "RSSM", "MeanShiftOT", "DeltaAction",
            "FlowTranslation", "SimulatorEncoder", "PairedCeiling",
        ]
    )  # fmt: skip
    members: int = 1
    width: int = 256
    depth: int = 3
    steps: int = 8000
    batch: int = 512
    learning_rate: float = 2e-3
    history: int = 16


@dataclass
class TrackingConfig:
    """MLflow (``tracking:``); the environment's MLFLOW_TRACKING_URI wins over ``uri``."""

    experiment: str = "world-translation"
    uri: str | None = None


@dataclass
class Diagnose:
    """Diagnosis of R, and a second run on the simulator that it patched (``diagnose:``)."""

    recordings: int = 3
    holdout: int = 1
    rollouts: int = 256


@dataclass
class FitConfig:
    """Everything ``wt fit`` reads."""

    task: str = omegaconf.MISSING
    registry_name: str = omegaconf.MISSING
    seeds: list[int] = field(default_factory=lambda: [0])
    workers: int = 0
    device: Device = "auto"
    model_selection: ModelSelection = "unpaired"
    world: dict[str, Any] = omegaconf.MISSING
    data: DataConfig = field(default_factory=DataConfig)
    collect: CollectConfig = field(default_factory=CollectConfig)
    paper: Method = field(default_factory=Method)
    plus: Method = field(default_factory=Method)
    baselines: Baselines = field(default_factory=Baselines)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    diagnose: Diagnose | None = None


def load(path: str | Path, overrides: Sequence[str] = ()) -> FitConfig:
    """Read a configuration, apply overrides, check it.

    Args:
        path: a YAML file.
        overrides: ``key=value`` words; lists and dotted keys are allowed.

    Raises:
        ConfigError: file missing, not YAML, an unknown key, a wrong type, impossible values.
    """
    config = parse(FitConfig, read(Path(path), overrides), "")
    _check(config)
    return config


def vary(method: Method, changes: Sequence[str]) -> Method:
    """A method with some of its settings changed, for ablations.

    Args:
        method: what it differs from.
        changes: ``key=value`` words without the section's name, e.g. ``"translation.cycle=0"``.

    Raises:
        ConfigError: an unknown key, a wrong type, impossible values.
    """
    variant = parse(Method, varied(method, changes), "")
    check_numbers(variant, _ABOVE_ZERO)
    _check_method("variant", variant)
    return variant


_ABOVE_ZERO = {
    "transitions", "real_transitions", "held_out", "validation_pairs", "test_pairs", "steps",
    "batch", "validate_every", "log_every", "learning_rate", "gan_learning_rate", "width", "depth",
    "latent", "translator_width", "translator_depth", "members", "mode_width", "blind_temperature",
    "segment", "memory", "in_memory", "devices", "nodes", "recordings", "holdout", "rollouts",
}  # fmt: skip
"""Numbers of any section that zero makes meaningless; no other may be negative either."""


def _check(config: FitConfig) -> None:
    check_numbers(config, _ABOVE_ZERO)
    seeds = config.seeds
    if not seeds or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise ConfigError(f"seeds {seeds} must be a list of different integers, zero or more")
    for name, method in (("paper", config.paper), ("plus", config.plus)):
        _check_method(name, method)
    if config.data.held_out > 0.5:
        raise ConfigError(
            f"data.held_out is {config.data.held_out}; it must be at most 0.5, since the rest is "
            "what is trained on"
        )
    if config.diagnose and config.diagnose.holdout >= config.diagnose.recordings:
        raise ConfigError(
            f"diagnose.holdout {config.diagnose.holdout} leaves none of diagnose.recordings "
            f"{config.diagnose.recordings} to fit; hold out fewer"
        )


def _check_method(name: str, method: Method) -> None:
    train = method.train
    if train.steps % train.validate_every:
        raise ConfigError(
            f"{name}.train.steps {train.steps} is not a multiple of "
            f"{name}.train.validate_every {train.validate_every}; change either"
        )
    processes = train.devices * train.nodes
    if train.batch % processes:
        raise ConfigError(
            f"{name}.train.batch {train.batch} is not a multiple of {processes}, the processes "
            f"({name}.train.devices × {name}.train.nodes) that share it; change either"
        )
    if (train.nodes > 1, train.strategy) in ((True, "ddp"), (False, "ray")):
        raise ConfigError(
            f"{name}.train.strategy is {train.strategy} with {name}.train.nodes {train.nodes}: ddp "
            "is for one machine, ray for more; auto for either"
        )
    if method.translation.transport and method.mean.kind == "none":
        raise ConfigError(
            f"{name}.translation.transport needs {name}.mean.kind average or mode, "
            "since it moves what the mean leaves"
        )
    if method.translation.average >= 1:
        raise ConfigError(
            f"{name}.translation.average is {method.translation.average}; it must be below 1, "
            "or the average never moves"
        )
