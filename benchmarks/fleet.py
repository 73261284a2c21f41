"""A fleet: units of a two-joint arm over sessions, with known levels, in one passport.

Planted, by MJCF written by hand and stepped in plain MuJoCo: dry friction of the shoulder, the
same on all units (the model's); dry friction of the elbow, of each unit its own (the unit's);
strength of the elbow's drive, another in each session (the session's). In the last session of the
first unit the shoulder rubs more: that is to be found, in this session and in no other.

Usage: python benchmarks/fleet.py [--units 4] [--sessions 3] [--seconds 6] [--seed 0] [--search]

Without ``--search`` the three effects are named, and only estimated: a search of each unit's first
session takes most of the time, and is what the other trials are of.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np

from wt.data import recording as recordings
from wt.diagnose import again
from wt.passport.add import add
from wt.passport.card import card
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location, Recording

RATE, STEP = 100, 5e-4  # Hz, s
NOISE, NOISE_V = 5e-5, 2e-3  # rad, rad/s
SHOULDER, ELBOWS, WORN = 0.3, (0.18, 0.24, 0.3, 0.36), 0.12  # N·m
GAINS = 0.1  # standard deviation between sessions, of 1
KP = 40.0
ARM = """<mujoco model="arm"><compiler angle="radian"/>
<option timestep="{step}" integrator="implicitfast"/><worldbody>
<body><joint name="shoulder" axis="0 1 0" damping=".3" frictionloss="{shoulder}"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1.2"/>
<body pos="0 0 -.3"><joint name="elbow" axis="0 1 0" damping=".2" frictionloss="{elbow}"/>
<geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03" mass=".7"/></body></body></worldbody>
<actuator><position name="a1" joint="shoulder" kp="60" kv="3"/>
<position name="a2" joint="elbow" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""
LEVELS = {
    "joint.friction_coulomb/shoulder/coulomb": "model",
    "joint.friction_coulomb/elbow/coulomb": "unit",
    "actuator.gain/a2/factor": "session",
}
MOVED = "joint.friction_coulomb/shoulder/coulomb"


def mjcf(shoulder: float = 0.0, elbow: float = 0.0, gain: float = 1.0, step: float = STEP) -> str:
    """The arm with these figures."""
    kp, kv = gain * KP, gain * 2.0
    return ARM.format(step=step, shoulder=shoulder, elbow=elbow, kp=kp, kv=kv)


def record(
    xml: str, seconds: float, rng: np.random.Generator, meta: dict[str, object]
) -> Recording:
    """A multisine on both joints."""
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    t = np.arange(round(seconds * RATE)) / RATE
    rates, phases = np.array([[1.5, 3.4, 6.4], [1.9, 4.1, 8.7]]), rng.uniform(0, 2 * np.pi, (2, 3))
    u = 0.22 * np.sin(t[:, None, None] * rates + phases).sum(axis=2)
    q, v = np.empty_like(u), np.empty_like(u)
    for k, command in enumerate(u):
        q[k], v[k] = d.qpos, d.qvel
        d.ctrl[:] = command
        mujoco.mj_step(m, d, round(1 / (RATE * STEP)))
    q, v = q + rng.normal(0, NOISE, q.shape), v + rng.normal(0, NOISE_V, v.shape)
    columns = {}
    for i, (joint, drive) in enumerate((("shoulder", "a1"), ("elbow", "a2"))):
        columns |= {f"ctrl/{drive}": u[:, i], f"qpos/{joint}": q[:, i], f"qvel/{joint}": v[:, i]}
    return Recording(t, columns, meta)


def told(*_: object) -> Hypothesis:
    """The effects that are planted, in the place of a search."""
    start = {"shoulder": 0.25, "elbow": 0.25}
    dry = [
        Planted(effects()["joint.friction_coulomb"], Location("joint", j), np.array([x]))
        for j, x in start.items()
    ]
    gain = Planted(effects()["actuator.gain"], Location("actuator", "a2"), np.array([1.01]))
    return (*dry, gain)


def main() -> None:
    """Make the fleet, add session after session, and mark what is said."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=4)
    parser.add_argument("--sessions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--search", action="store_true")
    given = parser.parse_args()
    if not given.search:
        again.named = told
    rng, began, false, found = np.random.default_rng(given.seed), time.monotonic(), 0, False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.xml").write_text(mjcf(step=2e-3))
        for s in range(given.sessions):
            paths = []
            for u in range(given.units):
                moved = u == 0 and s == given.sessions - 1
                elbow, gain = ELBOWS[u % len(ELBOWS)], 1.0 + GAINS * rng.normal()
                xml = mjcf(SHOULDER + WORN * moved, elbow, gain)
                meta = {"unit": f"U{u}", "session": f"2026-01-{1 + 3 * s:02d}"}
                paths.append(folder / f"{u}-{s}.parquet")
                recordings.write(record(xml, given.seconds, rng, meta), paths[-1])
            added = add(folder / "arm.xml", paths, folder / "robot", every_group=False)
            of = card(added.passport.rows)
            for unit, quantity, state in of.alarms:
                right = s == given.sessions - 1 and (unit, str(quantity)) == ("U0", MOVED)
                found, false = found or right, false + (not right)
                print(
                    f"session {s}: alarm {unit} {quantity} p {state.change and state.change.p:.1e}"
                )
    right = 0
    for quantity, placed in of.levels.items():
        expected = LEVELS.get(str(quantity))
        right += expected == placed.level
        tests = {n: f"{t.p:.1e}" for n, t in placed.tests.items()}
        print(f"{quantity}: {placed.level}, planted {expected}; p {tests}; {placed.model}")
    seconds, count = time.monotonic() - began, given.units * given.sessions
    print(f"levels right: {right} of {len(LEVELS)}; drift found: {found}")
    print(f"false alarms: {false} in {count} unit-sessions; {seconds:.0f} s")


if __name__ == "__main__":
    main()
