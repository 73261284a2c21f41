"""Simulators around S teach what R does beyond it, and R's recording where among them R is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.train.steps import in_order
from wt.config import Mean, Method, Nets, Train, TranslationConfig
from wt.nets.world_model import WorldModel
from wt.train import family
from wt.train.family import Family
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.selection import Unpaired
from wt.translate import carried, translated
from wt.types import Channel, Domain, Transitions, TransitionSpec

LENGTH, STEP = 40, 0.2
WIDTH = 0.3
"""Half the width of the logarithms of factors of carts around S."""
METHOD = Method(
    mean=Mean(kind="average", simulator="encoded", width=48, depth=2, steps=1500, batch=256),
    nets=Nets(latent=2, width=16, depth=1),
    translation=TranslationConfig(anchored=True),
    train=Train(steps=10, validate_every=10),
)


@dataclass(frozen=True)
class Physics:
    """A cart: what a step leaves of its velocity, its drive's gain, and a lever that may stick."""

    kept: float | np.ndarray = 0.8
    gain: float | np.ndarray = 0.5
    sticks: float = 0.0

    def step(self, o: np.ndarray, a: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, lever = o[:, :1], o[:, 1:2]
        v = self.kept * v + self.gain * a
        lever = lever + STEP * (a - lever - self.sticks * np.sin(3 * lever))
        return np.hstack([x + STEP * v, lever]).astype(np.float32), v.astype(np.float32)


S = Physics()
INSIDE = Physics(0.8 * np.exp(-0.2), 0.5 * np.exp(0.15))
"""One of the carts around S."""
OUTSIDE = replace(INSIDE, sticks=0.5)
"""None of them: their levers do not stick."""


class Cart:
    """A cart whose place is measured, and a lever on it; its velocity is hidden."""

    spec = TransitionSpec(
        task="cart",
        rate_hz=1 / STEP,
        joints=("x",),
        observation=(
            Channel("qpos/x", "m"),
            Channel("qpos/lever", "rad"),
            Channel("last/x", "N"),
        ),
        n_state=2,
        action=(Channel("ctrl/x", "N"),),
        hidden=(Channel("velocity/x", "m/s"),),
    )

    def advance(
        self, domain: Domain, o: np.ndarray, a: np.ndarray, hidden: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        return S.step(o, a, hidden)

    def sim_step(self, o: np.ndarray, a: np.ndarray, hidden: np.ndarray | None) -> np.ndarray:
        return S.step(o, a, np.zeros_like(a) if hidden is None else hidden)[0]

    def answers(self, real: Transitions) -> np.ndarray:
        return self.sim_step(real.o, real.a, real.hidden)

    def collect(self, physics: Physics, episodes: int, seed: int) -> Transitions:
        rng, rows = np.random.default_rng(seed), []
        v, last = (rng.normal(size=(episodes, 1)) for _ in range(2))
        state = rng.normal(size=(episodes, 2))
        for _ in range(LENGTH):
            a, o = rng.normal(size=(episodes, 1)), np.hstack([state, last])
            after, moved = physics.step(o, a, v)
            rows.append((o, a, after, v))
            state, v, last = after, moved, a
        return in_order(rows, self.sim_step)

    def lessons(self, carts: int) -> Transitions:
        """An episode of each of the carts around S, whose factors stand behind their velocities."""
        log_factors = np.random.default_rng(0).uniform(-WIDTH, WIDTH, (carts, 2))
        kept, gain = np.exp(log_factors.T)[:, :, None]
        data = self.collect(Physics(S.kept * kept, S.gain * gain), carts, 6)
        told = np.repeat(log_factors, LENGTH, axis=0)
        return replace(data, hidden=np.hstack([data.hidden, told]))


CART = Cart()


@pytest.fixture(scope="module")
def lessons() -> Transitions:
    return CART.lessons(150)


def trained(
    physics: Physics,
    lessons: Transitions,
    folder: Path,
    method: Method = METHOD,
    *,
    told: bool = True,
) -> WorldModel:
    def of_real(episodes: int, seed: int) -> Transitions:
        data = CART.collect(physics, episodes, seed)
        return data if told else replace(data, hidden=np.full_like(data.hidden, np.nan))

    selection = Unpaired(CART.collect(S, 10, 4), of_real(20, 5))
    given = CART.collect(S, 60, 1), of_real(60, 2), selection, 0, folder
    return fit_world_model(
        TrainingInput(CART.spec, method, *given, simulator=CART, lessons=lessons)
    )


@pytest.fixture(scope="module")
def inside(
    lessons: Transitions, tmp_path_factory: pytest.TempPathFactory
) -> tuple[WorldModel, np.ndarray]:
    """A model of a cart that is one of those around S, and logarithms of the factors found."""
    kept, find = list[np.ndarray](), Family._located

    def watched(self: Family, *given: object) -> torch.Tensor:
        factors = find(self, *given)  # type: ignore[arg-type]
        kept.append(factors.numpy() * WIDTH / np.sqrt(3))  # in units of their spread before
        return factors

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Family, "_located", watched)
        model = trained(INSIDE, lessons, tmp_path_factory.mktemp("inside"))
    (found,) = kept
    return model, found


def errors(model: WorldModel, physics: Physics) -> tuple[float, float]:
    """Mean squared error of places after a step, translated, and of S's own answer."""
    real = CART.collect(physics, 30, 3)
    answer = CART.answers(real)
    of_model = translated(model, real.o, real.a, answer) - real.s_next
    return float(np.mean(of_model**2)), float(np.mean((answer - real.s_next) ** 2))


def test_r_is_found_among_them_and_does_as_they_do(inside: tuple[WorldModel, np.ndarray]) -> None:
    model, found = inside
    error, of_sim = errors(model, INSIDE)
    assert error < 0.1 * of_sim
    np.testing.assert_allclose(found, [-0.2, 0.15], atol=0.06)


def test_what_is_hidden_goes_on_as_theirs_does(inside: tuple[WorldModel, np.ndarray]) -> None:
    real = CART.collect(INSIDE, 30, 9)
    answer, after = CART.advance("sim", real.o, real.a, real.hidden)
    truth = INSIDE.step(real.o, real.a, real.hidden)[1]
    left = carried(inside[0], real.o, real.a, answer, real.hidden, after) - truth
    assert np.mean(left**2) < 0.05 * np.mean((after - truth) ** 2)


def test_what_none_of_them_does_is_learned_of_r(
    lessons: Transitions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    error, of_sim = errors(trained(OUTSIDE, lessons, tmp_path / "learned"), OUTSIDE)
    monkeypatch.setattr(family, "WORTH", 1.0)  # nothing is worth it
    without, _ = errors(trained(OUTSIDE, lessons, tmp_path / "not"), OUTSIDE)
    assert error < 0.3 * without
    assert error < 0.3 * of_sim


QUICK = replace(METHOD, mean=replace(METHOD.mean, steps=20))


def test_what_was_hidden_in_r_is_never_read(lessons: Transitions, tmp_path: Path) -> None:
    once, again = (
        trained(INSIDE, lessons, tmp_path / str(told), QUICK, told=told).state_dict()
        for told in (True, False)
    )
    assert all(torch.equal(once[name], values) for name, values in again.items())


def test_a_resumed_run_finds_it_again(lessons: Transitions, tmp_path: Path) -> None:
    once, again = (trained(INSIDE, lessons, tmp_path, QUICK).state_dict() for _ in range(2))
    assert all(torch.equal(once[name], values) for name, values in again.items())
