from __future__ import annotations

from itertools import islice

import numpy as np
import torch

from tests.train.conftest import World
from wt.config import Mean
from wt.nets.frame import Frame
from wt.train.batches import DomainData, Held, StepBatch, StepBatches, in_frame
from wt.train.mean_field import fit_normalizers


def numbered(n: int, offset: int) -> Held[DomainData]:
    """Rows that carry their own number."""
    rows = torch.arange(offset, offset + n, dtype=torch.float32)[:, None]
    return Held(DomainData(rows, 2 * rows, 3 * rows))


def batches(seed: int) -> StepBatches:
    return StepBatches(numbered(500, 0), numbered(300, 1000), 32, 4, seed)


def same(one: StepBatch, other: StepBatch) -> bool:
    def flat(batch: StepBatch) -> list[torch.Tensor]:
        return [t for side in (*batch.vae, *batch.gan) for t in side] + [batch.noise]

    return all(torch.equal(a, b) for a, b in zip(flat(one), flat(other), strict=True))


def test_a_step_is_a_pure_function_of_seed_and_number() -> None:
    forwards, backwards = batches(3), batches(3)
    torch.manual_seed(5)
    there = [forwards.at(k) for k in range(6)]
    torch.manual_seed(6)
    back = [backwards.at(k) for k in reversed(range(6))]
    assert all(same(a, b) for a, b in zip(there, reversed(back), strict=True))
    assert not same(there[0], there[1])
    # another seed sees others: neither the same ones nor the same ones a step apart
    assert not any(same(batch, batches(4).at(0)) for batch in there)


def test_iteration_starts_at_the_next_step() -> None:
    start = batches(3)
    start.next_step = 7
    seen = list(islice(start, 3))
    assert [batch.step for batch in seen] == [7, 8, 9]
    assert all(same(batch, batches(3).at(batch.step)) for batch in seen)


def test_domains_keep_apart_and_rows_together() -> None:
    batch = batches(0).at(0)
    for sim, real in (batch.vae, batch.gan):
        assert sim.x.min() >= 0 and sim.x.max() < 500
        assert real.x.min() >= 1000 and real.x.max() < 1300
        for side in (sim, real):
            assert torch.equal(side.y, 2 * side.x) and torch.equal(side.s_next, 3 * side.x)
    # translation draws a batch of its own (Algorithm 1 samples twice)
    assert not torch.equal(batch.vae[0].x, batch.gan[0].x)


def test_all_rows_are_drawn_and_noise_is_standard_normal() -> None:
    source = batches(0)
    many = [source.at(k) for k in range(300)]
    assert len(torch.unique(torch.cat([b.vae[0].x for b in many]))) == 500
    noise = torch.cat([b.noise.flatten() for b in many])
    assert abs(float(noise.mean())) < 0.02 and abs(float(noise.std()) - 1) < 0.02


def test_papers_frame_is_the_change_of_both_domains(world: World) -> None:
    frame = Frame(world.spec, Mean())
    fit_normalizers(frame, world.sim, world.real)
    both = np.concatenate([d.s_next - d.o[:, :4] for d in (world.sim, world.real)])
    scale = both.astype(np.float64).std(axis=0)
    for got, data in zip(in_frame(frame, world.sim, world.real), (world.sim, world.real),
                         strict=True):  # fmt: skip
        expected = (data.s_next - data.o[:, :4]) / scale
        np.testing.assert_allclose(got.y, expected, rtol=1e-4, atol=1e-5)
        real = world.real.s_next
        expected = (data.s_next - real.mean(axis=0)) / real.std(axis=0)
        np.testing.assert_allclose(got.s_next, expected, rtol=1e-3, atol=1e-4)


class Constant(torch.nn.Module):
    """A regressor that gives the same answer everywhere."""

    def __init__(self, value: float) -> None:
        super().__init__()
        self.value = value

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.full((len(x), 4), self.value)


def test_with_a_mean_field_only_what_it_leaves_is_left(world: World) -> None:
    frame = Frame(world.spec, Mean(kind="average", width=8, depth=1))
    fit_normalizers(frame, world.sim, world.real)
    frame.nominal, frame.shift = Constant(7.0), Constant(0.5)  # 7: the exact one is used instead
    frame.transport.copy_(torch.diag(torch.tensor([1.0, 2.0, 3.0, 4.0])))
    sim, real = in_frame(frame, world.sim, world.real)
    scale = frame.change.std.numpy()
    beyond = [(d.s_next - d.nominal) / scale for d in (world.sim, world.real)]
    np.testing.assert_allclose(sim.y, beyond[0] * [1, 2, 3, 4], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(real.y, beyond[1] - 0.5, rtol=1e-4, atol=1e-4)


def test_beyond_an_average_answer_is_beyond_that_average(world: World) -> None:
    """As in use, where the simulator's own outcome is all that is known beside (o, a)."""
    frame = Frame(world.spec, Mean(kind="average", simulator="mean", width=8, depth=1))
    fit_normalizers(frame, world.sim, world.real)
    frame.nominal, frame.shift = Constant(0.7), Constant(0.5)
    sim, real = in_frame(frame, world.sim, world.real)
    changes = [
        frame.changes(torch.tensor(d.o), torch.tensor(d.s_next)) for d in (world.sim, world.real)
    ]
    torch.testing.assert_close(sim.y, changes[0] - 0.7)
    torch.testing.assert_close(real.y, changes[1] - 1.2)
