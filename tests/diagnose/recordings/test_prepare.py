"""Which recordings are fitted, which are held out, and that they take turns."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnose.hidden_forces import chain, record
from wt.check.run import Checked
from wt.data import recording as recordings
from wt.diagnose.recordings import prepare as prepare_module
from wt.diagnose.recordings.prepare import Prepared, prepare, turned
from wt.errors import RecordingError
from wt.physics.scene import Scene
from wt.types import Recording


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    path = tmp_path / "robot.xml"
    path.write_text(chain(1))
    return Scene(path)


def indices(prepared: Prepared) -> tuple[list[int], list[int]]:
    return [p.index for p in prepared.fit], [p.index for p in prepared.held]


def test_of_several_recordings_the_first_is_held_out_in_its_turn(scene: Scene) -> None:
    given = prepare(scene, [record(chain(1), None, 3.0, i) for i in range(3)], [])
    assert indices(given) == ([0, 1], [2])
    other = turned(given)
    assert other is not None
    assert indices(other) == ([1, 2], [0])
    assert [(u.path, u.role) for u in other.used] == [
        (given.names[1], "fit"),
        (given.names[2], "fit"),
        (given.names[0], "holdout"),
    ]


def test_of_one_recording_the_first_quarter_is(scene: Scene) -> None:
    other = turned(prepare(scene, [record(chain(1), None, 8.0, 0)], []))
    assert other is not None
    (fit,), (held,) = other.fit, other.held
    assert held.span[1] == fit.span[0] == pytest.approx(2.0, abs=0.01)
    assert fit.seconds == pytest.approx(3.0 * held.seconds, rel=0.01)


def test_what_is_for_the_proof_only_is_never_fitted(scene: Scene) -> None:
    one, two = (record(chain(1), None, 3.0, i) for i in range(2))
    assert turned(prepare(scene, [one], [two])) is None


def test_what_is_given_twice_is_refused_under_whatever_name(scene: Scene, tmp_path: Path) -> None:
    one, copy, other = (tmp_path / f"{name}.parquet" for name in ("one", "copy", "other"))
    recordings.write(record(chain(1), None, 3.0, 0), one)
    recordings.write(record(chain(1), None, 3.0, 1), other)
    copy.write_bytes(one.read_bytes())
    for fitted, held, said in (
        ([one], [one], "is to be fitted and held out"),
        ([other, one], [copy], "copy.parquet', which holds the same as '.*one.parquet', is to be"),
        ([one, one], [], "one.parquet' is given twice"),
        ([one], [other, other], "other.parquet' is given twice"),
    ):
        with pytest.raises(RecordingError, match=said) as error:
            prepare(scene, fitted, held)
        assert "\n" not in str(error.value)
    assert indices(prepare(scene, [one], [other])) == ([0], [1])


def test_more_than_helps_in_all_is_refused_before_it_is_read(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    for i, file in enumerate(files):
        recordings.write(record(chain(1), None, 3.0, i), file)
    rows, width = recordings.sizes_of(files)[files[0]]
    monkeypatch.setattr(recordings, "_MOST", rows * width)
    monkeypatch.setattr(recordings, "read", None)
    with pytest.raises(RecordingError, match="2 files have"):
        prepare(scene, files, [])


def test_how_long_all_will_take_is_told_before_the_audit(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A humanoid's audit took half a minute in which nobody was told of the quarter of an hour."""
    told: list[object] = []
    audit = prepare_module.check

    def audited(scene: Scene, recording: Recording) -> Checked:
        told.append("audited")
        return audit(scene, recording)

    monkeypatch.setattr(prepare_module, "check", audited)
    pair = [record(chain(1), None, 3.0, i) for i in range(2)]
    prepare(scene, pair[:1], pair[1:], lambda used: told.extend(u.role for u in used))
    assert told == ["fit", "holdout", "audited", "audited"]
