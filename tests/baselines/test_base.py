from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.baselines.toy import REAL, SIM, Toy
from wt.baselines import base
from wt.baselines.base import find, longest_first, register
from wt.config import Baselines
from wt.errors import ConfigError
from wt.train.selection import Paired, Unpaired
from wt.types import Pairs, Transitions

NAMES = Baselines().names
TINY = Baselines(width=8, depth=1, steps=5, batch=32, history=3)

each_baseline = pytest.mark.parametrize("name", NAMES)


def predict(name: str, seed: int, test: Pairs | None = None) -> np.ndarray:
    toy = Toy(0.5)
    baseline = find(name)(toy.spec, TINY, seed, toy)
    baseline.train(toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2))
    return baseline.predict(test or toy.pairs(2, 3))


def test_all_promised_names_are_found() -> None:
    assert {find(name).name for name in NAMES} == {
        "RawSim", "DirectPred", "ResDyn", "ResDynSim", "RSSM", "MeanShiftOT", "DeltaAction",
        "FlowTranslation", "SimulatorEncoder", "PairedCeiling",
    }  # fmt: skip


def test_the_longest_training_starts_first_and_none_last() -> None:
    order = longest_first(NAMES)
    assert sorted(order) == sorted(NAMES)
    assert (order[0], order[-2:]) == ("RSSM", ["DirectPred", "RawSim"])


def test_unknown_name_is_told_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'ResDyn'"):
        find("ResDin")


def test_a_name_used_twice_is_refused_with_both_files() -> None:
    copy = type("Copy", (find("RawSim"),), {"__module__": "elsewhere"})
    with pytest.raises(ConfigError, match=r"wt\.baselines\.rawsim and elsewhere"):
        register(copy)


def scaled(data: Transitions, scale: float) -> Transitions:
    """The same with other hidden variables."""
    return replace(data, hidden=scale * data.hidden)


def shuffled(data: Transitions) -> Transitions:
    """The same with other outcomes."""
    rows = np.random.default_rng(0).permutation(len(data))
    return replace(data, s_next=data.s_next[rows], nominal=data.nominal[rows])


@each_baseline
def test_what_it_says_that_it_trains_on_is_what_changes_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    toy = Toy(0.5)
    test, sim, real = toy.pairs(2, 3), toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2)
    # scales are of both domains, whatever a method is trained on
    fit = base.fit_normalizers
    monkeypatch.setattr(base, "fit_normalizers", lambda frame, *_: fit(frame, sim, real))

    def predicted(sim: Transitions, real: Transitions) -> np.ndarray:
        baseline = find(name)(toy.spec, TINY, 0, toy)
        baseline.train(sim, real)
        return baseline.predict(test)

    as_it_is = predicted(sim, real)
    reads = {
        "sim": predicted(shuffled(sim), real),
        "real": predicted(sim, shuffled(real)),
        "pairs": predicted(sim, scaled(real, 7.0)),
    }
    found = {what for what, other in reads.items() if not np.array_equal(as_it_is, other)}
    if "pairs" in found:  # which are R's transitions, too
        found.remove("real")
    # forces are hidden here, of which simulators around S teach nothing
    assert set(find(name).trains_on) - {"lessons"} == found


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
    if name != "DeltaAction":  # S, which it steps again, keeps it
        fields["hidden"][:] = np.nan
    fields["s_next"][last] += 7.0  # no later step of the episode may have seen it
    other = Pairs(Transitions(**fields), test.sim_next)
    assert np.array_equal(predict(name, 0, test)[last], predict(name, 0, other)[last])


@each_baseline
def test_kept_weights_predict_the_same(name: str) -> None:
    toy = Toy(0.5)
    test = toy.pairs(2, 3)
    first, second = (find(name)(toy.spec, TINY, 0, toy) for _ in range(2))
    first.train(toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2))
    second.nets.update(second.build())
    second.nets.load_state_dict(first.nets.state_dict())
    assert np.array_equal(second.predict(test), first.predict(test))


@pytest.mark.parametrize("name", [n for n in NAMES if n != "RawSim"])
def test_is_selected_without_pairs_and_without_what_is_hidden(name: str) -> None:
    toy = Toy(0.5)
    test, answers = toy.pairs(2, 3), []
    for scale in (1.0, 7.0):
        domains = (toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2))
        held = (toy.collect(SIM, 2, 4), toy.collect(REAL, 2, 5))
        if name != "PairedCeiling":
            held = tuple(scaled(data, scale) for data in held)
        baseline = find(name)(toy.spec, replace(TINY, steps=20, learning_rate=0.3), 0, toy)
        baseline.train(*domains, Unpaired(*held))
        assert baseline.score is not None and np.isfinite(baseline.score()())
        answers.append(baseline.predict(test))
    assert np.array_equal(*answers)


@each_baseline
def test_without_pairs_nothing_hidden_is_trained_on(name: str) -> None:
    if name == "PairedCeiling":
        pytest.skip("is trained on pairs")
    toy = Toy(0.5)
    test, answers = toy.pairs(2, 3), []
    for scale in (1.0, 7.0):
        sim, real = toy.collect(SIM, 3, 1), scaled(toy.collect(REAL, 3, 2), scale)
        if name != "SimulatorEncoder":  # what is hidden in S is S's own
            sim = scaled(sim, scale)
        baseline = find(name)(toy.spec, TINY, 0, toy)
        baseline.train(sim, real)
        answers.append(baseline.predict(test))
    assert np.array_equal(*answers)


@pytest.mark.parametrize("name", ["DeltaAction", "SimulatorEncoder", "PairedCeiling"])
def test_what_steps_the_simulator_says_so_where_it_has_none(name: str) -> None:
    toy = Toy(0.5)
    with pytest.raises(ConfigError, match=f"'{name}' steps the simulator"):
        find(name)(toy.spec, TINY, 0).train(toy.collect(SIM, 2, 1), toy.collect(REAL, 2, 2))


def test_rows_that_need_a_word_have_one() -> None:
    spec = Toy(0.5).spec
    said = {name for name in NAMES if find(name).remark(spec)}
    assert said == {"ResDyn", "DeltaAction", "SimulatorEncoder", "PairedCeiling"}
    assert find("ResDyn").remark(replace(spec, hidden=())) is None


@pytest.mark.parametrize("name", ["DirectPred", "ResDyn", "SimulatorEncoder", "PairedCeiling"])
def test_members_of_an_ensemble_are_others_and_are_averaged(name: str) -> None:
    toy = Toy(0.5)
    test = toy.pairs(2, 3)
    several = find(name)(toy.spec, replace(TINY, members=3), 0, toy)
    several.train(toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2), Paired(test, np.ones(4)))
    members = list(several.net.members)
    together = several.predict(test).astype(float)
    alone = []
    for member in members:
        several.net.members = torch.nn.ModuleList([member])
        alone.append(several.predict(test).astype(float))
    assert len(members) == 3 and not np.allclose(alone[0], alone[1])
    np.testing.assert_allclose(together, np.mean(alone, axis=0), atol=1e-5)
