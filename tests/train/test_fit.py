from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.baselines.toy import REAL, SIM, Toy
from tests.train.conftest import World
from wt.config import Mean, Method, TranslationConfig, Vae
from wt.errors import ConfigError, WorkError
from wt.nets.world_model import WorldModel
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.score import PairTensors, errors, predictions, score
from wt.train.selection import Unpaired
from wt.types import Pairs, Transitions


class Sink:
    """Keeps all metrics; can end the run from inside, as a kill would."""

    def __init__(self, stop_at: int | None = None, error: BaseException | None = None) -> None:
        self.seen: dict[int, dict[str, float]] = {}
        self._stop_at, self._error = stop_at, error or ConnectionError("killed")

    def __call__(self, values: Mapping[str, float], step: int) -> None:
        self.seen.setdefault(step, {}).update(values)
        if step == self._stop_at:
            raise self._error

    def curve(self, name: str) -> list[float]:
        return [values[name] for values in self.seen.values() if name in values]


def fit(world: World, method: Method, folder: Path, sink: Sink, seed: int = 0) -> WorldModel:
    return fit_world_model(
        TrainingInput(world.spec, method, world.sim, world.real, world.selection, seed, folder),
        sink=sink,
    )


@pytest.fixture(scope="module")
def undisturbed(
    world: World, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[Method], tuple[WorldModel, Sink]]:
    """A method's whole training, and what its sink saw; once for all tests."""
    kept: dict[str, tuple[WorldModel, Sink]] = {}

    def of(method: Method) -> tuple[WorldModel, Sink]:
        if repr(method) not in kept:
            sink = Sink()
            kept[repr(method)] = fit(world, method, tmp_path_factory.mktemp("whole"), sink), sink
        return kept[repr(method)]

    return of


def same(one: WorldModel, other: WorldModel) -> bool:
    a, b = one.state_dict(), other.state_dict()
    return a.keys() == b.keys() and all(torch.equal(a[k], b[k]) for k in a)


@pytest.mark.parametrize("which", ["paper", "plus"])
@pytest.mark.parametrize("killed_at", [5, 25])
def test_a_killed_and_resumed_run_ends_in_the_same_model(
    which: str,
    killed_at: int,
    world: World,
    undisturbed: Callable[[Method], tuple[WorldModel, Sink]],
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    method = request.getfixturevalue(which)
    uninterrupted, whole = undisturbed(method)
    first, second = Sink(stop_at=killed_at), Sink()
    with pytest.raises(ConnectionError):
        fit(world, method, tmp_path / "b", first)
    resumed = fit(world, method, tmp_path / "b", second)
    assert same(uninterrupted, resumed)
    # it goes on from the last validation, not from the start, and sees what it would have seen
    done = killed_at // 10 * 10
    assert min(second.seen) == done + 5
    assert all(whole.seen[step] == values for step, values in second.seen.items())


def test_another_seed_gives_another_model(
    world: World,
    undisturbed: Callable[[Method], tuple[WorldModel, Sink]],
    paper: Method,
    folder: Path,
) -> None:
    assert not same(undisturbed(paper)[0], fit(world, paper, folder, Sink(), seed=1))


def test_a_resumed_run_loses_nothing_though_the_error_had_stopped_falling(
    world: World, paper: Method, folder: Path
) -> None:
    # a learning rate that ruins the model: the best checkpoint is the first
    train = replace(paper.train, learning_rate=0.3, steps=40)
    sink, again = Sink(stop_at=35), Sink()
    with pytest.raises(ConnectionError):
        fit(world, replace(paper, train=train), folder, sink)
    fit(world, replace(paper, train=train), folder, again)
    assert sorted(again.seen) == [35, 40]


def test_a_finished_run_is_not_trained_again(world: World, plus: Method, folder: Path) -> None:
    first, sink = fit(world, plus, folder, Sink()), Sink()
    assert same(first, fit(world, plus, folder, sink))
    assert sink.seen == {}


def test_ctrl_c_stays_ctrl_c(world: World, paper: Method, folder: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        fit(world, paper, folder, Sink(stop_at=15, error=KeyboardInterrupt()))
    assert signal.getsignal(signal.SIGINT) is before
    assert (folder / "last.ckpt").exists()


@pytest.mark.parametrize(("log_every", "found_at"), [(5, 5), (100, 10)])
def test_divergence_is_one_line_and_no_checkpoint(
    log_every: int, found_at: int, world: World, paper: Method, folder: Path
) -> None:
    wild = replace(paper, train=replace(paper.train, learning_rate=1e30, log_every=log_every))
    message = rf"diverged at step {found_at}: .*learning_rate"
    with pytest.raises(WorkError, match=message) as error:
        fit(world, wild, folder, Sink())
    assert "\n" not in str(error.value)
    assert not list(folder.glob("*.ckpt"))


def test_a_silent_latent_is_reported(world: World, paper: Method, folder: Path) -> None:
    # so heavy a prior that z carries nothing
    train = replace(paper.train, steps=120, validate_every=120, log_every=1, learning_rate=0.02)
    method = replace(paper, vae=Vae(beta=100.0), train=train)
    sink = Sink()
    said: list[str] = []
    fit_world_model(
        TrainingInput(world.spec, method, world.sim, world.real, world.selection, 0, folder),
        sink=sink,
        warn=said.append,
    )
    assert len(said) == 1 and "latent went silent" in said[0]
    assert sink.curve("collapsed") == [1.0]


def test_everything_worth_watching_arrives(
    undisturbed: Callable[[Method], tuple[WorldModel, Sink]], plus: Method
) -> None:
    _, sink = undisturbed(plus)
    fields = {"val/shift", "val/nominal", "val/reader"}  # of the mean field's regressions before
    assert any(fields & set(values) for values in sink.seen.values())
    loop = {step: left for step, x in sink.seen.items() if (left := set(x) - fields)}
    assert sorted(loop) == list(range(5, 45, 5))
    watched = {
        "gradient/vae", "gradient/blind", "gradient/generators", "gradient/judges",
        "gan/accuracy", "gan/cycle", "vae/domain_accuracy", "vae/blind_error",
        "latent/mean_norm", "latent/active_std", "latent/active", "latent/noise_std",
    }  # fmt: skip
    for step, values in ((step, sink.seen[step]) for step in loop):
        assert watched <= set(values), step
        assert all(np.isfinite(v) for v in values.values()), step
        for name in ("val/mse", "val/self_reconstruction", "val/untranslated"):
            assert (name in values) == (step % 10 == 0), step
        assert values["gradient/vae"] > 0 and 0 <= values["gan/accuracy"] <= 1


def test_metrics_arrive_once(world: World, paper: Method, folder: Path) -> None:
    arrived: list[tuple[int, str]] = []
    fit_world_model(
        TrainingInput(world.spec, paper, world.sim, world.real, world.selection, 0, folder),
        sink=lambda values, step: arrived.extend((step, name) for name in values),
    )
    assert len(arrived) == len(set(arrived)) > 8 * 19


def test_the_checkpoint_with_the_lowest_validation_error_is_chosen(
    world: World, paper: Method, folder: Path
) -> None:
    sink = Sink()
    model = fit(world, paper, folder, sink)
    curve = sink.curve("val/mse")
    assert len(set(curve)) == len(curve) == 4
    std = torch.tensor(world.real.s_next.astype(float).std(axis=0))
    mse, _ = errors(model, PairTensors.of(world.pairs, std, torch.ones(4)))
    assert mse == pytest.approx(min(curve), rel=1e-4)
    assert not model.training


def test_selection_without_pairs_takes_the_last_checkpoint_and_needs_no_pairs(
    world: World, plus: Method, folder: Path
) -> None:
    sink, toy = Sink(), Toy(0.0)
    held = toy.collect(SIM, 10, 7), toy.collect(REAL, 10, 8)
    model = fit_world_model(
        TrainingInput(world.spec, plus, world.sim, world.real, Unpaired(*held), 0, folder),
        sink=sink,
    )
    assert "val/mse" not in {name for values in sink.seen.values() for name in values}
    curve = sink.curve("val/energy_distance")
    assert curve.index(min(curve)) < len(curve) - 1, "the lowest is another: nothing is tested"
    assert score(model, Unpaired(*held)) == pytest.approx(curve[-1], rel=1e-4)


def test_validation_pairs_train_nothing(world: World, paper: Method, tmp_path: Path) -> None:
    # one look at the end: whatever the pairs are, the same model comes out
    method = replace(paper, train=replace(paper.train, validate_every=40))
    other = replace(world, pairs=Toy(0.0).pairs(5, 99))
    assert same(*(fit(w, method, tmp_path / n, Sink()) for w, n in ((world, "a"), (other, "b"))))


def test_progress_covers_mean_field_and_loop(world: World, plus: Method, folder: Path) -> None:
    told: list[tuple[int, int]] = []
    method = replace(plus, mean=replace(plus.mean, steps=100))
    fit_world_model(
        TrainingInput(world.spec, method, world.sim, world.real, world.selection, 0, folder),
        progress=lambda done, total: told.append((done, total)),
    )
    assert [done for done, _ in told] == [*range(1, 301), *range(305, 345, 5)]
    assert {total for _, total in told} == {340}


def same_machine(strength: float) -> tuple[Transitions, Transitions, Pairs]:
    """S, and an R that only differs in how strong its hidden force is.

    Whatever matches the distributions is wrong for every single transition.
    """
    quiet = Toy(0.0).collect(SIM, 40, 1)
    force = strength * np.random.default_rng(0).normal(size=quiet.hidden.shape)
    o, a = quiet.o.astype(float), quiet.a.astype(float)
    loud = replace(quiet, s_next=SIM.step(o[:, :4], a, force), hidden=force)
    return quiet, loud, Pairs(loud, loud.s_next)


def test_translation_that_hurts_is_not_applied(paper: Method, folder: Path) -> None:
    train = replace(paper.train, steps=60, validate_every=20, gan_learning_rate=3e-3)
    method = replace(paper, translation=TranslationConfig(anchored=True), train=train)
    sink = Sink()
    model = fit(World(Toy(0.0).spec, *same_machine(3.0)), method, folder, sink)
    assert min(sink.curve("val/mse")) > 0  # in full strength it does harm
    assert float(model.strength) == 0.0


MEAN = Mean(kind="average", width=32, depth=1, steps=300, batch=256)


def transport(
    method: Method, folder: Path, sim: Transitions, real: Transitions, pairs: Pairs
) -> tuple[np.ndarray, np.ndarray]:
    """The chosen map, and the unit of each channel."""
    translation = TranslationConfig(conditioned=True, transport=True, anchored=True)
    train = replace(method.train, steps=10)
    method = replace(method, mean=MEAN, translation=translation, train=train)
    model = fit(World(Toy(0.0).spec, sim, real, pairs), method, folder, Sink())
    return model.frame.transport.numpy(), model.frame.change.std.numpy()


def test_transport_that_hurts_is_not_applied(paper: Method, folder: Path) -> None:
    found, _ = transport(paper, folder, *same_machine(3.0))
    assert np.array_equal(found, np.eye(4))


def test_transport_that_helps_is_the_ratio_of_the_effects(paper: Method, folder: Path) -> None:
    # R answers a force with 1 / 1.4 of what S does, in the same direction of (q, v)
    toy = Toy(0.0)
    data = toy.collect(SIM, 40, 1), toy.collect(REAL, 40, 2), toy.pairs(20, 3)
    found, unit = transport(paper, folder, *data)
    for joint in (0, 1):
        effect = np.zeros(4)
        effect[[joint, joint + 2]] = SIM.effect() / unit[[joint, joint + 2]]
        np.testing.assert_allclose(effect @ found, effect / 1.4, atol=0.06 * np.abs(effect).max())


def test_of_an_average_answer_only_such_a_share_is_taken_as_helps(
    paper: Method, folder: Path
) -> None:
    # what S says of the hidden variable has nothing to do with R's: another seed's noise
    toy, rng = Toy(0.0), np.random.default_rng(0)
    sim, real, pairs = toy.collect(SIM, 40, 1), toy.collect(REAL, 40, 2), toy.pairs(20, 3)
    noise = rng.standard_normal(pairs.sim_next.shape) * sim.s_next.std(axis=0)
    method = replace(
        paper,
        mean=replace(MEAN, simulator="mean"),
        translation=TranslationConfig(conditioned=True, transport=True, anchored=True),
        train=replace(paper.train, steps=10),
    )
    world = World(toy.spec, sim, real, Pairs(pairs.real, pairs.sim_next + noise))
    found = fit(world, method, folder, Sink()).frame.transport.numpy()
    assert np.abs(found).max() < 0.3


def test_each_channel_is_read_off_the_simulator_as_far_as_it_helps(
    paper: Method, folder: Path
) -> None:
    # S says one joint's velocity exactly, what is hidden included, and the other's not at all
    toy, rng = Toy(0.0), np.random.default_rng(0)
    sim, real, other = (toy.collect(SIM, 40, seed) for seed in (1, 2, 3))
    sim_next = other.s_next.copy()
    sim_next[:, 3] += rng.standard_normal(len(sim_next)) * 2.0 * sim.s_next[:, 3].std()
    pairs = Pairs(other, sim_next)
    unit = torch.ones(toy.spec.n_state)
    error = {}
    for simulator in ("mean", "blend"):
        method = replace(
            paper,
            mean=replace(MEAN, simulator=simulator, steps=400),
            translation=TranslationConfig(conditioned=True, transport=True, anchored=True),
            train=replace(paper.train, steps=10),
        )
        model = fit(World(toy.spec, sim, real, pairs), method, folder / simulator, Sink())
        error[simulator] = errors(model, PairTensors.of(pairs, unit, unit))[0]
    trusted = model.frame.trusted
    assert trusted[2] > 0.5
    assert trusted[3] < 0.1
    assert error["blend"] < error["mean"]


def test_where_domains_are_one_the_simulator_s_answer_is_left_as_it_is(
    paper: Method, folder: Path
) -> None:
    toy = Toy(0.0)
    sim, real, other = (toy.collect(SIM, 20, seed) for seed in (1, 2, 3))
    method = replace(
        paper,
        mean=replace(MEAN, simulator="mean"),
        translation=TranslationConfig(conditioned=True, transport=True, anchored=True),
        train=replace(paper.train, steps=10),
    )
    pairs = Pairs(other, other.s_next)
    model = fit(World(toy.spec, sim, real, pairs), method, folder, Sink())
    unit = torch.ones(toy.spec.n_state)
    assert errors(model, PairTensors.of(pairs, unit, unit))[0] < 1e-9


def encoded(paper: Method) -> Method:
    return replace(
        paper,
        mean=replace(MEAN, simulator="encoded", steps=400),
        translation=TranslationConfig(conditioned=True, transport=True, anchored=True),
        train=replace(paper.train, steps=10),
    )


def test_the_simulator_encodes_what_no_pairs_tell(paper: Method, folder: Path) -> None:
    # the force is new at every step, so that (o, a) and their past say nothing of it
    toy = Toy(0.0)
    sim, real, pairs = toy.collect(SIM, 60, 1), toy.collect(REAL, 60, 2), toy.pairs(20, 3)
    held = Unpaired(toy.collect(SIM, 10, 4), toy.collect(REAL, 10, 5))
    data = (sim, real, held, 0, folder)
    model = fit_world_model(TrainingInput(toy.spec, encoded(paper), *data, simulator=toy))
    unit = torch.ones(toy.spec.n_state)
    tensors = PairTensors.of(pairs, unit, unit)
    left = (predictions(model, tensors) - tensors.real_next)[:, 2:]
    assert float((left**2).mean()) < 0.1 * toy.error_without_history()
    raw = (tensors.sim_next - tensors.real_next)[:, 2:]
    assert float((left**2).mean()) < 0.3 * float((raw**2).mean())
    # S has been read: what is left of both is not to be made alike, and nothing is trained for it
    assert float(model.strength) == 0.0
    assert not list(folder.glob("*.ckpt"))


def test_what_is_hidden_in_r_s_collection_does_not_reach_the_encoder(
    paper: Method, tmp_path: Path
) -> None:
    toy, method = Toy(0.0), encoded(paper)
    method = replace(method, mean=replace(method.mean, steps=20))
    sim, models = toy.collect(SIM, 10, 1), []
    for known in (1.0, np.nan):
        real, held = (
            replace(data, hidden=known * data.hidden)
            for data in (toy.collect(REAL, 10, 2), toy.collect(REAL, 5, 5))
        )
        selection = Unpaired(toy.collect(SIM, 5, 4), held)
        data = (sim, real, selection, 0, tmp_path / str(known))
        models.append(fit_world_model(TrainingInput(toy.spec, method, *data, simulator=toy)))
    assert same(*models)


def test_no_simulator_no_encoder(world: World, paper: Method, folder: Path) -> None:
    with pytest.raises(ConfigError, match=r"mean\.simulator encoded steps the simulator"):
        fit(world, encoded(paper), folder, Sink())
