"""Servos whose firmware does what no ``position`` actuator does, and models that have too much.

An arm of two joints: what is hidden is a servo's law, stepped by hand around plain MuJoCo, or a
figure that the model has and the arm has not. Two recordings of 15 s at 100 Hz under noise of .1
mrad, a third held out.

Usage: python benchmarks/firmware.py [NAME ...]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from wt.types import Recording

Array = np.ndarray
RATE, SECONDS, STEP, NOISE = 100, 15.0, 2.5e-4, 1e-4  # Hz, s, s, rad
KP, KV = np.array([80.0, 40.0]), np.array([4.0, 2.0])
MJCF = """\
<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body name="upper" pos="0 0 .5">
<joint name="shoulder" axis="0 1 0" damping="{damping}" armature=".02"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".025" mass="1"/>
<body name="fore" pos=".3 0 0">
<joint name="elbow" axis="0 1 0" damping=".1" armature=".01" frictionloss="{dry}"/>
<geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".6"/></body></body></worldbody>
<actuator>{drives}</actuator></mujoco>
"""
SERVOS = "".join(
    f'<position name="{joint}" joint="{joint}" kp="{kp}" kv="{kv}"/>'
    for joint, kp, kv in zip(("shoulder", "elbow"), KP, KV, strict=True)
)
MOTORS = '<motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/>'


@dataclass
class Servo:
    """A PD loop, and what firmware adds to it.

    Attributes:
        kp, kv: gains [N·m/rad], [N·m·s/rad].
        ki: integral gain [N·m/(rad·s)].
        forward: of the velocity by which commands move [N·m·s/rad].
        interpolates: whether it moves its goal from one command to the next by and by.
        speed, acceleration: most that its goal moves by [rad/s], [rad/s²].
    """

    kp: Array = field(default_factory=KP.copy)
    kv: Array = field(default_factory=KV.copy)
    ki: float = 0.0
    forward: float = 0.0
    interpolates: bool = False
    speed: float = np.inf
    acceleration: float = np.inf

    def run(self, mjcf: str, u: Array) -> Array:
        """Positions of the joints at each command."""
        model = mujoco.MjModel.from_xml_string(mjcf)
        model.opt.timestep = STEP
        data, steps = mujoco.MjData(model), round(1.0 / (RATE * STEP))
        q, integral, goal, rate = np.empty_like(u), np.zeros(2), u[0].copy(), np.zeros(2)
        for k in range(len(u)):
            q[k], last = data.qpos, u[max(k - 1, 0)]
            for step in range(steps):
                wanted = last + (u[k] - last) * step / steps if self.interpolates else u[k]
                if np.isfinite(self.speed):
                    left = wanted - goal
                    fast = np.sign(left) * np.sqrt(2.0 * self.acceleration * np.abs(left))
                    change = np.clip(fast, -self.speed, self.speed) - rate
                    most = self.acceleration * STEP
                    rate = rate + np.clip(change, -most, most)
                    goal = goal + rate * STEP
                else:
                    goal = wanted
                error = goal - data.qpos
                integral += error * STEP
                ahead = self.forward * (u[k] - last) * RATE
                data.ctrl[:] = self.kp * error - self.kv * data.qvel + self.ki * integral + ahead
                mujoco.mj_step(model, data)
        return q


@dataclass(frozen=True)
class Case:
    """What the arm has and the model has not, and what is right to say of it.

    Attributes:
        right: ids of effects, each at its joint; none if there is no name for it.
        servo: of the arm.
        damping, dry: of the model and of the arm [N·m·s/rad], [N·m].
    """

    right: tuple[str, ...]
    servo: Callable[[], Servo] = Servo
    damping: tuple[float, float] = (0.2, 0.2)
    dry: tuple[float, float] = (0.0, 0.0)


CASES = {
    "nothing": Case(()),
    "too-damped": Case(("joint.friction_viscous",), damping=(2.0, 0.5)),
    "too-dry": Case(("joint.friction_coulomb",), dry=(0.4, 0.1)),
    "less-feedback": Case(("actuator.damping",), lambda: Servo(kv=KV * [0.5, 1.0])),
    "gains": Case(
        ("actuator.gain", "joint.friction_viscous"),
        lambda: Servo(kp=KP * [0.8, 1.0], kv=KV * [1.3, 1.0]),
    ),
    "feed-forward": Case(("actuator.feedforward",) * 2, lambda: Servo(forward=2.0)),
    "interpolation": Case(("actuator.delay",), lambda: Servo(interpolates=True)),
    "integrator": Case(("actuator.integral",) * 2, lambda: Servo(ki=60.0)),
    "profile": Case(("actuator.profile",) * 2, lambda: Servo(speed=1.5, acceleration=8.0)),
}


def recordings(case: Case) -> list[Recording]:
    """Three of the arm."""
    mjcf = MJCF.format(damping=case.damping[1], dry=case.dry[1], drives=MOTORS)
    return [_recording(case.servo(), mjcf, seed) for seed in range(3)]


def _recording(servo: Servo, mjcf: str, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(int(SECONDS * RATE)) / RATE
    rate, phase = rng.uniform(0.15, 0.9, (4, 2)), rng.uniform(0.0, 6.28, (4, 2))
    u = 0.18 * np.sin(2.0 * np.pi * t[:, None, None] * rate + phase).sum(axis=1)
    u = u * np.minimum(t / 2.0, 1.0)[:, None] + 0.4 * (np.floor(t / 5.0) % 2)[:, None]
    q = servo.run(mjcf, u) + NOISE * rng.standard_normal(u.shape)
    names = ("shoulder", "elbow")
    columns = {f"qpos/{n}": q[:, i] for i, n in enumerate(names)}
    return Recording(t, columns | {f"ctrl/{n}": u[:, i] for i, n in enumerate(names)})


def main(names: Sequence[str]) -> None:
    """Diagnose the cases, and say what was found beside what is right."""
    from wt.diagnose.pipeline import diagnose

    for name in names or CASES:
        case = CASES[name]
        *fit, held = recordings(case)
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder) / "arm.xml"
            model.write_text(MJCF.format(damping=case.damping[0], dry=case.dry[0], drives=SERVOS))
            began = time.process_time()
            found = diagnose(model, fit, [held])
        said = sorted(f.effect for f in found.findings)
        right = "right" if said == sorted(case.right) else f"of {sorted(case.right)}"
        holdout = found.proof.holdout
        print(
            f"{name}: {found.verdict}, {right}: {1e3 * holdout.before:.3g} -> "
            f"{1e3 * holdout.after:.3g} mrad, {time.process_time() - began:.0f} s of processor"
        )
        for finding in found.findings:
            print(f"    {finding.statement}")


if __name__ == "__main__":
    main(sys.argv[1:])
