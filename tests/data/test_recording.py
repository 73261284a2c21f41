"""Recordings on disk: what is written comes back, and what is wrong is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.show.test_files import half
from wt.data import recording as recordings
from wt.data.importers.base import delays
from wt.errors import RecordingError, UserError
from wt.show import files
from wt.types import Recording

MODEL = """
<mujoco><compiler angle="radian"/>
  <worldbody>
    <body name="box"><freejoint name="float"/><geom size="0.1"/></body>
    <body><joint name="hip" range="-1.5 1.5" limited="true"/><geom size="0.1"/>
      <body pos="0 0 0.3"><joint name="wheel"/><geom size="0.1"/></body></body>
  </worldbody>
  <actuator>
    <position name="hip" joint="hip" kp="5" ctrlrange="-1.5 1.5"/>
    <motor name="spin" joint="wheel" ctrlrange="-2 2"/>
  </actuator>
  <sensor><jointpos name="encoder" joint="hip"/></sensor>
</mujoco>
"""


def make(degrees: tuple[str, ...] = (), **extra: np.ndarray) -> Recording:
    """Four seconds of a swinging hip; the columns named in ``degrees`` are in degrees."""
    t = np.arange(0.0, 4.0, 0.01)
    columns = {
        "ctrl/hip": np.sin(2.0 * t),
        "qpos/hip": np.sin(2.0 * t - 0.1),
        "qvel/hip": 2.0 * np.cos(2.0 * t - 0.1),
        **extra,
    }
    for name in degrees:
        columns[name] = np.rad2deg(columns[name])
    return Recording(t, columns, {"robot": "hip", "rate": 100})


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    gap = np.where(np.arange(400) % 7 == 0, np.nan, 1.0)
    written = make(**{"sensor/encoder/0": gap})
    recordings.write(written, tmp_path / "new" / "a.parquet")
    back = recordings.read(tmp_path / "new" / "a.parquet")
    np.testing.assert_array_equal(back.t, written.t)
    assert list(back.columns) == list(written.columns)
    for name in written.columns:
        np.testing.assert_array_equal(back.columns[name], written.columns[name])
    assert back.meta == {"robot": "hip", "rate": 100}


def test_the_file_is_the_published_format(tmp_path: Path) -> None:
    recordings.write(make(), tmp_path / "a.parquet")
    table = pq.read_table(tmp_path / "a.parquet")
    assert table.column_names == ["t", "ctrl/hip", "qpos/hip", "qvel/hip"]
    assert {str(field.type) for field in table.schema} == {"double"}
    assert json.loads(table.schema.metadata[b"wt"])["robot"] == "hip"


def test_an_interrupted_write_leaves_the_earlier_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.parquet"
    recordings.write(make(), path)
    before = path.read_bytes()

    monkeypatch.setattr(files.os, "fdopen", half(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        recordings.write(make(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.parquet"]


def refused(path: Path) -> str:
    with pytest.raises(RecordingError) as error:
        recordings.read(path)
    assert "\n" not in str(error.value)
    assert path.name in str(error.value)
    return str(error.value)


def test_files_that_are_no_recordings(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "none.parquet")
    (tmp_path / "text.parquet").write_text("t,ctrl/hip\n0,1\n")
    assert "wt import" in refused(tmp_path / "text.parquet")
    recordings.write(make(), tmp_path / "a.parquet")
    whole = (tmp_path / "a.parquet").read_bytes()
    (tmp_path / "cut.parquet").write_bytes(whole[: len(whole) // 2])
    assert "truncated" in refused(tmp_path / "cut.parquet")
    pd.DataFrame({"x": [1.0, 2.0]}).to_parquet(tmp_path / "foreign.parquet")
    assert "no column 't' but x" in refused(tmp_path / "foreign.parquet")
    words = pd.DataFrame({"t": [0.0, 3.0], "ctrl/hip": ["a", "b"]})
    words.to_parquet(tmp_path / "words.parquet")
    assert "'ctrl/hip'" in refused(tmp_path / "words.parquet")
    pd.DataFrame({"t": [0.0, 3.0], "qvel/hip": [0, 1]}).to_parquet(tmp_path / "noctrl.parquet")
    assert "no 'ctrl/" in refused(tmp_path / "noctrl.parquet")


def test_a_matching_recording_passes(model: mujoco.MjModel) -> None:
    still = np.zeros(400)
    free = {f"qpos/float/{k}": still for k in range(7)} | {f"qvel/float/{k}": still for k in (0, 5)}
    turns = np.linspace(0.0, 90.0, 400)  # a wheel may turn many times
    extra = {"ctrl/spin": still + 40.0, "force/spin": still, "sensor/encoder/0": still}
    recordings.check_against(make(**free, **extra, **{"qpos/wheel": turns}), model)


@pytest.mark.parametrize(
    ("column", "hint"),
    [("qpos/hipp", "qpos/hip"), ("ctrl/spinn", "ctrl/spin"), ("sensor/encoder/1", "encoder/0"),
     ("qvel/float/6", "qvel/float/"), ("qpos/float", "float")],
)  # fmt: skip
def test_unknown_names_get_the_nearest(model: mujoco.MjModel, column: str, hint: str) -> None:
    with pytest.raises(RecordingError, match=f"'{column}'.*{hint}"):
        recordings.check_against(make(**{column: np.zeros(400)}), model)


@pytest.mark.parametrize(
    ("degrees", "named"),
    [
        (("qpos/hip", "qvel/hip", "ctrl/hip"), "qpos/hip"),
        (("ctrl/hip",), "ctrl/hip"),
        (("qvel/hip",), "qvel/hip"),
    ],
)
def test_degrees_are_refused(model: mujoco.MjModel, degrees: tuple[str, ...], named: str) -> None:
    with pytest.raises(RecordingError, match=f"'{named}'.*degrees.*radians"):
        recordings.check_against(make(degrees), model)


def test_a_position_is_needed(model: mujoco.MjModel) -> None:
    t = np.arange(0.0, 3.0, 0.1)
    with pytest.raises(RecordingError, match="no 'qpos/"):
        recordings.check_against(Recording(t, {"ctrl/hip": t}), model)


def test_delay_of_a_delayed_copy() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(0)
    command = np.convolve(rng.normal(size=len(t) + 60), np.hanning(30), "same")[60:]
    late = np.interp(t - 0.083, t, command)
    found = delays(Recording(t, {"ctrl/a": command, "qpos/a": 0.8 * late}))
    assert found == {"a": pytest.approx(0.083, abs=0.002)}
    still = Recording(t, {"ctrl/a": command, "qpos/a": np.zeros_like(t)})
    assert delays(still) == {}


def test_what_is_wrong_inside_a_file_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    t, q = np.arange(0.0, 4.0, 0.01), np.zeros(400)
    pq.write_table(pa.Table.from_arrays([t, q, q], ["t", "qpos/hip", "qpos/hip"]), path)
    assert "column 'qpos/hip' is there twice" in refused(path)
    for meta in (b'\xff\xfe{"a": 1}', b"[1, 2]", b"[" * 100_000 + b"]" * 100_000, b"{"):
        table = pa.table({"t": t, "qpos/hip": q}).replace_schema_metadata({b"wt": meta})
        pq.write_table(table, path)
        assert "metadata (key 'wt')" in refused(path)
    for value, said in ((np.inf, "infinite"), (-1e300, "-1e+300")):
        q[7] = value
        pq.write_table(pa.table({"t": t, "qpos/hip": q}), path)
        assert f"column 'qpos/hip' is {said} at row 7" in refused(path)


def test_more_than_the_memory_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recordings.write(make(), tmp_path / "a.parquet")
    monkeypatch.setattr(recordings, "_COPIES_OF_WORK", 10**12)
    assert "400 rows of 4 columns" in refused(tmp_path / "a.parquet")


def test_more_than_helps_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recordings.write(make(), tmp_path / "a.parquet")
    recordings.write(make(), tmp_path / "b.parquet")
    (tmp_path / "c.parquet").write_text("none")
    sizes = recordings.sizes_of(sorted(tmp_path.iterdir()))
    assert [*sizes.values()] == [(400, 4), (400, 4)]
    monkeypatch.setattr(recordings, "_MOST", 2000)
    recordings.read(tmp_path / "a.parquet")
    with pytest.raises(RecordingError, match=r"2 files have .* one row in 2 "):
        recordings.refuse_more_than_helps(sizes)
    monkeypatch.setattr(recordings, "_MOST", 200)
    assert "400 rows of 4 columns are" in refused(tmp_path / "a.parquet")
    assert "one row in 8 " in refused(tmp_path / "a.parquet")


def test_degrees_are_not_what_may_be_radians(model: mujoco.MjModel) -> None:
    """A joint that goes to ±1.046 rad, further than its model allows."""
    narrow = mujoco.MjModel.from_xml_string(MODEL.replace('"-1.5 1.5"', '"-0.5 0.5"'))
    swing = 1.046 * np.sin(np.arange(0.0, 4.0, 0.01))
    with pytest.raises(RecordingError, match="or the model's range is not") as error:
        recordings.check_against(make(**{"qpos/hip": swing, "ctrl/hip": swing}), narrow)
    assert "degrees" not in str(error.value)


def test_only_an_earlier_recording_of_the_same_source_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    recordings.refuse_to_lose(path, "--to", "log.csv")
    recordings.write(Recording(make().t, make().columns, {"source": "log.csv"}), path)
    recordings.refuse_to_lose(path, "--to", "log.csv")
    with pytest.raises(UserError, match="was not made of other"):
        recordings.refuse_to_lose(path, "--to", "other.csv")
    with pytest.raises(UserError, match="is an input too"):
        recordings.refuse_to_lose(path, "--to", "log.csv", [tmp_path / "." / "a.parquet"])
    path.write_text("mine")
    with pytest.raises(UserError, match="was not made of"):
        recordings.refuse_to_lose(path, "--to", "log.csv")
