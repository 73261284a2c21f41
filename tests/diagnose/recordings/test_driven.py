"""The response to held commands: exact between samples, and curves beside it follow slow logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from jaxtyping import Float

from wt.diagnose.recordings import driven
from wt.diagnose.recordings.driven import held
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, beside, smooth
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

STEP, NOISE = 1e-4, 2e-5
DRIVES = {
    "position": '<position name="a" joint="a" kp="40" kv="3"/>'
    '<position name="b" joint="b" kp="20" kv="1.5" gear="2"/>',
    "torque": '<motor name="a" joint="a" gear="3"/><motor name="b" joint="b"/>',
}


def arm(drives: str, gravity: str = "0 0 -9.81", extra: str = "") -> str:
    return f"""<mujoco><option timestep="{STEP}" integrator="implicitfast" gravity="{gravity}"/>
      <worldbody><body><joint name="a" axis="0 1 0" damping=".3"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0"/>
        <body pos="0 0 -.3"><joint name="b" axis="0 1 0" damping=".2" {extra}/>
          <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02" mass=".5" contype="0"/></body>
      </body></worldbody><actuator>{DRIVES[drives]}</actuator></mujoco>"""


def recorded(
    xml: str, rate: float, jerky: bool = True, noise: float = NOISE
) -> tuple[Recording, Float[np.ndarray, "sample dof"]]:
    """Ten seconds of an arm that is steered in steps, and its true velocities."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, rng, n = mujoco.MjData(model), np.random.default_rng(0), int(10 * rate)
    t = np.arange(n) / rate
    goal = 0.3 * np.sin(np.outer(t, [3.1, 4.4])) + 0.4 * jerky * (np.floor(t / 0.9) % 2)[:, None]
    servo = model.actuator_biastype[0] != mujoco.mjtBias.mjBIAS_NONE
    q, v, u = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2))
    for k in range(n):
        q[k], v[k] = data.qpos, data.qvel
        u[k] = goal[k] if servo else 6.0 * (goal[k] - data.qpos) - 0.5 * data.qvel
        data.ctrl[:] = u[k]
        mujoco.mj_step(model, data, round(1.0 / (rate * STEP)))
    q += noise * rng.standard_normal(q.shape)
    columns = {f"ctrl/{j}": u[:, i] for i, j in enumerate("ab")}
    return Recording(t, columns | {f"qpos/{j}": q[:, i] for i, j in enumerate("ab")}), v


def smoothed(folder: Path, xml: str, recording: Recording) -> Smoothed:
    (folder / "arm.xml").write_text(xml)
    return smooth(Scene(folder / "arm.xml"), [Part(recording, 0)])


@pytest.mark.parametrize("drives", DRIVES)
def test_between_samples_it_is_what_the_machine_does(drives: str, tmp_path: Path) -> None:
    """Without weight, and slowly enough for no centrifugal force, the motion is nothing else."""
    model = mujoco.MjModel.from_xml_string(arm(drives, "0 0 0"))
    (tmp_path / "arm.xml").write_text(arm(drives, "0 0 0"))
    data, rng, each = mujoco.MjData(model), np.random.default_rng(1), 200
    u = 0.002 * rng.standard_normal((30, 2))
    q, v = np.zeros((30 * each, 2)), np.zeros((30 * each, 2))
    for k in range(30 * each):
        data.ctrl[:], q[k], v[k] = u[k // each], data.qpos, data.qvel
        mujoco.mj_step(model, data)
    t = STEP * np.arange(30 * each)
    commanded = held(Scene(tmp_path / "arm.xml"), t[::each], q[::each], u)
    assert commanded is not None
    found = commanded.response()
    assert found is not None
    inside = slice(each // 2, 29 * each, each // 4)
    assert np.abs(found(t[inside]) - q[inside]).max() < 0.01 * np.abs(q).max()
    assert np.abs(found(t[inside], 1) - v[inside]).max() < 0.01 * np.abs(v).max()


def test_it_is_the_same_piece_by_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm.xml").write_text(arm("position"))
    t = np.cumsum(np.random.default_rng(2).uniform(0.008, 0.012, 60))  # no two intervals are alike
    given = Scene(tmp_path / "arm.xml"), t, 0.3 * np.sin(np.outer(t, [3.0, 5.0]))
    commands = held(*given, np.cos(np.outer(t, [4.0, 2.0])))
    assert commands is not None
    whole = commands.response()
    monkeypatch.setattr(driven, "_AT_ONCE", 7)
    pieces = commands.response()
    assert whole is not None and pieces is not None
    assert pieces.c == pytest.approx(whole.c, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("body", "drives"),
    [
        ('<body><joint name="a"/><geom size=".1"/></body>', ""),
        (
            '<body><freejoint name="base"/><geom size=".1"/><body><joint name="a"/>'
            '<geom size=".1"/></body></body>',
            '<motor joint="a"/>',
        ),
    ],
)
def test_nothing_is_known_of_a_machine_without_drives_or_with_a_floating_base(
    body: str, drives: str, tmp_path: Path
) -> None:
    (tmp_path / "robot.xml").write_text(
        f"<mujoco><worldbody>{body}</worldbody><actuator>{drives}</actuator></mujoco>"
    )
    scene = Scene(tmp_path / "robot.xml")
    t, q, u = np.arange(20) / 100.0, *(np.zeros((20, n)) for n in (scene.model.nv, 1))
    assert held(scene, t, q, u) is None


@pytest.mark.parametrize("drives", DRIVES)
@pytest.mark.parametrize("lacks", ["", 'frictionloss=".05"', 'armature=".003"'])
def test_velocities_of_a_slow_log_are_known_whatever_the_model_lacks(
    drives: str, lacks: str, tmp_path: Path
) -> None:
    rate = {"position": 50.0, "torque": 100.0}[
        drives
    ]  # the loop that is closed over torques is fast
    recording, v = recorded(arm(drives, extra=lacks), rate)
    found = smoothed(tmp_path, arm(drives), recording)
    inside = slice(20, -20)
    error = np.sqrt(np.mean((found.at_samples[0][1] - v)[inside] ** 2, axis=0))
    alone = np.array({"position": [0.055, 0.16], "torque": [0.008, 0.05]}[drives])
    assert (error < {"": 0.2, 'frictionloss=".05"': 0.4}.get(lacks, 0.7) * alone).all()
    if not lacks:
        assert found.noise == pytest.approx([NOISE, NOISE], rel=0.1)


def test_forces_are_of_splines_alone(tmp_path: Path) -> None:
    found = smoothed(tmp_path, arm("torque"), recorded(arm("torque"), 100.0)[0])
    splines = [c.spline for c in found.splines[0]]
    said = np.stack([spline(found.motion.t, 2) for spline in splines], axis=1)
    assert found.motion.a == pytest.approx(said)
    assert all(c.beside is None for c in found.splines[0])


def test_states_are_as_unsure_as_curves_beside_the_response_are(tmp_path: Path) -> None:
    recording, v = recorded(arm("torque"), 100.0)
    found = smoothed(tmp_path, arm("torque"), recording)
    assert all(c.beside is not None for c in found.curves[0])
    error = np.sqrt(np.mean((found.at_samples[0][1] - v)[20:-20] ** 2, axis=0))
    assert (0.4 * error < found.unsure[0][2:]).all()
    assert (found.unsure[0][2:] < 2.0 * error).all()
    assert found.unsure[0][:2] == pytest.approx(0.5 * found.noise)


ROTOR = Planted(effects()["joint.armature"], Location("joint", "b"), np.array([0.02]))
"""More than twice the inertia that the second joint of the arm has without."""


@pytest.mark.parametrize("drives", DRIVES)
def test_once_a_rotor_is_found_states_are_those_beside_its_response(
    drives: str, tmp_path: Path
) -> None:
    true = arm(drives, extra='armature=".02"')
    recording, v = recorded(true, 50.0)
    given = smoothed(tmp_path, arm(drives), recording)
    found = beside(given, [Part(recording, 0)], (ROTOR,))
    (tmp_path / "true").mkdir()
    right = smoothed(tmp_path / "true", true, recording)
    assert found.noise == pytest.approx(right.noise, rel=1e-3)
    assert found.at_samples[0][1] == pytest.approx(right.at_samples[0][1], abs=1e-4)
    before, after = (
        np.sqrt(np.mean((each.at_samples[0][1] - v)[20:-20, 1] ** 2)) for each in (given, found)
    )
    assert after < 0.5 * before
    assert given.noise[1] > 1.2 * found.noise[1]
    # forces are of splines alone, and so is the screen
    assert found.motion is given.motion and found.splines is given.splines
    whole = smooth(given.motion.scene, [Part(recording, 0)], known=(ROTOR,))
    assert whole.noise == pytest.approx(found.noise)


LATE = Planted(effects()["actuator.delay"], Location("actuator", "all"), np.array([0.007]))
SLOW = Planted(effects()["actuator.lag"], Location("actuator", "b"), np.array([0.02]))


@pytest.mark.parametrize(
    ("found", "joint", "true"),
    [
        (LATE, 0, ('kp="', 'delay="0.007" nsample="72" interp="linear" kp="')),
        (LATE, 1, ('kp="', 'delay="0.007" nsample="72" interp="linear" kp="')),
        (SLOW, 1, ('kp="20"', 'timeconst="0.02" kp="20"')),
    ],
    ids=["late-a", "late-b", "slow-b"],
)
def test_once_commands_are_known_to_be_late_states_are_beside_what_arrives(
    found: Planted, joint: int, true: tuple[str, str], tmp_path: Path
) -> None:
    """A quiet encoder at 50 Hz seemed several times as noisy with commands 7 ms late."""
    recording, v = recorded(arm("position").replace(*true), 50.0, noise=1e-5)
    parts = [Part(recording, 0)]
    given = smoothed(tmp_path, arm("position"), recording)
    now = beside(given, parts, (found,))
    assert given.noise[joint] > 1.5 * now.noise[joint]
    assert now.noise[joint] == pytest.approx(1e-5, rel=0.35)
    before, after = (
        np.sqrt(np.mean((each.at_samples[0][1] - v)[20:-20, joint] ** 2)) for each in (given, now)
    )
    assert after < 0.2 * before
    assert smooth(given.motion.scene, parts, known=(found,)).noise == pytest.approx(now.noise)


@pytest.mark.parametrize(
    ("found", "rate"),
    [
        (replace(ROTOR, effect=effects()["joint.friction_coulomb"]), 50.0),
        (replace(ROTOR, theta=np.array([1e-6])), 50.0),
        (ROTOR, 1000.0),
    ],
    ids=["changes no response", "hardly changes it", "a log that needs none"],
)
def test_states_stay_where_what_was_found_moves_none(
    found: Planted, rate: float, tmp_path: Path
) -> None:
    recording, _ = recorded(arm("position"), rate, jerky=False, noise=1e-4)
    given = smoothed(tmp_path, arm("position"), recording)
    assert beside(given, [Part(recording, 0)], (found,)) is given


def test_what_adds_a_joint_leaves_the_response_as_it_was(tmp_path: Path) -> None:
    recording, _ = recorded(arm("position"), 50.0)
    given = smoothed(tmp_path, arm("position"), recording)
    gear = Planted(
        effects()["joint.elasticity"], Location("joint", "b"), np.array([200.0, 0.5, 0.01])
    )
    assert beside(given, [Part(recording, 0)], (gear,)) is given


def test_where_logs_are_faster_than_what_commands_do_curves_are_as_they_were(
    tmp_path: Path,
) -> None:
    recording, _ = recorded(arm("position"), 1000.0, jerky=False, noise=1e-4)
    found = smoothed(tmp_path, arm("position"), recording)
    assert all(c.beside is None for c in found.curves[0])


def test_jumps_move_a_joint_by_a_sixteenth_of_them_in_half_an_interval(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(
        '<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/>'
        '<geom size=".1" mass="2"/></body></worldbody>'
        '<actuator><motor joint="x"/></actuator></mujoco>'
    )
    t, u = np.arange(40) / 20.0, np.where(np.arange(40) % 2, 3.0, -3.0)[:, None]
    found = held(Scene(tmp_path / "cart.xml"), t, np.zeros((40, 1)), u)
    assert found is not None
    moved, turned = found.jolts
    assert moved == pytest.approx([3.0 * 0.05**2 / 16.0])
    assert turned == pytest.approx([3.0 * 0.05 / 8.0])
