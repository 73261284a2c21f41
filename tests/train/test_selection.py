from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist
from scipy.stats import energy_distance as of_scipy

from tests.baselines.toy import REAL, SIM, Toy
from tests.data.test_transitions import each
from wt.data.stored import Stored
from wt.data.transitions import Shard, ensure
from wt.train import selection
from wt.train.selection import Paired, Unpaired, energy_distance, hold_out, hold_out_stored
from wt.types import Channel, Transitions, TransitionSpec


def normal(seed: int, rows: int, channels: int) -> torch.Tensor:
    return torch.randn(rows, channels, generator=torch.Generator().manual_seed(seed))


def test_energy_distance_is_scipys_in_one_dimension() -> None:
    x, y = normal(0, 300, 1), 1.3 * normal(1, 200, 1) + 0.4
    wanted = of_scipy(x[:, 0].numpy(), y[:, 0].numpy()) ** 2
    assert energy_distance(x, y) == pytest.approx(wanted, rel=1e-4)
    assert energy_distance(x, x) == pytest.approx(0.0, abs=1e-6)


def transitions(effect: float, seed: int, rows: int = 1500) -> Transitions:
    """One channel that moves by a force whose size follows o; ``effect`` is the domain's."""
    rng = np.random.default_rng(seed)
    o, a, force = (rng.normal(size=(rows, 1)) for _ in range(3))
    s_next = o + 0.01 * a + 0.02 * effect * force * (1 + np.tanh(o))
    steps = np.arange(rows)
    return Transitions(o=o, a=a, s_next=s_next, nominal=o, hidden=force, episode=steps // 50,
                       step=steps % 50)  # fmt: skip


def answered(real: Transitions, factor: torch.Tensor) -> torch.Tensor:
    """Next states of which the force's part is so many times what it was."""
    o, a, s_next = (torch.tensor(x) for x in (real.o, real.a, real.s_next))
    return o + 0.01 * a + factor * (s_next - o - 0.01 * a)


def test_the_translation_with_rs_effect_is_nearest() -> None:
    held = Unpaired(transitions(1.0, 0), transitions(0.7, 1))
    source = held.translated.real
    tried = (0.4, 0.55, 0.7, 0.85, 1.0)
    errors = [held.error(answered(source, torch.tensor(f))) for f in tried]
    assert tried[int(np.argmin(errors))] == 0.7
    assert errors[-1] > 3 * errors[2] > 0


def test_what_is_wrong_at_every_o_is_farther_though_right_on_average() -> None:
    held = Unpaired(transitions(1.0, 0), transitions(0.7, 1))
    right = answered(held.translated.real, torch.tensor(0.7))
    biased = right + 0.02 * torch.tensor(held.translated.real.o)
    assert held.error(biased) > 3 * held.error(right)


def test_where_the_domains_go_does_not_count() -> None:
    # S and R are one machine, and S goes elsewhere
    def machine(seed: int, off: float) -> Transitions:
        data = transitions(0.7, seed)
        o = data.o + np.float32(off)
        move = 0.5 * o + 0.1 * (data.s_next - data.o)
        return replace(data, o=o, s_next=o + move)

    same, gap = (
        Unpaired(machine(0, 3.0), data)
        for data in (machine(1, 0.0), replace(machine(1, 0.0), s_next=1.2 * machine(1, 0.0).s_next))
    )
    errors = [held.error(torch.tensor(held.translated.sim_next)) for held in (same, gap)]
    assert errors[0] < 0.1 * errors[1]


def test_which_event_it_was_is_not_seen() -> None:
    # a mirrored force has the same distribution: what only pairs could tell
    held = Unpaired(transitions(1.0, 0), transitions(0.7, 1))
    right, mirrored, untranslated = (
        held.error(answered(held.translated.real, torch.tensor(f))) for f in (0.7, -0.7, 1.0)
    )
    assert abs(mirrored - right) < 0.2 * (untranslated - right)


def test_a_channel_that_never_moves_has_no_say() -> None:
    sim, real = transitions(1.0, 0), transitions(0.7, 1)
    still = [replace(d, o=np.hstack([d.o, np.full_like(d.o, 3.0)])) for d in (sim, real)]
    held = Unpaired(*still)
    plain = Unpaired(sim, real)
    found, wanted = (h.error(torch.tensor(h.translated.sim_next)) for h in (held, plain))
    assert found == pytest.approx(wanted, rel=1e-3)


def test_distance_is_that_of_what_regressions_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selection, "ROWS", 10_000)
    monkeypatch.setattr(selection, "FEATURES", 0)
    toy = Toy(0.0)
    sim, real = toy.collect(SIM, 5, 1), toy.collect(REAL, 5, 2)
    (x_sim, sim_change), (x, change) = (
        (np.hstack([d.o, d.a, np.ones((len(d), 1))]).astype(float), d.s_next - d.o[:, :4])
        for d in (sim, real)
    )
    half = len(x) // 2
    first, second = (
        np.linalg.lstsq(x[rows], change[rows], rcond=None)[0]
        for rows in (slice(0, half), slice(half, None))
    )
    left = np.vstack([change[:half] - x[:half] @ second, change[half:] - x[half:] @ first])
    unit = left.std(axis=0)
    a, b = (sim_change - x_sim @ (first + second) / 2) / unit, left / unit
    wanted = 2 * cdist(a, b).mean() - cdist(a, a).mean() - cdist(b, b).mean()
    held = Unpaired(sim, real)
    assert held.error(torch.tensor(held.translated.sim_next)) == pytest.approx(wanted, rel=1e-3)


def test_what_a_walk_tells_in_no_straight_line_is_told() -> None:
    # outcomes that bend with o, which a straight line would leave as if it were hidden
    def bent(effect: float, seed: int) -> Transitions:
        data = transitions(effect, seed, 6000)
        return replace(data, s_next=data.s_next + 0.3 * np.sin(2.0 * data.o).astype(np.float32))

    held = Unpaired(bent(1.0, 0), bent(0.7, 1))
    given = held.translated.real
    plain = replace(given, s_next=given.s_next - 0.3 * np.sin(2.0 * given.o).astype(np.float32))
    tried = (0.4, 0.7, 1.0)
    errors = [
        held.error(answered(plain, torch.tensor(f)) + 0.3 * torch.sin(2.0 * torch.tensor(given.o)))
        for f in tried
    ]
    assert errors[0] > 3 * errors[1] < 3 * errors[2]


def test_pairs_measure_the_squared_error() -> None:
    pairs, scale = Toy(0.0).pairs(2, 3), np.array([1.0, 2.0, 0.5, 4.0])
    gap = (pairs.sim_next.astype(float) - pairs.real.s_next) / scale
    found = Paired(pairs, scale).error(torch.tensor(pairs.sim_next))
    assert found == pytest.approx((gap**2).mean(), rel=1e-5)


def test_whole_episodes_are_held_out_from_the_end() -> None:
    data = transitions(1.0, 0, 1000)
    kept, held = hold_out(data, 0.12)  # 120 rows would begin inside an episode
    assert (len(kept), len(held)) == (900, 100)
    assert set(kept.episode).isdisjoint(held.episode)
    np.testing.assert_array_equal(np.vstack([kept.o, held.o]), data.o)


def test_of_one_long_episode_its_end_is_held_out() -> None:
    data = replace(transitions(1.0, 0, 1000), episode=np.zeros(1000, int), step=np.arange(1000))
    kept, held = hold_out(data, 0.1)
    assert (len(kept), len(held)) == (900, 100)


@pytest.mark.parametrize(("rows", "share"), [(1000, 0.12), (1000, 0.02), (980, 0.3), (1000, 0.1)])
def test_on_disk_the_same_is_held_out(rows: int, share: float, tmp_path: Path) -> None:
    data = transitions(1.0, 0, rows)
    channels = (Channel("qpos/j", "rad"),)
    spec = TransitionSpec("toy", 50.0, ("j",), channels, 1, channels, channels)
    shards = [Shard(f"part-{k:03d}.parquet", k, 200) for k in range(5)]

    def part(shard: Shard) -> Transitions:
        return data.select(np.arange(shard.seed * 200, min(rows, shard.seed * 200 + 200)))

    home = ensure(tmp_path, {"what": "sim"}, spec, shards, each(part))
    stored = Stored.of([home / shard.file for shard in shards], spec)
    kept, held = hold_out(data, share)
    streamed, held_on_disk = hold_out_stored(stored, share)
    np.testing.assert_array_equal(held_on_disk.o, held.o)
    parts = [streamed.read(k).o for k in range(len(streamed.groups))]
    np.testing.assert_array_equal(np.concatenate(parts), kept.o)


def test_other_data_have_another_hash() -> None:
    sim, real, other = (transitions(1.0, seed, 100) for seed in range(3))
    hashes = {Unpaired(*pair).hash for pair in ((sim, real), (sim, other), (other, real))}
    assert len(hashes) == 3
