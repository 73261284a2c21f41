"""The contract of a baseline, its registry, and how to add one.

Adding a baseline is one new file in this package (and its test): subclass :class:`Baseline`, set
``name`` as it shall appear in tables, write ``build`` (unless nothing is learned), ``fit`` and
``predict``, decorate with ``@register``.
It is found by itself; add its name to ``baselines.names`` to run it. All baselines share the
data, the size of networks and the budget of :class:`wt.config.Baselines`.
"""

from __future__ import annotations

import importlib
import pkgutil
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

import wt.baselines
from wt.config import Baselines, Mean
from wt.errors import ConfigError, suggest
from wt.nets.frame import Frame
from wt.nets.mlp import mlp
from wt.train.mean_field import fit_normalizers
from wt.train.regression import Progress, Regression, Score
from wt.types import Pairs, Transitions, TransitionSpec

CHUNK = 16384


class Baseline(ABC):
    """Predicts R's next state from pairs; learns from unpaired transitions only.

    Attributes:
        name: as in tables and ``results.json``.
        frame: normalisers, the same for all methods.
        nets: everything that is learned, by name, the frame included; what is kept of a fit.
    """

    name: ClassVar[str]

    def __init__(self, spec: TransitionSpec, settings: Baselines, seed: int) -> None:
        """Set up without data.

        Args:
            spec: layout of the transitions.
            settings: size and budget, shared by all baselines.
            seed: same seed, same baseline.
        """
        self.spec, self.settings, self.seed = spec, settings, seed
        self.frame = Frame(spec, Mean())
        self.nets = nn.ModuleDict({"frame": self.frame})

    def train(
        self,
        sim: Transitions,
        real: Transitions,
        validation: Pairs | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Fit normalisers and networks.

        Args:
            sim: unpaired transitions of S.
            real: unpaired transitions of R.
            validation: pairs on which :meth:`score` is taken while training; None to keep the
                last weights.
            progress: called with (done, total) steps.
        """
        torch.manual_seed(self.seed)
        fit_normalizers(self.frame, sim, real)
        self.nets.update(self.build())
        self._validation = validation
        self.fit(sim, real, progress)

    def score(self) -> Score | None:
        """Error on the validation pairs with the networks as they are, for early choice."""
        pairs = self._validation
        if pairs is None:
            return None
        scale = self.frame.state.std.cpu().numpy()
        return lambda: float((((self.predict(pairs) - pairs.real.s_next) / scale) ** 2).mean())

    def build(self) -> dict[str, nn.Module]:
        """Untrained networks by name, their sizes from ``spec`` and ``settings`` alone."""
        return {}

    @abstractmethod
    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Learn from both domains' unpaired transitions."""

    @abstractmethod
    def predict(self, pairs: Pairs) -> np.ndarray:
        """R's state channels after the step, physical units, (N, n_state), float32."""

    def budget(self) -> Regression:
        """The shared training budget."""
        s = self.settings
        return Regression(s.steps, s.batch, s.learning_rate, self.seed)

    def network(self, inputs: int) -> nn.Module:
        """A network of the shared size that predicts the normalised change."""
        return mlp(inputs, self.spec.n_state, self.settings.width, self.settings.depth)

    @torch.no_grad()
    def tensors(self, data: Transitions) -> tuple[Tensor, Tensor, Tensor]:
        """Normalised (o, a), nominal change and actual change of transitions."""
        o = torch.tensor(data.o)
        x = self.frame.conditions(o, torch.tensor(data.a))
        nominal = self.frame.changes(o, torch.tensor(data.nominal))
        return x, nominal, self.frame.changes(o, torch.tensor(data.s_next))

    def sim_change(self, pairs: Pairs) -> Tensor:
        """Normalised change of S's answer, (N, n_state)."""
        return self.frame.changes(torch.tensor(pairs.real.o), torch.tensor(pairs.sim_next))

    def states(self, pairs: Pairs, change: Tensor) -> np.ndarray:
        """Next states in physical units for normalised changes."""
        return self.frame.next_states(torch.tensor(pairs.real.o), change).cpu().numpy()


_BASELINES: dict[str, type[Baseline]] = {}


def register(baseline: type[Baseline]) -> type[Baseline]:
    """Class decorator: make a baseline available under its ``name``.

    Raises:
        ConfigError: two files claim the same name.
    """
    if baseline.name in _BASELINES:
        raise ConfigError(
            f"baseline {baseline.name!r} is defined by both "
            f"{_BASELINES[baseline.name].__module__} and {baseline.__module__}; rename one"
        )
    _BASELINES[baseline.name] = baseline
    return baseline


def find(name: str) -> type[Baseline]:
    """The baseline of that name.

    Raises:
        ConfigError: there is none.
    """
    for module in pkgutil.iter_modules(wt.baselines.__path__):
        importlib.import_module(f"wt.baselines.{module.name}")
    if name not in _BASELINES:
        raise ConfigError(f"baselines.names: {name!r} is not known: {suggest(name, _BASELINES)}")
    return _BASELINES[name]


@torch.no_grad()
def in_chunks(net: nn.Module, inputs: Tensor) -> Tensor:
    """Apply a network to many rows without holding all activations."""
    return torch.cat([net(part) for part in inputs.split(CHUNK)])
