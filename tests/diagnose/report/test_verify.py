"""The proof replays the files: what anybody gets who has only the folder and plain MuJoCo."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.diagnose import synthetic
from tests.diagnose.hidden_forces import NOISE, World, chain, world
from wt.cli.main import main
from wt.diagnose.report.handed_over import HandedOver, hand_over
from wt.diagnose.report.verify import replayed_files, verify
from wt.diagnose.report.write import write
from wt.diagnose.result import Diagnosis
from wt.diagnose.selection.holdout import errors
from wt.diagnose.selection.proof import prove
from wt.errors import UserError, WorkError
from wt.mjcf import plain
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

AS_GOOD = 3e-4
"""What is left [rad] if nothing is missing: that machine holds its commands half a step earlier."""
WIDTH, KP, KV = 0.8, 80.0, 4.0
DEAD = Planted(effects()["actuator.deadband"], Location("actuator", "a1"), np.array([WIDTH]))
STIFF = Planted(effects()["joint.stiffness"], Location("joint", "j2"), np.array([4.0, 0.3]))


def swallowed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """A dead band of the first drive, and a spring at the second joint, by their laws."""
    force = KP * (data.ctrl[0] - data.qpos[0]) - KV * data.qvel[0]
    data.qfrc_applied[0] -= np.clip(force, -WIDTH, WIDTH)
    data.qfrc_applied[1] -= 4.0 * (data.qpos[1] - 0.3)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world(tmp_path_factory.mktemp("machine"), 2, swallowed, seconds=4.0)


@pytest.fixture(scope="module")
def files(machine: World) -> HandedOver:
    found = (DEAD, STIFF)
    said = [p.statement(machine.held.smoothed.motion.scene) for p in found]
    return hand_over(machine.held, found, (found, said), ("a.parquet", "b.parquet"), None)


def test_with_everything_the_files_are_the_machine(machine: World, files: HandedOver) -> None:
    replays = replayed_files(files.contents, chain(2))
    before, model, physics = (
        float(np.sqrt(np.nanmean(e**2))) for e in (replays.before, replays.model, replays.physics)
    )
    assert 10 * physics < model < before
    assert physics < AS_GOOD
    # and the search's own replay errs by the same
    own = errors(machine.held, [(), (DEAD, STIFF)], 5e-4)
    np.testing.assert_allclose(replays.before, own[0], atol=0.05 * NOISE)
    np.testing.assert_allclose(replays.physics, own[1], atol=0.3 * NOISE)


def diagnosis(machine: World, files: HandedOver) -> Diagnosis:
    """A diagnosis of which only the files and their figures are real."""
    replays = replayed_files(files.contents, chain(2))
    three = replays.before, replays.physics, replays.model
    proof = prove(machine.held, (DEAD, STIFF), 5e-4, "as given", files=three)
    made = synthetic.diagnosis(str(synthetic.write_model(machine.scene.path.parent)))
    return replace(
        made, proof=proof, patched_xml=files.model_xml, physics_py=files.physics_py,
        holdout_npz=files.holdout_npz,
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(machine: World, files: HandedOver, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("written") / "diagnosis"
    write(diagnosis(machine, files), out)
    return out


def test_verify_repeats_the_figures(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = json.loads((folder / "diagnosis.json").read_text())
    fit = said["fit"]["holdout"]
    assert fit["after_rmse"] < 0.1 * fit["model_only"]["after_rmse"]
    assert fit["model_only"]["ratio"] == pytest.approx(
        fit["model_only"]["after_rmse"] / fit["before_rmse"]
    )
    assert said["artifacts"]["physics"] == "physics.py"
    found = verify(folder)
    assert found.agrees
    assert found.physics == pytest.approx(fit["after_rmse"], rel=1e-9)
    assert found.model == pytest.approx(fit["model_only"]["after_rmse"], rel=1e-9)
    assert main(["verify", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert "model.xml alone: " in printed
    assert "with physics.py: " in printed


def copied(folder: Path, to: Path) -> Path:
    to.mkdir()
    for file in folder.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def test_files_that_were_changed_are_found_out(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = copied(folder, tmp_path / "changed")
    script = changed / "physics.py"
    script.write_text(script.read_text().replace("-0.8, 0.8", "-0.7, 0.7"))
    assert not verify(changed).agrees
    assert main(["verify", str(changed)]) == 1
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_bad_folders_are_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = copied(folder, tmp_path / "broken")
    (broken / "physics.py").write_text("raise RuntimeError('no')")
    with pytest.raises(WorkError, match="RuntimeError: no"):
        verify(broken)
    (broken / "holdout.npz").write_bytes(b"nothing")
    with pytest.raises(UserError):
        verify(broken)
    (broken / "holdout.npz").unlink()
    with pytest.raises(UserError, match=r"holdout\.npz"):
        verify(broken)
    for path in (broken, tmp_path / "nowhere"):
        assert main(["verify", str(path)]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_sensors_that_err_begin_where_the_machine_is(machine: World) -> None:
    """A replay starts behind what the sensors say, not at it."""
    offset = Planted(effects()["sensor.offset"], Location("joint", "j1"), np.array([0.05]))
    found = (DEAD, STIFF, offset)
    shifted = np.array([0.05, 0.0])
    off = replace(
        machine.held,
        measured=machine.held.measured + shifted,
        stretches=tuple(replace(s, q0=s.q0 + shifted) for s in machine.held.stretches),
    )
    said = [p.statement(machine.held.smoothed.motion.scene) for p in found]
    written = hand_over(off, found, (found, said), ("a", "b"), None)
    replays = replayed_files(written.contents, chain(2))
    assert np.sqrt(np.nanmean(replays.physics**2)) < AS_GOOD


THROWN = """<mujoco><option timestep="0.001" gravity="0 0 -1"/><worldbody><body name="box">
<freejoint name="base"/><geom type="box" size=".1 .2 .3" mass="1"/><body name="arm" pos=".1 0 0">
<joint name="hip" axis="0 1 0" damping=".1"/><geom size=".05" mass=".2" pos=".2 0 0"/></body>
</body></worldbody><actuator><position name="m" joint="hip" kp="5"/></actuator></mujoco>"""


def test_a_floating_base_in_coordinates() -> None:
    """Poses and rates of a free joint there and back, against scipy's rotations."""
    model = mujoco.MjModel.from_xml_string(THROWN)
    data = mujoco.MjData(model)
    # nearly half a turn, so that the yaw goes over it
    begun = Rotation.from_euler("ZYX", [3.0, 0.2, -0.4])
    data.qpos[:] = [1.0, 2.0, 3.0, *begun.as_quat(scalar_first=True), 0.3]
    data.qvel[:] = [0.5, -0.3, 0.8, 0.2, 0.3, 0.9, -0.4]
    t, q = 0.001 * np.arange(501), np.empty((501, 7))
    data.ctrl[:] = 0.5
    rates = None
    for k in range(501):
        turned = Rotation.from_quat(data.qpos[3:7], scalar_first=True).as_euler("ZYX")
        q[k] = [*data.qpos[:3], *turned, data.qpos[7]]
        v = [*data.qvel[:3], *turned, data.qvel[6]]
        if k < 2:
            mujoco.mj_forward(model, data)
        if k == 0:
            first = np.array(v)
            small = mujoco.MjData(model)
            small.qpos[:] = data.qpos
            mujoco.mj_integratePos(model, small.qpos, data.qvel, 1e-6)
            later = Rotation.from_quat(small.qpos[3:7], scalar_first=True).as_euler("ZYX")
            rates = (later - turned) / 1e-6
        mujoco.mj_step(model, data)
    assert rates is not None
    first[3:6] = rates
    q[:, 3:6] = np.unwrap(q[:, 3:6], axis=0)
    assert q[-1, 3] > np.pi
    names = [f"base/{c}" for c in ("x", "y", "z", "yaw", "pitch", "roll")]
    held = {
        "joints": np.array([*names, "hip"]), "actuators": np.array(["m"]),
        "added": np.array([], str), "first": np.array([0]), "recording": np.array([0]),
        "q0": q[:1], "v0": first[None],
        "added_q": np.zeros((1, 0)), "added_v": np.zeros((1, 0)), "t": t,
        "command": np.full((501, 1), 0.5), "activation": np.full((1, 1), np.nan),
        "lead_first": np.array([0]), "lead_t": np.zeros(0), "lead": np.zeros((0, 1)),
    }  # fmt: skip
    np.testing.assert_allclose(plain.replay(model, None, held), q, atol=2e-6)


def test_a_replay_that_explodes_counts_as_far_off(machine: World, files: HandedOver) -> None:
    wild = files.model_xml.replace("<actuator>", "<actuator><!--wild-->", 1)
    wild = wild.replace('kp="80"', 'kp="-1e9"', 1)
    assert wild != files.model_xml
    contents = {"model.xml": wild, "holdout.npz": files.holdout_npz}
    replays = replayed_files(contents, chain(2))
    assert np.nanmax(np.abs(replays.model)) == pytest.approx(1.0)
