"""What no sensor tells goes on as R's, learned from R's recording without pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.train.steps import in_order
from wt.config import Mean, Method, Nets, Train, TranslationConfig
from wt.nets.world_model import WorldModel
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.selection import Unpaired
from wt.translate import carried, translated
from wt.types import Channel, Domain, Transitions, TransitionSpec

KEPT: dict[Domain, float] = {"sim": 0.95, "real": 0.7}
"""Share of a sled's velocity that is left after a step: R's rubs more."""
LENGTH = 60


@dataclass(frozen=True)
class Sled:
    """A sled whose place is measured, and whose velocity is not."""

    unit: str = "m/s"

    @property
    def spec(self) -> TransitionSpec:
        return TransitionSpec(
            task="sled",
            rate_hz=10.0,
            joints=("x",),
            observation=(Channel("qpos/x", "m"), Channel("last/x", "N")),
            n_state=1,
            action=(Channel("ctrl/x", "N"),),
            hidden=(Channel("velocity/x", self.unit),),
        )

    def advance(
        self, domain: Domain, o: np.ndarray, a: np.ndarray, hidden: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        v = KEPT[domain] * hidden + 0.5 * a
        return (o[:, :1] + 0.2 * v).astype(np.float32), v.astype(np.float32)

    def sim_step(self, o: np.ndarray, a: np.ndarray, hidden: np.ndarray | None) -> np.ndarray:
        return self.advance("sim", o, a, np.zeros_like(a) if hidden is None else hidden)[0]

    def answers(self, real: Transitions) -> np.ndarray:
        return self.sim_step(real.o, real.a, real.hidden)

    def collect(self, domain: Domain, episodes: int, seed: int) -> Transitions:
        rng, rows = np.random.default_rng(seed), []
        x, v, last = (rng.normal(size=(episodes, 1)) for _ in range(3))
        for _ in range(LENGTH):
            a, o = rng.normal(size=(episodes, 1)), np.hstack([x, last])
            after, moved = self.advance(domain, o, a, v)
            rows.append((o, a, after, v))
            x, v, last = after, moved, a
        return in_order(rows, self.sim_step)


METHOD = Method(
    mean=Mean(kind="average", simulator="encoded", width=32, depth=2, steps=600, batch=256),
    nets=Nets(latent=2, width=16, depth=1),
    translation=TranslationConfig(anchored=True),
    train=Train(steps=10, validate_every=10),
)


def trained(sled: Sled, folder: Path, method: Method = METHOD) -> WorldModel:
    selection = Unpaired(sled.collect("sim", 4, 3), sled.collect("real", 4, 4))
    given = sled.collect("sim", 40, 1), sled.collect("real", 40, 2), selection, 0, folder
    return fit_world_model(TrainingInput(sled.spec, method, *given, simulator=sled))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> WorldModel:
    return trained(Sled(), tmp_path_factory.mktemp("sled"))


def met(sled: Sled) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Observations, actions and velocities that R comes by."""
    real = sled.collect("real", 30, 9)
    return real.o, real.a, real.hidden


def drift(model: WorldModel, sled: Sled, gain: float) -> float:
    """RMS error of the place after 20 steps that S takes alone, translated, from R's states."""
    fitted = model.frame.hidden.gain.clone()
    model.frame.hidden.gain.fill_(gain)
    real = sled.collect("real", 30, 7)
    rows = np.arange(30) * LENGTH + 10
    o, v = real.o[rows], real.hidden[rows]
    for k in range(20):
        a = real.a[rows + k]
        answer, after = sled.advance("sim", o, a, v)
        v = carried(model, o, a, answer, v, after)
        o = np.hstack([translated(model, o, a, answer), a])
    model.frame.hidden.gain.copy_(fitted)
    return float(np.sqrt(((o[:, :1] - real.s_next[rows + 19]) ** 2).mean()))


def test_a_velocity_that_no_sensor_tells_goes_on_as_r_s(model: WorldModel) -> None:
    assert float(model.frame.hidden.gain) >= 0.75
    o, a, v = met(Sled())
    answer, of_sim = Sled().advance("sim", o, a, v)
    of_real = Sled().advance("real", o, a, v)[1]
    left = carried(model, o, a, answer, v, of_sim) - of_real
    # S's law reads velocities off R's outcomes, so that a part of the difference is not seen
    assert np.sqrt((left**2).mean()) < 0.75 * np.sqrt(((of_sim - of_real) ** 2).mean())


def test_rollouts_stay_nearer_to_r_with_it(model: WorldModel) -> None:
    assert drift(model, Sled(), float(model.frame.hidden.gain)) < 0.5 * drift(model, Sled(), 0.0)


def test_a_resumed_run_finds_it_again(model: WorldModel, tmp_path: Path) -> None:
    once = trained(Sled(), tmp_path)
    again = trained(Sled(), tmp_path)
    kept = again.frame.hidden.state_dict()
    assert all(torch.equal(kept[k], v) for k, v in once.frame.hidden.state_dict().items())
    assert not any(p.requires_grad for p in again.frame.parameters())


def test_where_r_s_hidden_variables_are_s_s_nothing_is_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(KEPT, "real", KEPT["sim"])
    model = trained(Sled(), tmp_path)
    o, a, v = met(Sled())
    answer, after = Sled().advance("sim", o, a, v)
    off = carried(model, o, a, answer, v, after) - after
    assert np.sqrt((off**2).mean()) < 0.1 * v.std()


def test_forces_of_the_moment_and_the_paper_s_method_have_none(tmp_path: Path) -> None:
    assert WorldModel(Sled("N").spec, METHOD).frame.hidden is None
    plain = replace(METHOD, mean=Mean())
    assert WorldModel(Sled().spec, plain).frame.hidden is None
    o, v = np.zeros((3, 2)), np.ones((3, 1))
    assert carried(WorldModel(Sled().spec, METHOD), o, v, v, v, v) is v  # not fitted
