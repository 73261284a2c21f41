from __future__ import annotations

import numpy as np
import pytest

from tests.baselines.toy import REAL, SIM, Toy
from wt.baselines.base import find, register
from wt.config import Baselines
from wt.errors import ConfigError
from wt.types import Pairs, Transitions

NAMES = Baselines().names
TINY = Baselines(width=8, depth=1, steps=5, batch=32, history=3)

each_baseline = pytest.mark.parametrize("name", NAMES)


def predict(name: str, seed: int, test: Pairs | None = None) -> np.ndarray:
    toy = Toy(0.5)
    baseline = find(name)(toy.spec, TINY, seed)
    baseline.train(toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2))
    return baseline.predict(test or toy.pairs(2, 3))


def test_all_promised_names_are_found() -> None:
    assert {find(name).name for name in NAMES} == {
        "RawSim", "DirectPred", "ResDyn", "ResDynSim", "RSSM", "MeanShiftOT"
    }  # fmt: skip


def test_unknown_name_is_told_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'ResDyn'"):
        find("ResDin")


def test_a_name_used_twice_is_refused_with_both_files() -> None:
    copy = type("Copy", (find("RawSim"),), {"__module__": "elsewhere"})
    with pytest.raises(ConfigError, match=r"wt\.baselines\.rawsim and elsewhere"):
        register(copy)


@each_baseline
def test_predicts_states_in_float32(name: str) -> None:
    predicted = predict(name, 0)
    assert predicted.shape == (120, 4)
    assert predicted.dtype == np.float32
    assert np.isfinite(predicted).all()


@each_baseline
def test_same_seed_same_prediction(name: str) -> None:
    assert np.array_equal(predict(name, 4), predict(name, 4))


@pytest.mark.parametrize("name", [n for n in NAMES if n != "RawSim"])
def test_seed_matters(name: str) -> None:
    assert not np.array_equal(predict(name, 4), predict(name, 5))


@each_baseline
def test_never_reads_what_is_hidden_or_the_answer(name: str) -> None:
    test = Toy(0.5).pairs(2, 3)
    last = np.flatnonzero(test.real.step == 59)
    fields = {f: np.array(getattr(test.real, f)) for f in test.real.__dataclass_fields__}
    fields["hidden"][:] = np.nan
    fields["s_next"][last] += 7.0  # no later step of the episode may have seen it
    other = Pairs(Transitions(**fields), test.sim_next)
    assert np.array_equal(predict(name, 0, test)[last], predict(name, 0, other)[last])


@each_baseline
def test_kept_weights_predict_the_same(name: str) -> None:
    toy = Toy(0.5)
    test = toy.pairs(2, 3)
    first, second = (find(name)(toy.spec, TINY, 0) for _ in range(2))
    first.train(toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2))
    second.nets.update(second.build())
    second.nets.load_state_dict(first.nets.state_dict())
    assert np.array_equal(second.predict(test), first.predict(test))
