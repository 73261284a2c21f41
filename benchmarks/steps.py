"""Physics steps of a six-joint arm in ``mujoco.batch``, and what is added to them.

MuJoCo's own step timer, on and off; then replays of a hypothesis with a law at every joint, beside
replays without one. The sides take turns in one process; the tables show the median of each.

Usage: python benchmarks/steps.py
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from wt.batch import Batch, time_steps
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.physics.spread import over
from wt.types import Location

STEPS, ARMS, TURNS = 5_000, 16, 7
REPLAYS = (1, 4, 16)
_LINK = (
    '<body pos="0 0 .2"><joint axis="{axis}"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 .2" size=".02"/>'
)
_ARM = (
    '<mujoco><option timestep="5e-4"/><worldbody>'
    + "".join(_LINK.format(axis=axis) for axis in ("0 0 1", "0 1 0") * 3)
    + "</body>" * 6
    + "</worldbody></mujoco>"
)


def main() -> None:
    """Print the table."""
    batch = Batch(mujoco.MjModel.from_xml_string(_ARM), ARMS, 1)
    turns = [(seconds(batch, True), seconds(batch, False)) for _ in range(TURNS)]
    timed, untimed = (statistics.median(side) for side in zip(*turns, strict=True))
    print(f"{ARMS} arms of six joints, {STEPS} steps, one thread, {TURNS} turns")
    for name, took in (("mujoco.batch", timed), ("wt.batch, without the timer", untimed)):
        print(f"{name:<32}{took:>8.3f} s{STEPS * ARMS / took:>14,.0f} steps/s")
    print(f"{'ratio':<32}{timed / untimed:>8.2f}")
    with tempfile.TemporaryDirectory() as folder, over(1):
        path = Path(folder) / "arm.xml"
        path.write_text(_ARM)
        _laws(Scene(path))


def _laws(scene: Scene) -> None:
    """Print the table of replays with laws."""
    effect, theta = effects()["joint.friction_directional"], np.array([0.02, 0.03, 0.01, 0.02])
    law = [Planted(effect, Location("joint", joint), theta) for joint in scene.joints]
    t = np.arange(STEPS // 10) * 5e-3
    still = np.zeros(scene.model.nv)
    replayer = Replayer(scene, [Stretch(0, t, np.zeros((len(t), 0)), still + 0.1, still)], 5e-4)
    steps = round(t[-1] / replayer.step)
    print(f"\nfriction that differs with the direction at {len(law)} joints, a law each")
    print(f"{'replays side by side':<32}{'with':>8}{'without':>10} [µs a step and replay]")
    for count in REPLAYS:
        turns = [
            [replayed(replayer, [hypothesis] * count) / steps / count for hypothesis in (law, ())]
            for _ in range(TURNS)
        ]
        given, none = (1e6 * statistics.median(side) for side in zip(*turns, strict=True))
        print(f"{count:<32}{given:>8.2f}{none:>10.2f}")


def replayed(replayer: Replayer, hypotheses: Sequence[Sequence[Planted]]) -> float:
    """Duration of replays of some hypotheses [s]."""
    began = time.perf_counter()
    replayer.part(hypotheses, [0], 1)  # what was run before is not remembered there
    return time.perf_counter() - began


def seconds(batch: Batch, timer: bool) -> float:
    """Duration of some steps from the same start."""
    time_steps(timer)
    batch.reset()
    batch.bind("qpos")[:] = 0.1
    began = time.perf_counter()
    batch.step(nstep=STEPS)
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
