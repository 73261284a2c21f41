"""What one recording cannot settle: names after it, after asking, and after as many multisines.

A two-joint arm with servos and encoder noise of .1 mrad, in which one of two laws that look alike
is hidden; what it does by them is stepped by code of this file, which shares nothing with the
tool's. The recording that there is moves slowly under a load of one sign. Then `wt ask` has up to
three experiments of 20 s anywhere in the joints' ranges; the control has as many multisines of all
joints, as long.

Usage: python benchmarks/ask.py [CASE ...] [--seed S] [--jsonl FILE]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from wt.ask.loop import Experiments, Wish, ask
from wt.ask.robot import Robot
from wt.diagnose.experiment.excite import excite
from wt.diagnose.experiment.reach import Shown, reach_of
from wt.diagnose.pipeline import diagnose
from wt.diagnose.result import Diagnosis
from wt.physics.scene import Scene
from wt.types import Recording

RATE, NOISE, SECONDS, MOST = 100.0, 1e-4, 20.0, 3
KP, KV = np.array([120.0, 60.0]), np.array([6.0, 3.0])
ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.0005" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="j1" axis="0 1 0" damping=".5" range="-2.5 2.5"/>
      <geom type="capsule" fromto="0 0 0 0 0 .4" size=".05" mass="2" contype="0"/>
      <body name="fore" pos="0 0 .4">
        <joint name="j2" axis="0 1 0" damping=".5" range="-2.5 2.5"/>
        <geom type="capsule" fromto="0 0 0 .32 0 0" size=".04" mass="1" contype="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a1" joint="j1" kp="120" kv="6"/>
    <position name="a2" joint="j2" kp="60" kv="3"/>
  </actuator>
</mujoco>
"""
BALL = '<geom type="sphere" size=".02" pos=".32 0 0" mass=".25" contype="0"/>'


class Law:
    """Nothing hidden: what the drives do, and what brakes the joints."""

    def drive(self, wanted: np.ndarray, h: float) -> np.ndarray:
        """The command that acts, given the one that was sent."""
        return wanted

    def force(self, servo: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The drives' forces on the joints, given those that their servos ask for."""
        return servo


class Bias(Law):
    """A constant torque."""

    def force(self, servo: np.ndarray, v: np.ndarray) -> np.ndarray:
        """More by a constant."""
        return servo + np.array([0.0, 0.9])


class DeadBand(Law):
    """A drive that swallows its first torque."""

    def force(self, servo: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Less by the band, or nothing."""
        left = np.sign(servo[1]) * max(abs(servo[1]) - 0.9, 0.0)
        return np.array([servo[0], left])


class Late(Law):
    """Commands that arrive late."""

    def __init__(self) -> None:
        """Nothing was sent yet."""
        self.line: list[np.ndarray] = []

    def drive(self, wanted: np.ndarray, h: float) -> np.ndarray:
        """The one of 20 ms ago, at j2."""
        self.line.append(wanted.copy())
        late = self.line[max(0, len(self.line) - 1 - round(0.02 / h))]
        self.line = self.line[-round(0.03 / h) :]
        return np.array([wanted[0], late[1]])


class Lag(Law):
    """Commands behind a filter."""

    def __init__(self) -> None:
        """Nothing was sent yet."""
        self.state: float | None = None

    def drive(self, wanted: np.ndarray, h: float) -> np.ndarray:
        """First order, 20 ms, at j2."""
        before = wanted[1] if self.state is None else self.state
        self.state = before + h / 0.02 * (wanted[1] - before)
        return np.array([wanted[0], self.state])


class Dry(Law):
    """Friction that is the same at every speed."""

    def force(self, servo: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Less by .4 N·m at j2."""
        return servo - np.array([0.0, 0.4 * np.tanh(v[1] / 1e-3)])


class Stribeck(Law):
    """Friction that is larger at low speed."""

    def force(self, servo: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Less by .4 N·m at j2, and by .8 where it begins to slip."""
        level = 0.4 + 0.4 * np.exp(-((v[1] / 0.05) ** 2))
        return servo - np.array([0.0, level * np.tanh(v[1] / 1e-3)])


@dataclass(frozen=True)
class Case:
    """What is hidden, and what it is called.

    Attributes:
        effects: right names.
        at: right places.
        law: what it does.
        world: what is different in the MJCF.
    """

    effects: tuple[str, ...]
    at: tuple[str, ...]
    law: Callable[[], Law] = Law
    world: tuple[str, str] = ("", "")


CASES = {
    "bias": Case(("actuator.bias",), ("a2",), Bias),
    "deadband": Case(("actuator.deadband",), ("a2",), DeadBand),
    "delay": Case(("actuator.delay",), ("a2",), Late),
    "lag": Case(("actuator.lag",), ("a2",), Lag),
    "coulomb": Case(("joint.friction_coulomb",), ("j2",), Dry),
    "stribeck": Case(("joint.friction_stribeck",), ("j2",), Stribeck),
    "mass": Case(("body.mass",), ("fore",), world=('mass="1"', 'mass="1.25"')),
    "payload": Case(
        ("body.payload_fixed",), ("fore",), world=("</body>\n    </body>", f"{BALL}</body></body>")
    ),
}


class Machine(Robot):
    """The arm with something hidden."""

    def __init__(self, case: Case, seed: int) -> None:
        """Build it."""
        xml = ARM.replace(*case.world) if case.world[0] else ARM
        assert not case.world[0] or xml != ARM
        for kp, kv, drive in zip(KP, KV, ("a1", "a2"), strict=True):
            servo = f'<position name="{drive}" joint="j{drive[1]}" kp="{kp:g}" kv="{kv:g}"/>'
            assert servo in xml
            xml = xml.replace(servo, f'<motor name="{drive}" joint="j{drive[1]}"/>')
        self._model, self._law = mujoco.MjModel.from_xml_string(xml), case.law
        self._rng = np.random.default_rng(seed)
        self.worst = 0.0  # share of a joint's range that it came to

    def perform(self, number: int, commands: Recording) -> Recording:
        """Follow commands, from rest."""
        m, data, law = self._model, mujoco.MjData(self._model), self._law()
        u = np.stack([commands.columns[f"ctrl/{a}"] for a in ("a1", "a2")], axis=1)
        data.qpos[:] = [commands.columns[f"qpos/{j}"][0] for j in ("j1", "j2")]
        each, h = round(1.0 / (RATE * m.opt.timestep)), float(m.opt.timestep)
        q = np.empty_like(u)
        for k in range(-round(3.0 * RATE), len(u)):
            if k >= 0:
                q[k] = data.qpos
            for _ in range(each):
                acting = law.drive(u[max(k, 0)], h)
                servo = KP * (acting - data.qpos) - KV * data.qvel
                data.ctrl[:] = law.force(servo, data.qvel)
                mujoco.mj_step(m, data)
        self.worst = max(self.worst, float(np.abs(q / m.jnt_range[:, 1]).max()))
        q = q + NOISE * self._rng.standard_normal(q.shape)
        columns = {f"ctrl/a{i + 1}": u[:, i] for i in (0, 1)}
        columns |= {f"qpos/j{i + 1}": q[:, i] for i in (0, 1)}
        return Recording(np.arange(len(u)) / RATE, columns)


def poor(seed: int) -> Recording:
    """Commands of the recording that there is: slow, around poses with a load of one sign."""
    t, rng = np.arange(0.0, 12.0, 1.0 / RATE), np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.28, (2, 2))
    ramp = np.clip(t / 2.0, 0.0, 1.0) * np.clip((t[-1] - t) / 2.0, 0.0, 1.0)
    waves = [
        0.3 * np.sin(1.1 * t + phase[i, 0]) + 0.15 * np.sin(2.3 * t + phase[i, 1]) for i in (0, 1)
    ]
    q = np.stack([0.2 + ramp * waves[0], 0.1 + ramp * waves[1]], axis=1)
    columns = {f"ctrl/a{i + 1}": q[:, i] for i in (0, 1)}
    return Recording(t, columns | {f"qpos/j{i + 1}": q[:, i] for i in (0, 1)})


def named(case: Case, found: Diagnosis) -> str:
    """right, open (right, or among what it may be confused with), or wrong."""
    if len(found.findings) != 1:
        return "wrong"
    (finding,) = found.findings
    names = [(finding.effect, finding.at.name)]
    names += [(c.effect, c.at.name) for c in finding.confusable_with]
    hit = [effect in case.effects and at in case.at for effect, at in names]
    if hit[0] and len(names) == 1:
        return "right"
    return "open" if any(hit) else "wrong"


def run(name: str, seed: int) -> dict[str, object]:
    """One case: names after the recording, after asking, and by the control."""
    case, began = CASES[name], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "arm.xml"
        model.write_text(ARM)
        machine = Machine(case, seed)
        first = machine.perform(0, poor(seed))
        before = diagnose(model, [first])
        experiments = Experiments(machine, lambda *_: None)
        answer = ask(model, [first], experiments, Wish(SECONDS, MOST, whole_range=True, seed=seed))
        count = len(experiments.recorded)
        control, scene = before, Scene(model)
        if count:
            q = np.stack([first.columns[f"qpos/j{i}"] for i in (1, 2)], axis=1)
            shown = Shown("poor", False, q, np.gradient(q, 1.0 / RATE, axis=0), q)
            sines = [
                machine.perform(
                    0,
                    excite(scene, reach_of(scene, (shown,), True), (), SECONDS, RATE, "control", s),
                )
                for s in range(count)
            ]
            control = diagnose(model, sines, [first])
        return {
            "case": name,
            "seed": seed,
            "before": named(case, before),
            "asked": named(case, answer.diagnosis),
            "control": named(case, control),
            "experiments": count,
            "worst_share_of_range": round(machine.worst, 3),
            "stopped": answer.rounds[-1].reason,
            "said": [f.statement for f in answer.diagnosis.findings],
            "rivals": [c.effect for f in answer.diagnosis.findings for c in f.confusable_with],
            "seconds": round(time.perf_counter() - began),
        }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jsonl", type=Path)
    given = parser.parse_args()
    print(f"{'hidden':<12}{'before':>8}{'asked':>8}{'control':>9}{'experiments':>13}{'s':>6}")
    for name in given.cases or CASES:
        r = run(name, given.seed)
        line = f"{name:<12}{r['before']:>8}{r['asked']:>8}{r['control']:>9}{r['experiments']:>13}"
        print(f"{line}{r['seconds']:>6}  {r['stopped']}; {' '.join(r['said'])}", flush=True)  # type: ignore[arg-type]
        if given.jsonl:
            with given.jsonl.open("a") as file:
                file.write(json.dumps(r) + "\n")


if __name__ == "__main__":
    main()
