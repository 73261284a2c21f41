"""The nouns that the steps of a run share, and its results kept under ``work/`` for resuming."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from wt import cluster
from wt.baselines.base import Baseline, find
from wt.config import FitConfig, Method, to_yaml
from wt.data.stored import Stored, Streams
from wt.data.transitions import digest
from wt.errors import ConfigError
from wt.evaluate.single_step import ErrorScales
from wt.nets.simulator_use import use_of
from wt.nets.world_model import WorldModel
from wt.show.files import write_whole
from wt.train import device
from wt.train.loop import refuse_absent
from wt.train.selection import Paired, Selection, Unpaired, hold_out, hold_out_stored
from wt.types import Transitions
from wt.worlds.base import World, make
from wt.worlds.closed_loop import ClosedLoop
from wt.worlds.collect import Collected, collect
from wt.worlds.recorded import Recorded
from wt.worlds.spread import ASKED_BY, spread

WEIGHTS = "model.pt"


def check(config: FitConfig) -> None:
    """Refuse what could not be run, before anything is written.

    Raises:
        ConfigError: a world, one of its options, or a baseline is not known; a world is to be
            diagnosed that cannot be recorded; this machine has no such device, or too few.
        UserError: other machines are to train along, and there are none.
        WorkError: Ray is asked for and not installed.
    """
    device.check(config.device)
    for method in (config.paper, config.plus):
        refuse_absent(method.train, device.device_of(config.device))
    if config.collect.jobs == "ray":
        cluster.check(ASKED_BY)
    world = make(config.world)
    if config.diagnose and not (isinstance(world, Recorded) and isinstance(world, ClosedLoop)):
        raise ConfigError(
            f"diagnose: the world '{config.world['name']}' cannot be recorded; worlds of walking "
            "robots can"
        )
    for name in config.baselines.names:
        find(name)


@runtime_checkable
class Listener(Protocol):
    """A follower of a run's progress."""

    def progress(self, what: str, done: int, total: int) -> None:
        """Something is ``done`` of ``total`` through."""

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        """Metrics of a training step of ``what``, as named to :meth:`progress`."""

    def warn(self, line: str) -> None:
        """A training collapsed or something else needs to be said."""


class Silent:
    """A listener that says nothing to anybody."""

    def progress(self, what: str, done: int, total: int) -> None:
        """Ignore it."""

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        """Ignore it."""

    def warn(self, line: str) -> None:
        """Ignore it."""


class Split(NamedTuple):
    """The unpaired transitions of a study that are trained on, and what selects models.

    Attributes:
        sim: transitions of S; a sample where they are streamed.
        real: transitions of R, likewise.
        selection: held-out data.
        streams: those that are streamed.
    """

    sim: Transitions
    real: Transitions
    selection: Selection
    streams: Streams


@dataclass(frozen=True)
class Study:
    """Everything that the steps of a run share.

    Attributes:
        config: the resolved configuration.
        world: the task.
        data: the collections.
        scales: units of errors.
        folder: the run's folder.
        listener: told of progress, metrics and warnings.
    """

    config: FitConfig
    world: World
    data: Collected
    scales: ErrorScales
    folder: Path
    listener: Listener

    @classmethod
    def open(cls, config: FitConfig, folder: Path, listener: Listener | None = None) -> Study:
        """Build the world and collect, or reuse, its transitions.

        Args:
            config: the resolved configuration.
            folder: the run's folder.
            listener: told of progress; None for nobody.
        """
        world, listener = make(config.world), listener or Silent()
        pairs = config.model_selection == "pairs"
        with spread(config.collect.jobs, config.world, world) as maker:
            asked = {"validation": pairs, "lessons": _estimates(config)}
            data = collect(world, config.data, listener.progress, **asked, maker=maker)
        return cls(config, world, data, ErrorScales.of(data.real, world.spec), folder, listener)

    @cached_property
    def split(self) -> Split:
        """What is trained on, and what selects; the test pairs are neither."""
        data, streams = self.data, self.data.streams
        if data.validation is not None:
            selection = Paired(data.validation, self.scales.state)
            return Split(data.sim, data.real, selection, streams)
        sim, held_sim, of_sim = self._held_out(data.sim, streams.sim)
        real, held_real, of_real = self._held_out(data.real, streams.real)
        streams = Streams(of_sim, of_real, streams.in_memory)
        return Split(sim, real, Unpaired(held_sim, held_real), streams)

    def _held_out(
        self, data: Transitions, stored: Stored | None
    ) -> tuple[Transitions, Transitions, Stored | None]:
        """What is trained on, what is not, and what is streamed of the former."""
        share = self.config.data.held_out
        if stored is None:
            return *hold_out(data, share), None
        stored, held = hold_out_stored(stored, share)
        return data, held, stored  # a sample has nothing of it

    @property
    def config_hash(self) -> str:
        """Hash of the resolved configuration."""
        return digest(to_yaml(self.config))

    def home(self, seed: int, method: str) -> Path:
        """Folder of a method's checkpoints and weights."""
        return self.folder / "work" / f"seed{seed}" / method

    def finished(self, seed: int, method: str) -> bool:
        """Tell whether a method is trained and has predicted the test pairs."""
        return self._predicted(seed, method).exists()

    def prediction(self, seed: int, method: str) -> Float[np.ndarray, "pair state"]:
        """Next states that a finished method predicts for the test pairs."""
        return np.load(self._predicted(seed, method))

    def keep(self, seed: int, method: str, predicted: Float[np.ndarray, "pair state"]) -> None:
        """Keep a method's prediction, which marks it as finished."""
        path = self._predicted(seed, method)
        path.parent.mkdir(parents=True, exist_ok=True)
        content = BytesIO()
        np.save(content, predicted)
        write_whole(path, content.getvalue())

    def keep_model(self, seed: int, method: str, model: WorldModel) -> None:
        """Keep a trained model's weights."""
        self._keep_weights(seed, method, model)

    def load_model(self, seed: int, method: str, settings: Method) -> WorldModel:
        """A trained model of this run, in evaluation mode."""
        model = WorldModel(self.world.spec, settings)
        model.load_state_dict(torch.load(self.home(seed, method) / WEIGHTS, weights_only=True))
        return model.eval()

    def baseline(self, seed: int, name: str) -> Baseline:
        """An untrained baseline."""
        config = self.config
        given = self.world.spec, config.baselines, seed, self.world, config.paper
        return find(name)(*given, self.data.lessons)

    def keep_baseline(self, seed: int, baseline: Baseline) -> None:
        """Keep a trained baseline's weights."""
        self._keep_weights(seed, baseline.name, baseline.nets)

    def load_baseline(self, seed: int, name: str) -> Baseline | None:
        """A trained baseline of this run; None if its weights were not kept, or fit no longer."""
        kept = self.home(seed, name) / WEIGHTS
        if not kept.exists():
            return None
        baseline = self.baseline(seed, name)
        baseline.nets.update(baseline.build())
        try:
            baseline.nets.load_state_dict(torch.load(kept, weights_only=True))
        except RuntimeError:  # another version's networks
            return None
        baseline.nets.eval()
        return baseline

    def _keep_weights(self, seed: int, method: str, module: nn.Module) -> None:
        home, content = self.home(seed, method), BytesIO()
        torch.save(module.state_dict(), content)
        home.mkdir(parents=True, exist_ok=True)
        write_whole(home / WEIGHTS, content.getvalue())

    def _predicted(self, seed: int, method: str) -> Path:
        return self.folder / "work" / f"seed{seed}" / f"{method}.npy"


def _estimates(config: FitConfig) -> bool:
    """Whether any method estimates what was hidden in R."""
    ours = any(use_of(method.mean).asks_simulator for method in (config.paper, config.plus))
    return ours or any("lessons" in find(name).trains_on for name in config.baselines.names)
