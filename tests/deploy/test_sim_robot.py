"""The simulated robot's drives obey the law of the real ones, and it looks after itself."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from deploy import go2
from deploy.idl import LowCmd_
from deploy.messages import Packed
from deploy.mischief import Mischief
from deploy.remote import Remote
from deploy.script import Script
from deploy.sim_robot import ENCODER_STEP, JOINTS, STALE_COMMAND, TICK, SimRobot
from wt.errors import ConfigError, ModelError
from wt.worlds.robots import mjcf

MOTOR = go2.motors(JOINTS)


@pytest.fixture
def robot() -> SimRobot:
    return SimRobot()


def command(**values: float) -> Packed:
    message = LowCmd_()
    for name, value in values.items():
        message.data["motor_cmd"][name][:12] = value
    return message.seal()


def test_it_lies_on_the_floor(robot: SimRobot) -> None:
    assert robot.data.qpos[2] < 0.12 and np.abs(robot.data.qvel).max() < 0.05
    state = go2.unpack(robot.state(Remote().pack()), MOTOR)
    np.testing.assert_allclose(state.position, robot.data.qpos[7:], atol=16e-6)
    assert state.quaternion[0] > 0.99 and state.battery == 100


def test_its_encoders_step_like_a_real_one_s(robot: SimRobot) -> None:
    """Of a real Go2's recorded positions the smallest differences are 30 µrad, at knees 16."""
    measured = go2.unpack(robot.state(Remote().pack()), MOTOR).position
    steps = np.tile([30.3e-6, 30.3e-6, 15.8e-6], 4)
    np.testing.assert_allclose(ENCODER_STEP, steps, rtol=2e-3)
    counts = measured / ENCODER_STEP
    np.testing.assert_allclose(counts, np.round(counts), atol=0.02)  # of a float32
    assert (np.abs(measured - robot.joints) <= 0.51 * ENCODER_STEP).all()


def test_torque_is_that_of_the_gains(robot: SimRobot) -> None:
    """kp·(q − measured) + kd·(dq − measured) + tau, up to what the drive can do."""
    rng = np.random.default_rng(0)
    message = LowCmd_()
    fields = message.data["motor_cmd"]
    for name, size in (("q", 0.3), ("dq", 1.0), ("tau", 3.0)):
        fields[name][MOTOR] = size * rng.normal(size=12)
    fields["q"][MOTOR] += robot.joints
    fields["kp"][MOTOR], fields["kd"][MOTOR] = rng.uniform(10, 60, 12), rng.uniform(1, 4, 12)
    sent = {name: fields[name][MOTOR].astype(float) for name in ("q", "dq", "tau", "kp", "kd")}
    assert robot.hear(message.seal(), now=0.0)
    for _ in range(5):
        robot.step(now=0.0)
    # its forces are those at the beginning of the last step
    mujoco.mj_forward(robot._model, robot.data)
    law = sent["kp"] * (sent["q"] - robot.joints) + sent["kd"] * (sent["dq"] - robot.speeds)
    limit = go2.drives(JOINTS).torque
    expected = np.clip(law + sent["tau"], -limit, limit)
    np.testing.assert_allclose(robot.data.actuator_force, expected, rtol=1e-5, atol=1e-4)


def test_a_damaged_command_is_not_obeyed(robot: SimRobot) -> None:
    message = command(kp=40.0)
    message.data["motor_cmd"]["kp"][3] = 400.0
    assert not robot.hear(message, now=0.0)
    assert not robot.command.stiffness.any()


def test_it_brakes_by_itself_when_commands_stop(robot: SimRobot) -> None:
    assert robot.hear(command(kp=40.0, kd=1.0), now=0.0)
    for k in range(30):
        now = k * TICK
        robot.step(now)
        if now <= STALE_COMMAND:
            assert not robot.stale and robot.command.stiffness.all()
        else:
            assert robot.stale and not robot.command.stiffness.any()
            assert (robot.command.damping > 0).all()
    assert robot.hear(command(kp=40.0, kd=1.0), now=0.1)
    robot.step(0.1)
    assert not robot.stale and robot.command.stiffness.all()


def test_mischief_does_what_it_says(robot: SimRobot) -> None:
    calf = go2.JOINTS.index("FL_calf_joint")

    def passed(kind: str) -> list[tuple[float, Packed]]:
        mischief = Mischief.parse(f"{kind}@1")
        out = []
        for k in range(800, 1200):
            message = robot.state(Remote().pack())
            message.data["tick"] = k
            out += [(k / 1e3, m) for m in mischief.pass_on(message.seal(), k / 1e3)]
        return out

    honest = robot.state(Remote().pack()).data["motor_state"]["q"]
    for kind in ("drop", "delay", "nan", "flip"):
        early = [m for t, m in passed(kind) if t < 1]
        assert len(early) == 200
        assert all((m.data["motor_state"]["q"] == honest).all() for m in early)
    assert [t for t, _ in passed("drop") if t >= 1] == []
    late = [(t, m) for t, m in passed("delay") if t >= 1]
    assert len(late) in (99, 100)
    assert all(100 <= round(1e3 * t) - int(m.data["tick"]) <= 101 for t, m in late)
    for kind, expected in (("nan", np.nan), ("flip", -honest[calf])):
        for message in (m for t, m in passed(kind) if t >= 1):
            np.testing.assert_equal(message.data["motor_state"]["q"][calf], np.float32(expected))
            assert message.data["crc"] == message.checksum()  # the line is fine, the sensor is not


def test_a_script_presses_and_moves() -> None:
    script = Script.parse(["5:walk=0.5,0,-1", "1:stand", "8:walk=0"])
    assert script.at(0.9) == Remote()
    assert script.at(1.1).buttons == {"L2", "A"} and script.at(1.3) == Remote()
    assert script.at(6.0) == Remote(forward=0.5, turn=-1.0) and script.at(8.0) == Remote()


@pytest.mark.parametrize("word", ["stand", "x:stand", "1:sit", "1:walk=2", "1:walk=a", "1:stand=1"])
def test_a_script_that_makes_no_sense_is_refused(word: str) -> None:
    with pytest.raises(ConfigError, match="write SECONDS:stand"):
        Script.parse([word])


@pytest.mark.parametrize(
    ("text", "said"), [("dorp@1", "did you mean 'drop'"), ("drop", "e.g. drop@6"), ("", "allowed")]
)
def test_a_fault_that_makes_no_sense_is_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Mischief.parse(text)


def test_it_may_be_another_go2_from_a_file(tmp_path: Path) -> None:
    """A drive that is told a quarter turn away comes less far against a worn gear."""
    reached = []
    for name, dry in (("new", 'frictionloss="0.2"'), ("worn", 'frictionloss="6"')):
        path = tmp_path / f"{name}.xml"
        path.write_text(mjcf("go2", hung=True).replace('frictionloss="0.2"', dry))
        robot = SimRobot(machine=path)
        assert robot.hung and robot._model.opt.timestep == 0.001
        message = LowCmd_()
        fields = message.data["motor_cmd"]
        fields["q"][MOTOR] = robot.joints + 0.25
        fields["kp"][MOTOR], fields["kd"][MOTOR] = 20.0, 1.0
        begin = robot.joints.copy()
        assert robot.hear(message.seal(), now=0.0)
        for _ in range(200):
            robot.step(now=0.0)
        reached.append(np.abs(robot.joints - begin).mean())
    assert reached[1] < 0.5 * reached[0]


def test_what_is_no_go2_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.xml"
    for text, why in (
        ("<mujoco", "does not load"),
        ("<mujoco/>", "lacks the joints FL_hip_joint … RR_calf_joint, the drives"),
        (mjcf("go2").replace('name="gyro"', 'name="turn"'), "lacks the sensor gyro, one"),
    ):
        path.write_text(text)
        with pytest.raises(ModelError, match=why):
            SimRobot(machine=path)
