"""One that is the same is not accused, one that changed is, what is unlike is not judged."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.passport.test_add import RIG, record
from wt.data import recording as recordings
from wt.data.labels import Labels
from wt.diagnose import again
from wt.errors import UserError
from wt.passport.add import add
from wt.passport.folder import Addition, Passport, Source
from wt.passport.live import FALSE_ALARMS, Judgement, Live, reference
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location, Recording

USUAL, DAY = 0.2, {"unit": "A17", "session": "2026-11-01"}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Passport]:
    home = tmp_path_factory.mktemp("bench")
    (home / "rig.xml").write_text(RIG.format(friction=""))
    dry = Planted(
        effects()["joint.friction_coulomb"], Location("joint", "hinge"), np.array([USUAL])
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(again, "named", lambda *_: (dry,))
        given = [record(home / f"{seed}.parquet", USUAL, seed, DAY) for seed in range(3)]
        passport = add(home / "rig.xml", given, home / "robot").passport
    return home, passport


@pytest.fixture(scope="module")
def live(bench: tuple[Path, Passport]) -> Live:
    return Live(bench[1], bench[0] / "rig.xml", "")


def judged(live: Live, home: Path, friction: float, seed: int) -> Judgement:
    return live.judge(recordings.read(record(home / "now.parquet", friction, seed, {})))


def test_a_machine_that_is_the_same_is_not_accused(live: Live, tmp_path: Path) -> None:
    said = [judged(live, tmp_path, USUAL, 100 + seed) for seed in range(10)]
    assert not any(j.changed or j.why_not for j in said)
    assert min(j.p_value for j in said) > FALSE_ALARMS
    assert np.median([j.score["hinge"] for j in said]) == pytest.approx(1.0, abs=0.2)


def test_one_that_changed_is_and_the_operator_is_told_where(live: Live, tmp_path: Path) -> None:
    said = judged(live, tmp_path, 1.5 * USUAL, 7)
    assert said.changed == ("hinge",) and said.score["hinge"] > 2.0
    assert "A17 is no longer the machine in its passport: joint hinge errs" in said.line("A17")
    assert said.to_json()["changed"] == ["hinge"]


def test_what_the_reference_has_nothing_like_is_not_judged(live: Live, tmp_path: Path) -> None:
    far = recordings.read(record(tmp_path / "far.parquet", USUAL, 3, {}))
    columns = {name: 5.0 * column for name, column in far.columns.items()}
    said = live.judge(Recording(far.t, columns, {}))
    assert (said.changed, said.p_value) == ((), 1.0)
    assert said.why_not == "it moves further than in its last session"


def test_what_cannot_be_replayed_is_not_judged(live: Live) -> None:
    still = Recording(np.arange(300) / 100.0, {"qpos/hinge": np.zeros(300)}, {})
    assert "ctrl/servo" in live.judge(still).why_not


def test_a_unit_is_compared_with_itself_under_the_same_load() -> None:
    """A box comes before none in the alphabet, and weighs more."""
    groups = [("2026-11-01", "none"), ("2026-11-09", "none"), ("2026-11-09", "box")]
    labels = [Labels("A17", *group) for group in groups]
    passport = of_sources(labels)
    for load, group in (("", 1), ("none", 1), ("box", 2)):
        with pytest.raises(UserError, match=f"of {re.escape(str(labels[group]))} are not where"):
            reference(passport, "A17", load)
    with pytest.raises(UserError, match="--load 'boxx' was never carried by A17; did you mean"):
        reference(passport, "A17", "boxx")
    with pytest.raises(UserError, match="A17 on 2026-11-09 with box are not where"):
        reference(of_sources(labels[2:]), "A17", "")  # that is all it ever carried


def of_sources(labels: Sequence[Labels]) -> Passport:
    """A passport of recordings that are gone."""
    sources = tuple(Source(f"/gone/{i}", f"{i}", of) for i, of in enumerate(labels))
    return Passport((Addition("arm.xml", "", "", sources, (), ()),))


def test_wrong_units_and_lost_recordings_are_one_line(bench: tuple[Path, Passport]) -> None:
    home, passport = bench
    with pytest.raises(UserError, match="--unit 'A71' is not in the passport; did you mean 'A17'"):
        Live(passport, home / "rig.xml", "A71")
    moved = [(p, p.with_suffix(".gone")) for p in home.glob("?.parquet")]
    for here, there in moved:
        here.rename(there)
    with pytest.raises(UserError, match="are not where they were"):
        Live(passport, home / "rig.xml", "A17")
    for here, there in moved:
        there.rename(here)
