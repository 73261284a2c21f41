"""What trains, selects and registers models never looks at the test pairs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
import torch

from tests.end_to_end.conftest import METHODS, Place
from wt.config import load
from wt.evaluate.results import OURS
from wt.evaluate.single_step import Errors
from wt.run import publish
from wt.run.folder import tracked
from wt.run.jobs import Job, train
from wt.run.study import WEIGHTS, Study
from wt.train.selection import Unpaired
from wt.types import Pairs


class LookedError(Exception):
    """The test pairs were looked at."""


class Sealed(Pairs):
    """Test pairs that nobody may look at."""

    def __getattribute__(self, name: str) -> object:
        if name.startswith("__"):
            return object.__getattribute__(self, name)
        raise LookedError(name)

    def __len__(self) -> NoReturn:
        raise LookedError("len")


def sealed(place: Place, folder: Path, *words: str) -> Study:
    """A study of the shared run's configuration, with test pairs that raise."""
    config = load(place.words[1], [*place.words[2:], *words])
    study = Study.open(config, folder)
    return replace(study, data=replace(study.data, test=object.__new__(Sealed)))


@pytest.mark.parametrize("method", METHODS)
def test_training_and_selection_end_before_the_test_pairs_are_looked_at(
    method: str, place: Place, finished: Path, tmp_path: Path
) -> None:
    study = sealed(place, tmp_path)
    with pytest.raises(LookedError):  # in the end: every method predicts them
        train(study, Job(0, method))
    (kept, other) = (
        torch.load(home / "work" / "seed0" / method / WEIGHTS, weights_only=True)
        for home in (tmp_path, finished)
    )
    assert kept.keys() == other.keys()
    assert all(torch.equal(kept[name], other[name]) for name in kept)


def test_seed_model_and_champion_are_settled_before_the_test_pairs_are_looked_at(
    place: Place, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = Path("work") / "seed0" / OURS / WEIGHTS
    (tmp_path / weights).parent.mkdir(parents=True)
    (tmp_path / weights).write_bytes((finished / weights).read_bytes())
    pushed: list[float] = []
    monkeypatch.setattr(publish, "push", lambda *given, **_: pushed.append(given[2]))
    study = sealed(place, tmp_path)
    errors = {0: {OURS: Errors(0.1, 0.1, np.ones(12))}}
    monkeypatch.setenv("MLFLOW_TRACKING_URI", place.store)
    with tracked(study.config, tmp_path) as current, pytest.raises(LookedError):
        publish.publish(study, errors, current)
    assert pushed == [publish.chosen_by(study, [0])[0]]
    assert (tmp_path / "card.json").is_file()


def test_pairs_select_where_they_are_asked_for(place: Place, tmp_path: Path) -> None:
    words = ("model_selection=pairs", f"data.dir={tmp_path / 'data'}", "data.transitions=500")
    study = sealed(place, tmp_path, *words)
    assert study.data.validation is not None
    sim, real, selection, streams = study.split
    assert (len(sim), len(real), selection.name) == (500, 500, "pairs")
    assert streams.sim is streams.real is None
    assert selection.translated is study.data.validation


@pytest.mark.parametrize("method", METHODS)
def test_validation_pairs_are_used_where_they_select_and_something_is_learnt(
    method: str, place: Place
) -> None:
    for selection in ("pairs", "unpaired"):
        config = load(place.words[1], [*place.words[2:], f"model_selection={selection}"])
        used = Job(0, method).uses(config)
        assert ("validation" in used) == (selection == "pairs" and method != "RawSim")
        assert used["test"] == "test"


def test_what_memory_is_not_to_hold_is_streamed_and_what_selects_is_not(
    place: Place, finished: Path, tmp_path: Path
) -> None:
    study = sealed(place, tmp_path, "data.in_memory=600")  # of 1500, in shards of 400
    sim, real, selection, streams = study.split
    assert isinstance(selection, Unpaired)
    for sample, held, stored in (
        (sim, selection.sim, streams.sim),
        (real, selection.real, streams.real),
    ):
        assert stored is not None
        streamed = np.concatenate([stored.read(k).o for k in range(len(stored.groups))])
        assert (len(sample), len(held), len(streamed)) == (400, 150, 1350)
        closed = {row.tobytes() for row in held.o}
        assert closed.isdisjoint(row.tobytes() for row in [*streamed, *sample.o])
    whole = sealed(place, tmp_path).split
    np.testing.assert_array_equal(held.o, whole.selection.predicted.real.o)
    with pytest.raises(LookedError):
        train(study, Job(0, OURS))
    ours, theirs = (
        torch.load(home / "work" / "seed0" / OURS / WEIGHTS, weights_only=True)
        for home in (tmp_path, finished)
    )
    assert any(not torch.equal(ours[name], theirs[name]) for name in theirs)
