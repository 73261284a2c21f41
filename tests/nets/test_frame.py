from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.baselines.toy import REAL, SIM, Toy
from wt.config import Mean
from wt.nets.frame import Frame
from wt.train.mean_field import fit_normalizers
from wt.types import Channel

TOY = Toy(0.0)


@pytest.fixture(scope="module")
def fitted() -> Frame:
    frame = Frame(TOY.spec, Mean())
    fit_normalizers(frame, TOY.collect(SIM, 10, 1), TOY.collect(REAL, 10, 2))
    return frame


def some(n: int = 9) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    torch.manual_seed(0)
    return torch.randn(n, 6), torch.randn(n, 2), torch.randn(n, 4)


def test_next_states_undo_changes(fitted: Frame) -> None:
    o, _, s_next = some()
    torch.testing.assert_close(fitted.next_states(o, fitted.changes(o, s_next)), s_next)


def test_positions_that_follow_are_integrated_from_the_new_velocity(fitted: Frame) -> None:
    frame = Frame(replace(TOY.spec, integrated=((0, 2), (1, 3))), Mean())
    frame.load_state_dict(fitted.state_dict() | {"free": frame.free})
    o, _, s_next = some()
    assert not frame.changes(o, s_next)[:, :2].any()
    found = frame.next_states(o, frame.changes(o, s_next))
    torch.testing.assert_close(found[:, 2:], s_next[:, 2:])
    moved = o[:, :2] + s_next[:, 2:] / TOY.spec.rate_hz
    torch.testing.assert_close(found[:, :2], moved)


def test_changes_are_in_standard_deviations_and_zero_stays_zero(fitted: Frame) -> None:
    sim, real = TOY.collect(SIM, 10, 1), TOY.collect(REAL, 10, 2)
    raw = np.concatenate([d.s_next - d.o[:, :4] for d in (sim, real)]).astype(np.float64)
    changes = fitted.changes(torch.tensor(real.o), torch.tensor(real.s_next))
    expected = (real.s_next - real.o[:, :4]) / raw.std(axis=0)
    np.testing.assert_allclose(changes.numpy(), expected, rtol=1e-4, atol=1e-5)
    o, _, _ = some()
    assert torch.equal(fitted.changes(o, o[:, :4]), torch.zeros(9, 4))


def test_state_scale_is_that_of_the_real_domain_alone(fitted: Frame) -> None:
    real = TOY.collect(REAL, 10, 2)
    np.testing.assert_allclose(fitted.state.std, real.s_next.std(axis=0), rtol=1e-4)


def test_joint_targets_are_offsets_from_the_joint_positions(fitted: Frame) -> None:
    o, a, _ = some()
    x = fitted.raw_condition(o, a)
    pose = o[:, :2]
    expected = torch.cat([o[:, :4], o[:, 4:] - pose, a - pose], dim=1)
    torch.testing.assert_close(x, expected)


def test_actions_of_another_unit_stay_as_they_are() -> None:
    torques = tuple(Channel(f"ctrl/{j}", "N·m") for j in TOY.spec.joints)
    frame = Frame(replace(TOY.spec, action=torques), Mean())
    o, a, _ = some()
    assert torch.equal(frame.raw_condition(o, a), torch.cat([o, a], dim=1))


def test_conditions_are_normalised(fitted: Frame) -> None:
    data = [TOY.collect(SIM, 10, 1), TOY.collect(REAL, 10, 2)]
    o, a = (torch.tensor(np.concatenate([getattr(d, k) for d in data])) for k in "oa")
    x = fitted.conditions(o, a)
    np.testing.assert_allclose(x.mean(0), 0.0, atol=1e-4)
    np.testing.assert_allclose(x.std(0, correction=0), 1.0, rtol=1e-3)


def test_without_a_mean_field_nothing_is_taken_off(fitted: Frame) -> None:
    x, change = torch.randn(5, fitted.n_condition), torch.randn(5, 4)
    assert torch.equal(fitted.nominal_change(x), torch.zeros(5, 4))
    assert torch.equal(fitted.shift_change(x, change), torch.zeros(5, 4))
    assert torch.equal(fitted.transport, torch.eye(4))


def test_shift_reads_the_simulator_only_if_told() -> None:
    x, one, other = torch.randn(5, 8), torch.randn(5, 4), torch.randn(5, 4)
    reads = Frame(TOY.spec, Mean(kind="average", simulator="read", width=8, depth=1))
    assert not torch.allclose(reads.shift_change(x, one), reads.shift_change(x, other))
    blind = Frame(TOY.spec, Mean(kind="average", width=8, depth=1))
    assert torch.equal(blind.shift_change(x, one), blind.shift_change(x, other))


def test_with_the_simulator_ignored_nothing_of_it_gets_through() -> None:
    frame = Frame(TOY.spec, Mean(kind="average", simulator="ignored", width=8, depth=1))
    assert frame.nominal is None
    assert torch.equal(frame.transport, torch.zeros(4, 4))
