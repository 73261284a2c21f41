"""Streamed batches: reproducible from seed and step, of all transitions, in bounded memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.baselines.toy import Toy
from tests.data.test_transitions import each
from tests.train.conftest import World
from wt.config import Mean, Method, SimulatorUseName, TranslationConfig
from wt.data.stored import Stored, Streams
from wt.data.transitions import Shard, ensure
from wt.nets.world_model import WorldModel
from wt.train import fit as training
from wt.train.batches import DomainData, Drawn, StepBatches, framed
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.mean_field import fit_normalizers
from wt.train.selection import Unpaired
from wt.train.streamed import ANSWERED, DRAWS, StreamedInFrame, lessons
from wt.types import Domain, Transitions

PARTS, ROWS, BATCH = 10, 120, 60
"""Shards of a domain, transitions of each, and of a batch."""


def stored(world: World, domain: Domain, folder: Path) -> Stored:
    """A domain of the toy in shards of two episodes."""
    data = world.sim if domain == "sim" else world.real
    assert len(data) == PARTS * ROWS
    shards = [Shard(f"part-{k:03d}.parquet", k, ROWS) for k in range(PARTS)]

    def rows(shard: Shard) -> Transitions:
        return data.select(np.arange(shard.seed * ROWS, (shard.seed + 1) * ROWS))

    home = ensure(folder, {"what": domain}, world.spec, shards, each(rows))
    return Stored.of([home / shard.file for shard in shards], world.spec)


@pytest.fixture
def on_disk(world: World, tmp_path: Path) -> Streams:
    """Both domains, of which memory holds a third."""
    of_sim, of_real = (stored(world, domain, tmp_path / "data") for domain in ("sim", "real"))  # type: ignore[arg-type]
    return Streams(of_sim, of_real, 3 * ROWS)


@pytest.fixture
def model(world: World, paper: Method) -> WorldModel:
    made = WorldModel(world.spec, paper)
    fit_normalizers(made.frame, world.sim, world.real)
    return made


def streamed(
    on_disk: Streams, model: WorldModel, domain: Domain = "real", seed: int = 5
) -> StreamedInFrame:
    data = on_disk.sim if domain == "sim" else on_disk.real
    assert data is not None
    return StreamedInFrame(
        data, model.frame, domain, in_memory=on_disk.in_memory, batch=BATCH, reach=0.0, seed=seed
    )


def same(one: DomainData, other: DomainData) -> bool:
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


def groups_in(buffer: DomainData, whole: DomainData) -> list[int]:
    """Which of the collection's row groups a buffer holds, in order."""
    (places,) = torch.nonzero((whole.x[None] == buffer.x[:, None]).all(dim=2))[:, 1:].T
    assert len(places) == len(buffer.x)
    assert same(buffer, whole.rows(places))
    starts = places[::ROWS]
    assert torch.equal(places, (starts[:, None] + torch.arange(ROWS)).flatten())
    return [int(start) // ROWS for start in starts]


def test_the_buffer_of_a_step_does_not_depend_on_the_steps_before(
    on_disk: Streams, model: WorldModel
) -> None:
    forwards = streamed(on_disk, model)
    for step in range(0, 120, 4):
        assert same(forwards.at(step), streamed(on_disk, model).at(step)), step
    assert same(forwards.at(3), streamed(on_disk, model).at(0))  # and back
    assert not same(forwards.at(0), streamed(on_disk, model, seed=6).at(0))


def test_row_groups_come_and_go_one_by_one_and_each_once_an_epoch(
    on_disk: Streams, model: WorldModel, world: World
) -> None:
    source, whole = streamed(on_disk, model), framed(model.frame, world.real, "real")
    every = DRAWS * ROWS // (2 * BATCH)
    held = [groups_in(source.at(step), whole) for step in range(0, 30 * every, every)]
    assert all(len(groups) == 3 for groups in held)  # a third of ten
    assert all(before[1:] == after[:-1] for before, after in pairwise(held))
    came = held[0] + [groups[-1] for groups in held[1:]]
    epochs = [came[:10], came[10:20], came[20:30]]
    assert all(sorted(epoch) == list(range(10)) for epoch in epochs)
    assert epochs[0] != epochs[1] != epochs[2]
    assert same(source.at(every - 1), streamed(on_disk, model).at(0))  # between moves it stays


def test_each_transition_is_drawn_as_often_as_is_said(
    on_disk: Streams, model: WorldModel, world: World
) -> None:
    """In an epoch from memory it would be so often as well."""
    batches = StepBatches(
        streamed(on_disk, model, "sim"), streamed(on_disk, model), BATCH, 4, seed=5
    )
    steps = PARTS * DRAWS * ROWS // (2 * BATCH)
    drawn = torch.cat(
        [d.x for k in range(steps) for d in (batches.at(k).vae[1], batches.at(k).gan[1])]
    )
    whole = framed(model.frame, world.real, "real").x
    _, counts = torch.unique(torch.cat([whole, drawn]), dim=0, return_counts=True)
    assert len(counts) == PARTS * ROWS  # all of them could be, and no other
    assert len(drawn) == pytest.approx(DRAWS * len(whole))
    # two epochs' beginnings and ends are in the buffer for fewer steps, or more
    assert float((counts > 1).float().mean()) > 0.95


def test_where_the_buffer_holds_all_a_batch_is_of_all(
    on_disk: Streams, model: WorldModel, world: World
) -> None:
    source = streamed(on_disk._replace(in_memory=PARTS * ROWS), model)
    held = groups_in(source.at(0), framed(model.frame, world.real, "real"))
    assert sorted(held) == list(range(PARTS))


def test_what_is_out_of_reach_is_not_streamed(on_disk: Streams, model: WorldModel) -> None:
    assert on_disk.real is not None
    limited = StreamedInFrame(
        on_disk.real, model.frame, "real", in_memory=3 * ROWS, batch=BATCH, reach=2.0, seed=5
    )
    for step in (0, 40, 48):
        everything, near = streamed(on_disk, model).at(step), limited.at(step)
        assert same(near, everything.rows(everything.x.abs().amax(dim=1) <= 2.0))
        assert 0 < len(near.x) < len(everything.x)


def curve(
    world: World, method: Method, on_disk: Streams, folder: Path, stop_at: int | None = None
) -> dict[int, dict[str, float]]:
    """Metrics by step of a loop that streams, without its mean field's; it can be killed."""
    seen: dict[int, dict[str, float]] = {}

    def sink(values: Mapping[str, float], step: int) -> None:
        seen.setdefault(step, {}).update(values)
        if step == stop_at:
            raise ConnectionError("killed")

    few = np.arange(2 * ROWS)
    sim, real = world.sim.select(few), world.real.select(few)
    fit_world_model(
        TrainingInput(world.spec, method, sim, real, world.selection, 0, folder, streams=on_disk),
        sink=sink,
    )
    return {step: values for step, values in seen.items() if "vae/kl" in values}


@pytest.mark.parametrize("which", ["paper", "plus"])
def test_a_killed_and_resumed_training_goes_on_on_the_same_stream(
    which: str, world: World, on_disk: Streams, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    method = request.getfixturevalue(which)
    whole = curve(world, method, on_disk, tmp_path / "a")
    with pytest.raises(ConnectionError):
        curve(world, method, on_disk, tmp_path / "b", stop_at=25)
    resumed = curve(world, method, on_disk, tmp_path / "b")
    assert sorted(resumed) == [25, 30, 35, 40]  # the buffer moves every seven steps
    assert all(whole[step] == values for step, values in resumed.items())
    # it is the stream that is trained on, not the sample
    from_sample = curve(world, method, Streams(), tmp_path / "c")
    assert all(whole[step]["vae/kl"] != from_sample[step]["vae/kl"] for step in whole)


@pytest.mark.long
def test_the_curve_is_the_same_on_one_and_two_processes(
    world: World, paper: Method, on_disk: Streams, tmp_path: Path
) -> None:
    alone = curve(world, paper, on_disk, tmp_path / "one")
    two = replace(paper, train=replace(paper.train, devices=2))
    together = curve(world, two, on_disk, tmp_path / "two")
    assert sorted(alone) == sorted(together)
    for step, values in alone.items():
        for name in ("vae/reconstruction", "gan/generator", "vae/domain_bce"):
            assert together[step][name] == pytest.approx(values[name], rel=1e-4, abs=1e-7)


def test_one_domain_may_stream_alone(
    world: World, paper: Method, on_disk: Streams, tmp_path: Path
) -> None:
    seen = curve(world, paper, on_disk._replace(sim=None), tmp_path)
    assert sorted(seen) == list(range(5, 45, 5))


@pytest.mark.parametrize("simulator", ["encoded", "blend"])
def test_a_mean_field_learns_from_the_stream(
    simulator: SimulatorUseName, world: World, paper: Method, on_disk: Streams, tmp_path: Path
) -> None:
    mean = Mean(kind="average", simulator=simulator, width=8, depth=1, steps=160, batch=BATCH)
    translation = TranslationConfig(anchored=True)
    method = replace(paper, mean=mean, translation=translation)
    held = world.sim.select(np.arange(ROWS)), world.real.select(np.arange(ROWS))

    def learned(streams: Streams, folder: str) -> list[torch.Tensor]:
        few = np.arange(2 * ROWS)
        sample = world.sim.select(few), world.real.select(few)
        made = fit_world_model(
            TrainingInput(
                world.spec,
                method,
                *sample,
                Unpaired(*held),
                0,
                tmp_path / folder,
                simulator=Toy(0.0),
                streams=streams,
            )
        )
        return [p for p in made.frame.parameters() if p.ndim]

    streamed, again = learned(on_disk, "a"), learned(on_disk, "b")
    assert all(torch.equal(x, y) for x, y in zip(streamed, again, strict=True))
    sampled = learned(Streams(), "c")
    assert not any(torch.equal(x, y) for x, y in zip(streamed, sampled, strict=True))
    whole = learned(on_disk._replace(in_memory=PARTS * ROWS), "d")
    assert not any(torch.equal(x, y) for x, y in zip(streamed, whole, strict=True))


def test_regressions_go_on_along_the_stream_and_s_answers_what_comes(
    world: World, paper: Method, on_disk: Streams
) -> None:
    mean = Mean(kind="average", simulator="encoded", batch=BATCH)
    model = WorldModel(world.spec, replace(paper, mean=mean))
    fit_normalizers(model.frame, world.sim, world.real)
    answered: list[int] = []

    def answers(group: Transitions) -> Transitions:
        answered.append(len(group))
        return replace(group, nominal=group.s_next)

    _, source = lessons(model, world.sim, world.real, on_disk, 5, answers)
    every = ANSWERED * ROWS // BATCH
    buffers = [source.at(step) for step in range(0, 5 * every, every)]
    assert answered == [ROWS] * (3 + 4)  # no group twice
    for buffer in buffers:
        torch.testing.assert_close(buffer.nominal, buffer.change)
    assert all(torch.equal(before.x[ROWS:], after.x[:-ROWS]) for before, after in pairwise(buffers))


def test_algorithm_1_has_the_sample_of_r_where_s_answers_once_more(
    world: World,
    paper: Method,
    on_disk: Streams,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Streams] = []

    def asking(*given: object) -> tuple[Drawn, Drawn]:
        asked.extend(x for x in given if isinstance(x, Streams))
        raise ConnectionError("asked")

    monkeypatch.setattr(training, "drawn", asking)
    mean = Mean(kind="average", simulator="encoded", width=8, depth=1, steps=5, batch=16)
    for method in (paper, replace(paper, mean=mean)):
        with pytest.raises(ConnectionError, match="asked"):
            fit_world_model(
                TrainingInput(
                    world.spec,
                    method,
                    world.sim,
                    world.real,
                    world.selection,
                    0,
                    tmp_path / method.mean.simulator,
                    simulator=Toy(0.0),
                    streams=on_disk,
                )
            )
    assert asked == [on_disk, on_disk._replace(real=None)]
