"""The recording is read back and compared with poses worked out by hand."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.show.test_files import half
from wt.errors import DataError
from wt.evaluate import rollout_view
from wt.show import files
from wt.types import Channel

# A hinge about y, 0.5 m up, with a bar 0.4 m along its x; and one geom of each other kind.
MJCF = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="base" pos="0 0 0.1">
      <geom name="foot" type="cylinder" size="0.05 0.1"/>
      <body name="arm" pos="0 0 0.4">
        <joint name="hinge" axis="0 1 0"/>
        <inertial pos="0.2 0 0" mass="1" diaginertia="1 1 1"/>
        <geom name="bar" type="capsule" fromto="0 0 0 0.4 0 0" size="0.02"/>
        <geom name="tip" type="sphere" pos="0.4 0 0" size="0.03"/>
        <geom name="egg" type="ellipsoid" size="0.01 0.02 0.03"/>
        <geom name="block" type="box" pos="0.1 0 0" size="0.01 0.02 0.03"/>
        <geom name="hull" type="sphere" size="0.3" group="3"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
CHANNELS = (Channel("qpos/hinge", "rad"), Channel("qvel/hinge", "rad/s"))
STEPS = 5


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """A one-joint arm."""
    return mujoco.MjModel.from_xml_string(MJCF)


def inputs() -> dict[str, Any]:
    """A quarter turn downwards, with a force that acts in the middle of it."""
    angle = np.linspace(0.0, np.pi / 2, STEPS)[:, None]
    real = np.hstack([angle, np.ones_like(angle)])
    force = np.zeros((STEPS, 3))
    force[2:4] = [[0.0, 0.0, -50.0], [100.0, 0.0, 0.0]]
    return {
        "t": np.arange(STEPS) / 50,
        "qpos": {"S": angle, "translated": 0.5 * angle, "R": angle},
        "predicted": {"RawSim": real + 0.25, "ResDyn": real},
        "real": real,
        "channels": CHANNELS,
        "force": force,
        "force_body": "arm",
    }


@pytest.fixture(scope="module")
def recording(model: mujoco.MjModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of ``inputs``."""
    path = tmp_path_factory.mktemp("rollout") / "rollout.rrd"
    rollout_view.write_rollout(path, model, **inputs())
    return path


@pytest.fixture(scope="module")
def rows(recording: Path) -> dict[tuple[str, bool], list[dict[str, Any]]]:
    """Rows of the recording by (entity, static)."""
    chunks = list(RrdReader(recording).stream())
    return {(c.entity_path, c.is_static): c.to_record_batch().to_pylist() for c in chunks}


def test_rerun_itself_accepts_the_file(recording: Path) -> None:
    code = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "rrd", "verify", str(recording)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 file verified" in done.stdout + done.stderr
    assert [entry.kind for entry in RrdReader(recording).blueprints()] == ["blueprint"]


def test_entities_are_the_documented_ones(
    rows: dict[tuple[str, bool], list[dict[str, Any]]],
) -> None:
    entities = {entity for entity, _ in rows}
    for arm in ("S", "translated", "R"):
        drawn = {"arm/bar", "arm/tip", "arm/egg", "arm/block", "base/foot", "label"}
        assert {f"/world/{arm}/{part}" for part in drawn} <= entities
        assert f"/world/{arm}/arm/hull" not in entities  # a group that viewers hide
        assert f"/world/{arm}/world/floor" not in entities
    assert {e for e in entities if e.endswith("/force")} == {"/world/R/force"}
    for channel in ("qpos/hinge", "qvel/hinge"):
        below = {e.removeprefix(f"/prediction/{channel}/") for e in entities if channel in e}
        assert {"real", "RawSim", "ResDyn"} <= below
        assert f"/error/{channel}/RawSim" in entities


def test_bodies_move_as_the_joints_say(
    rows: dict[tuple[str, bool], list[dict[str, Any]]],
) -> None:
    for arm, last_angle in (("S", np.pi / 2), ("translated", np.pi / 4)):
        poses = rows[f"/world/{arm}/arm", False]
        assert [row["time"].total_seconds() for row in poses] == [0.0, 0.02, 0.04, 0.06, 0.08]
        last = poses[-1]
        assert np.allclose(last["Transform3D:translation"], [[0.0, 0.0, 0.5]], atol=1e-6)
        # a turn by θ about y, as Rerun's xyzw quaternion
        half = last_angle / 2
        expected = [[0.0, np.sin(half), 0.0, np.cos(half)]]
        assert np.allclose(last["Transform3D:quaternion"], expected, atol=1e-6)


def test_shapes_lie_where_the_mjcf_puts_them(
    rows: dict[tuple[str, bool], list[dict[str, Any]]],
) -> None:
    (bar,) = rows["/world/S/arm/bar", True]
    x, y, z, w = bar["Capsules3D:quaternions"][0]
    # Rerun's capsule reaches from its translation along its own z, R(q)·ẑ
    along = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    start = np.array(bar["Capsules3D:translations"][0])
    ends = np.array([start, start + bar["Capsules3D:lengths"][0] * along])
    assert np.allclose(sorted(ends.tolist()), [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]], atol=1e-6)
    assert bar["Capsules3D:radii"] == pytest.approx([0.02])

    (foot,) = rows["/world/S/base/foot", True]
    assert foot["Cylinders3D:lengths"] == pytest.approx([0.2])
    (tip,) = rows["/world/S/arm/tip", True]
    assert np.allclose(tip["Ellipsoids3D:half_sizes"], 0.03)
    assert np.allclose(tip["Ellipsoids3D:centers"], [[0.4, 0.0, 0.0]])
    (egg,) = rows["/world/S/arm/egg", True]
    assert np.allclose(egg["Ellipsoids3D:half_sizes"], [[0.01, 0.02, 0.03]])
    (block,) = rows["/world/S/arm/block", True]
    assert np.allclose(block["Boxes3D:half_sizes"], [[0.01, 0.02, 0.03]])
    assert np.allclose(block["Boxes3D:centers"], [[0.1, 0.0, 0.0]])


def test_arms_stand_apart_along_y_in_their_own_colours(
    rows: dict[tuple[str, bool], list[dict[str, Any]]],
) -> None:
    arms = ("S", "translated", "R")
    places = np.array([rows[f"/world/{a}", True][0]["Transform3D:translation"][0] for a in arms])
    assert (places[:, [0, 2]] == 0).all()
    assert (np.diff(places[:, 1]) > 0.39).all()
    colors = {rows[f"/world/{arm}/arm/bar", True][0]["Capsules3D:colors"][0] for arm in arms}
    assert len(colors) == 3


def test_the_force_is_an_arrow_only_while_it_acts(
    rows: dict[tuple[str, bool], list[dict[str, Any]]],
) -> None:
    arrows = rows["/world/R/force", False]
    assert [row["Arrows3D:labels"] for row in arrows] == [[], [], ["50 N"], ["100 N"], []]
    # it acts on the centre of mass, 0.2 m out on an arm turned down by 45°
    down = 0.2 * np.sqrt(0.5)
    assert np.allclose(arrows[2]["Arrows3D:origins"], [[down, 0.0, 0.5 - down]], atol=1e-6)
    weak, strong = (np.array(arrows[k]["Arrows3D:vectors"][0]) for k in (2, 3))
    assert np.allclose(strong[1:], 0.0) and strong[0] > 0
    assert np.allclose(weak, -strong[0] / 2 * np.eye(3)[2])


def test_errors_are_predicted_minus_real(
    rows: dict[tuple[str, bool], list[dict[str, Any]]],
) -> None:
    def series(entity: str) -> list[float]:
        return [row["Scalars:scalars"][0] for row in rows[entity, False]]

    assert series("/error/qpos/hinge/RawSim") == pytest.approx([0.25] * STEPS)
    assert series("/error/qpos/hinge/ResDyn") == [0.0] * STEPS
    assert series("/prediction/qpos/hinge/real") == pytest.approx(np.linspace(0, np.pi / 2, STEPS))


@pytest.mark.parametrize("force", [None, np.zeros((STEPS, 3)), np.full((STEPS, 3), np.nan)])
def test_nothing_hidden_or_nothing_known_draws_no_arrow(
    model: mujoco.MjModel, tmp_path: Path, force: np.ndarray | None
) -> None:
    path = tmp_path / "r.rrd"
    rollout_view.write_rollout(path, model, **{**inputs(), "force": force})
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == "/world/R/force" and not chunk.is_static:
            assert all(not row["Arrows3D:vectors"] for row in chunk.to_record_batch().to_pylist())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"real": np.zeros((STEPS, 3))}, r"real has shape \(5, 3\), \(5, 2\) is needed"),
        ({"qpos": {"S": np.zeros((4, 1))}}, r"qpos of 'S' has shape \(4, 1\)"),
        ({"predicted": {"RSSM": np.zeros(5)}}, "prediction of 'RSSM'"),
        ({"force": np.zeros((STEPS, 6))}, r"force has shape \(5, 6\)"),
        ({"force_body": "gripper"}, "no body 'gripper'"),
        ({"qpos": {}}, "no arm"),
    ],
)
def test_arrays_that_do_not_fit_are_named_and_nothing_is_written(
    model: mujoco.MjModel, tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    path = tmp_path / "r.rrd"
    path.write_bytes(b"earlier")
    with pytest.raises(DataError, match=message):
        rollout_view.write_rollout(path, model, **{**inputs(), **changed})
    assert path.read_bytes() == b"earlier"


def test_a_failed_write_leaves_the_earlier_file(
    model: mujoco.MjModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "r.rrd"
    path.write_bytes(b"earlier")

    full = OSError(28, "No space left on device")
    monkeypatch.setattr(files.os, "fdopen", half(full))
    with pytest.raises(OSError, match="No space left"):
        rollout_view.write_rollout(path, model, **inputs())
    monkeypatch.undo()
    assert path.read_bytes() == b"earlier"
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.rrd"]
