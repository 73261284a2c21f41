"""Toys: machines of one to three joints with one simple effect each, diagnosed and marked.

Every toy is one recording of 6 to 20 s at 100 Hz, positions alone or with velocities, under noise
of .01, .1 or 1 mrad, driven by positions or by torques, from a soft start or a jump. What is hidden
is MJCF written by hand, stepped by plain MuJoCo. It is named and explained, or counts as wrong.

Usage: python benchmarks/toys.py [NUMBER ...] [--decisions]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from wt.types import Recording

RATE, STEP = 100, 5e-4  # Hz, s
NOISES = (1e-5, 1e-4, 1e-3)  # rad
EFFECTS = (
    "joint.friction_coulomb",
    "joint.friction_viscous",
    "joint.armature",
    "joint.stiffness",
    "body.payload_fixed",
    "actuator.gain",
    "actuator.bias",
    "actuator.delay",
)
ALSO_RIGHT = {"body.payload_fixed": ("body.mass", "body.com")}
"""Where a load sits on a link's own line, more mass there says the same of its motion."""
AXES = ("0 1 0", "0 1 0", "1 0 0")
KP, KV = (90.0, 60.0, 30.0), (5.0, 3.0, 1.5)
ROTORS = (0.15, 0.05, 0.01)
"""Inertia of rotors [kg·m²]: about half of what each joint moves, as behind a gear."""
MASS, LENGTH = (1.2, 0.8, 0.5), (0.4, 0.3, 0.25)
DELAY_S = {"position": 0.03, "torque": 0.01}
"""Longer ones make a loop that is closed over torques swing without end, as nobody would record."""


@dataclass(frozen=True)
class Toy:
    """One toy; ``place`` is the index of its joint, link or drive that differs."""

    number: int
    joints: int
    effect: str
    place: int
    noise: float
    seconds: float
    torque: bool
    hard: bool
    velocity: bool

    def __str__(self) -> str:
        """In one line."""
        drive, start = "torque" if self.torque else "position", "hard" if self.hard else "soft"
        return (
            f"{self.number:3d} {self.joints} {self.effect}@{self.place + 1} {1e3 * self.noise:g} "
            f"mrad {self.seconds:.0f} s {drive} {start}{' qvel' if self.velocity else ''}"
        )


def toy(number: int) -> Toy:
    """The toy of a number; every eight have every effect once."""
    rng = np.random.default_rng(number)
    joints = int(rng.integers(1, 4))
    return Toy(
        number=number,
        joints=joints,
        effect=EFFECTS[number % len(EFFECTS)],
        place=int(rng.integers(joints)),
        noise=NOISES[int(rng.integers(3))],
        seconds=float(rng.uniform(6.0, 20.0)),
        torque=bool(rng.integers(2)),
        hard=bool(rng.integers(2)),
        velocity=bool(rng.integers(2)),
    )


def mjcf(made: Toy, hidden: bool) -> str:
    """The machine as the user has it, or with what is hidden in it."""

    def here(effect: str, i: int) -> bool:
        return hidden and made.effect == effect and made.place == i

    bodies = ""
    for i in range(made.joints):
        extra = ' frictionloss=".5"' if here("joint.friction_coulomb", i) else ""
        extra += f' armature="{ROTORS[i]}"' if here("joint.armature", i) else ""
        extra += ' stiffness="4" springref=".3"' if here("joint.stiffness", i) else ""
        damping = 0.7 if here("joint.friction_viscous", i) else 0.1
        # above the axis of the next joint: on it, it would be either link's
        load = f'<geom type="sphere" size=".03" pos=".02 0 {0.05 - LENGTH[i]:.3g}" mass=".5"/>'
        bodies += (
            f'<body name="l{i + 1}" pos="0 0 {-LENGTH[i - 1] * (i > 0)}">'
            f'<joint name="j{i + 1}" axis="{AXES[i]}" damping="{damping}"{extra}/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 {-LENGTH[i]}" size=".03" mass="{MASS[i]}"/>'
            f"{load if here('body.payload_fixed', i) else ''}"
        )
    drives = ""
    for i in range(made.joints):
        gain = 0.75 if here("actuator.gain", i) else 1.0
        bias = 0.8 if here("actuator.bias", i) else 0.0
        kp, kv = (0.0, 0.0) if made.torque else (gain * KP[i], gain * KV[i])
        drives += (
            f'<general name="a{i + 1}" joint="j{i + 1}" biastype="affine" '
            f'gainprm="{gain if made.torque else kp}" biasprm="{bias} {-kp} {-kv}"/>'
        )
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP}" integrator="implicitfast"/>'
        f"<worldbody>{bodies}{'</body>' * made.joints}</worldbody>"
        f"<actuator>{drives}</actuator></mujoco>"
    )


def record(made: Toy) -> Recording:
    """The real toy's recording."""
    model = mujoco.MjModel.from_xml_string(mjcf(made, hidden=True))
    data, nv = mujoco.MjData(model), model.nv
    rng = np.random.default_rng(1000 + made.number)
    n = int(made.seconds * RATE)
    t = np.arange(n) / RATE
    rate, phase = rng.uniform(0.15, 1.2, (4, nv)), rng.uniform(0.0, 6.28, (4, nv))
    size = rng.uniform(0.1, 0.25, (4, nv))
    goal = (size * np.sin(2.0 * np.pi * t[:, None, None] * rate + phase)).sum(axis=1)
    goal += 0.3 * (np.floor(t / 1.7) % 2)[:, None]  # steps, too
    if not made.hard:
        goal *= np.minimum(t / 2.0, 1.0)[:, None]
    late = np.zeros(nv, dtype=int)
    if made.effect == "actuator.delay":
        late[made.place] = round(DELAY_S["torque" if made.torque else "position"] * RATE)
    q, v, u = np.empty((n, nv)), np.empty((n, nv)), np.empty((n, nv))
    for k in range(n):
        q[k], v[k], u[k] = data.qpos, data.qvel, goal[k]
        if made.torque:
            kp, kv = np.array(KP[:nv]), np.array(KV[:nv])
            u[k] = 0.5 * kp * (goal[k] - data.qpos) - 0.5 * kv * data.qvel
        data.ctrl[:] = [u[max(k - late[i], 0), i] if k >= late[i] else 0.0 for i in range(nv)]
        mujoco.mj_step(model, data, nstep=round(1.0 / (RATE * STEP)))
    q += made.noise * rng.standard_normal(q.shape)
    v += 20.0 * made.noise * rng.standard_normal(v.shape)
    columns = {f"qpos/j{i + 1}": q[:, i] for i in range(nv)}
    columns |= {f"ctrl/a{i + 1}": u[:, i] for i in range(nv)}
    if made.velocity:
        columns |= {f"qvel/j{i + 1}": v[:, i] for i in range(nv)}
    return Recording(t, columns)


def run(made: Toy, decisions: bool) -> bool:
    """Diagnose one toy and print what became of it; True if it is right."""
    from wt.diagnose.pipeline import diagnose

    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "toy.xml"
        model.write_text(mjcf(made, hidden=False))
        began = time.perf_counter()
        found = diagnose(model, [record(made)])
    named = [(f.effect, f.at.name[-1:]) for f in found.findings]
    truths = {made.effect, *ALSO_RIGHT.get(made.effect, ())}
    right = (
        found.verdict == "explained"
        and len(named) == 1
        and named[0][0] in truths
        and named[0][1] == str(made.place + 1)
    )
    holdout = found.proof.holdout
    print(
        f"{'ok   ' if right else 'WRONG'} {made}: {found.verdict} "
        f"{[f'{e}@{p}' for e, p in named]} {holdout.before:.2e} -> {holdout.after:.2e} "
        f"({holdout.noise_floor:.1e}) {time.perf_counter() - began:.0f} s",
        flush=True,
    )
    if not right:
        for finding in found.findings:
            print(f"      {finding.statement} {finding.holdout_gain:.3f} {finding.p_value:.1e}")
    if decisions:
        for d in found.decisions:
            if d.kept or d.stage not in ("screened", "replayed"):
                print(f"      {d.stage} {d.effect}@{d.at.name} {d.kept} {d.statistic} {d.reason}")
    return right


def main(argv: Sequence[str] | None = None) -> int:
    """Run the toys; 0 when all are right."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("numbers", nargs="*", type=int, help="which toys (default: 0 to 23)")
    parser.add_argument("--decisions", action="store_true", help="print what was decided, too")
    args = parser.parse_args(argv)
    right = [run(toy(i), args.decisions) for i in args.numbers or range(24)]
    print(f"{sum(right)} of {len(right)} right")
    return 0 if all(right) else 1


if __name__ == "__main__":
    raise SystemExit(main())
