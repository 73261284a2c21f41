"""Real training on a toy whose domains differ in ways that only translation can undo.

Two joints under a hidden force that is absent half of the time. R is softer than S, is pulled to
one side all the time, and answers a force 8 times as strongly in one direction as in the other:
no linear map does that. Nothing but the simulator can tell the force, so DirectPred, which does
not see it, keeps all of its effect as error, and RawSim keeps the gap between the domains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.baselines.toy import Toy
from wt.baselines.base import find
from wt.config import Baselines, Mean, Method, Nets, Train, TranslationConfig
from wt.nets.world_model import WorldModel
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.score import PairTensors, errors
from wt.train.selection import Selection, Unpaired
from wt.types import Domain, Pairs, Transitions

SPEC, DT = Toy(0.0).spec, 0.1
NETS = Nets(latent=4, width=48, depth=2, translator_width=48)


def step(domain: Domain, s: np.ndarray, a: np.ndarray, f: np.ndarray) -> np.ndarray:
    q, v = s[:, :2], s[:, 2:]
    if domain == "sim":
        acceleration = 8 * (a - q) - 3 * v + f
    else:
        acceleration = 6 * (a - q) - 2 * v + np.where(f > 0, 1.6, 0.2) * f - 6
    v = v + DT * acceleration
    return np.hstack([q + DT * v, v])


def collect(domain: Domain, n: int, seed: int) -> Transitions:
    rng = np.random.default_rng(seed)
    s = rng.normal(size=(n, 4))
    a, last = (s[:, :2] + 0.4 * rng.normal(size=(n, 2)) for _ in range(2))
    f = 6 * rng.normal(size=(n, 2)) * (rng.random((n, 1)) < 0.5)
    return Transitions(
        o=np.hstack([s, last]), a=a, s_next=step(domain, s, a, f),
        nominal=step("sim", s, a, 0 * f), hidden=f, episode=np.arange(n), step=np.zeros(n),
    )  # fmt: skip


def both_answers(n: int, seed: int) -> Pairs:
    real = collect("real", n, seed)
    o, a, f = (x.astype(float) for x in (real.o, real.a, real.hidden))
    return Pairs(real, step("sim", o[:, :4], a, f))


@dataclass(frozen=True)
class Data:
    """Both domains' transitions, more of both to select by, and pairs to be judged by."""

    sim: Transitions
    real: Transitions
    selection: Selection
    test: Pairs

    def error(self, predicted: np.ndarray) -> float:
        """Mean squared error on the test pairs, by the variance of R's change."""
        real = self.test.real
        change = (real.s_next - real.o[:, :4]).std(axis=0)
        return float(np.mean(((predicted - real.s_next) / change) ** 2))

    def baselines(self, names: Sequence[str]) -> list[float]:
        settings = Baselines(width=48, depth=2, steps=600, batch=128, learning_rate=4e-3)
        out = []
        for name in names:
            baseline = find(name)(SPEC, settings, 0)
            baseline.train(self.sim, self.real)
            out.append(self.error(baseline.predict(self.test)))
        return out

    def model_error(self, model: WorldModel) -> float:
        real = self.test.real
        change = torch.tensor((real.s_next - real.o[:, :4]).std(axis=0))
        return errors(model, PairTensors.of(self.test, torch.ones(4), change))[1]

    def fit(self, method: Method, folder: Path) -> WorldModel:
        return fit_world_model(
            TrainingInput(SPEC, method, self.sim, self.real, self.selection, 0, folder),
            warn=pytest.fail,
        )


@pytest.fixture(scope="module")
def data() -> Data:
    return Data(
        collect("sim", 4000, 1), collect("real", 4000, 2),
        Unpaired(collect("sim", 1000, 5), collect("real", 1000, 6)), both_answers(2000, 4),
    )  # fmt: skip


def training(steps: int, gan_learning_rate: float) -> Train:
    return Train(
        steps=steps, batch=128, learning_rate=4e-3, gan_learning_rate=gan_learning_rate,
        validate_every=100, log_every=100,
    )  # fmt: skip


def test_the_papers_method_undoes_the_gap(data: Data, tmp_path: Path) -> None:
    raw, direct = data.baselines(["RawSim", "DirectPred"])
    paper = data.model_error(data.fit(Method(nets=NETS, train=training(500, 2e-3)), tmp_path))
    # seen with seeds 0 to 2:
    assert paper < 0.4 * direct
    assert paper < 0.4 * raw


@pytest.mark.long
def test_ours_does_what_no_linear_map_does(data: Data, tmp_path: Path) -> None:
    raw, shift_and_transport = data.baselines(["RawSim", "MeanShiftOT"])
    method = Method(
        mean=Mean(kind="mode", width=48, depth=2, steps=600, batch=128),
        nets=NETS,
        translation=TranslationConfig(
            conditioned=True, adversarial="lsgan", cycle=1.0, identity=0.0, transport=True,
            anchored=True, average=0.98,
        ),
        train=training(800, 5e-3),
    )  # fmt: skip
    model = data.fit(method, tmp_path)
    ours = data.model_error(model)
    # over three seeds 0.06 … 0.08, where these two are at 0.58 and 0.15
    assert ours < 0.8 * shift_and_transport
    assert ours < 0.25 * raw
    # it is the translation that does it
    model.strength.data.fill_(0.0)
    assert ours < 0.6 * data.model_error(model)
