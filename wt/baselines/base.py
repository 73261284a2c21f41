"""The contract of a baseline, its registry, and how to add one.

Adding a baseline is one new file in this package (and its test): subclass :class:`Baseline`, set
``name`` as it shall appear in tables, write ``build`` (unless nothing is learned), ``fit`` and
``predict``, decorate with ``@register``. ``trains_on`` says what ``fit`` reads, which its run in
MLflow lists; ``remark`` what a reader of a table must know of its row. It is found by itself; add
its name to ``baselines.names`` to run it. All baselines share the data, the size of networks and
the budget of :class:`wt.config.Baselines`.
"""

from __future__ import annotations

import importlib
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor, nn

import wt.baselines
from wt.config import Baselines, Mean, Method
from wt.errors import ConfigError, suggest
from wt.nets.frame import Frame
from wt.nets.mlp import Ensemble, mlp
from wt.train.hidden import Simulator
from wt.train.logger import Curves, MetricSink
from wt.train.mean_field import fit_normalizers
from wt.train.regression import (
    Progress,
    Regression,
    Score,
    member_seed,
    one_by_one,
    part_of,
    regress,
)
from wt.train.selection import Selection
from wt.types import Pairs, Transitions, TransitionSpec

Source = Literal["sim", "real", "pairs", "lessons"]
"""What may be trained on: unpaired transitions of S, those of R, pairs, or simulators around S.

Pairs are R's transitions, each with S's answer under what was hidden then.
"""


class Baseline(ABC):
    """Predicts R's next state from pairs; learns from unpaired transitions, unless it says so.

    Attributes:
        name: as in tables and ``results.json``.
        trains_on: what ``fit`` reads; R alone unless it says otherwise. The scales of channels, the
            same for all methods, are of both domains.
        translates: whether it moves S's outcome, whatever that is, to R, and nothing else; without
            pairs it is then scored by distributions, as World Translation is.
        cost: time that its training takes beside DirectPred's, roughly.
        selection: held-out data of the training at hand.
        simulator: S, where there is one.
        paper: the paper's method, of the same task.
        lessons: transitions of simulators around S, where there are any.
        frame: normalisers, the same for all methods.
        nets: everything that is learned, by name, the frame included; what is kept of a fit.
    """

    name: ClassVar[str]
    trains_on: ClassVar[tuple[Source, ...]] = ("real",)
    translates: ClassVar[bool] = False
    cost: ClassVar[float] = 2.0

    def __init__(
        self,
        spec: TransitionSpec,
        settings: Baselines,
        seed: int,
        simulator: Simulator | None = None,
        paper: Method | None = None,
        lessons: Transitions | None = None,
    ) -> None:
        """Set up without data.

        Args:
            spec: layout of the transitions.
            settings: size and budget, shared by all baselines.
            seed: same seed, same baseline.
            simulator: S, for a baseline that steps it again; most do without.
            paper: the paper's method as the task has it, for one that takes part of it over.
            lessons: transitions of simulators around S, for one that learns what is hidden there.
        """
        self.spec, self.settings, self.seed = spec, settings, seed
        self.simulator, self.paper = simulator, paper or Method()
        self.lessons = lessons
        self.frame = Frame(spec, Mean())
        self.nets = nn.ModuleDict({"frame": self.frame})
        self.selection: Selection | None = None
        self._curves = Curves()

    def train(
        self,
        sim: Transitions,
        real: Transitions,
        selection: Selection | None = None,
        progress: Progress | None = None,
        sink: MetricSink | None = None,
    ) -> None:
        """Fit normalisers and networks.

        Args:
            sim: unpaired transitions of S.
            real: unpaired transitions of R.
            selection: held-out data on which :meth:`score` is taken while training; None to keep
                the last weights.
            progress: called with (done, total) steps.
            sink: where the scores go, by the steps that are done.
        """
        torch.manual_seed(self.seed)
        fit_normalizers(self.frame, sim, real)
        self.nets.update(self.build())
        self.selection, self._curves = selection, Curves(sink, progress)
        self.fit(sim, real, self._curves.follow)

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """A sentence that a table of such a task needs beside this row, or None."""
        return None

    def score(self) -> Score | None:
        """Error on what is held out with the networks as they are, for early choice."""
        chosen_by = self.selection
        if chosen_by is None:
            return None
        if self.translates:
            source = chosen_by.translated
            return self.drawn(
                chosen_by.metric, lambda: chosen_by.error(torch.tensor(self.predict(source)))
            )
        pairs, scale = self.held_out(chosen_by), self.frame.state.std.cpu().numpy()
        return self.drawn(
            "mse", lambda: float((((self.predict(pairs) - pairs.real.s_next) / scale) ** 2).mean())
        )

    def drawn(self, metric: str, score: Score) -> Score:
        """A score that is also a point of the training's curve ``val/<metric>``."""
        return self._curves.drawn(metric, score)

    def held_out(self, selection: Selection) -> Pairs:
        """R's transitions that score a prediction, with the answer of S that it may read."""
        return selection.predicted

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

    def ensemble(self, inputs: int) -> Ensemble:
        """As many such networks as the settings say, averaged."""
        return Ensemble([self.network(inputs) for _ in range(self.settings.members)])

    def fit_ensemble(
        self,
        ensemble: Ensemble,
        batch_error: Callable[[Tensor], Tensor],
        rows: int,
        progress: Progress | None,
    ) -> None:
        """Least squares for each member by itself, at the weights that score best.

        Args:
            ensemble: trained in place; ``batch_error`` calls it.
            batch_error: row indices (batch,) → prediction error (batch, channels).
            rows: number of rows to draw from.
            progress: called with (done, total) steps of all members.
        """
        budget, total = self.budget(), self.settings.steps * len(ensemble.members)
        for k, _ in one_by_one(ensemble):
            regress(
                ensemble,
                batch_error,
                rows,
                replace(budget, seed=member_seed(self.seed, k)),
                progress=part_of(progress, k * budget.steps, total),
                score=self.score(),
            )

    def the_simulator(self) -> Simulator:
        """S, of a baseline that cannot do without.

        Raises:
            ConfigError: it was given none.
        """
        if self.simulator is None:
            raise ConfigError(f"baseline {self.name!r} steps the simulator, and was given none")
        return self.simulator

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


def longest_first(names: Sequence[str]) -> list[str]:
    """Names of baselines in the order in which they are to start, so that no core waits long."""
    return sorted(names, key=lambda name: -find(name).cost)


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
