"""Physics steps of a six-joint arm in ``mujoco.batch``, with and without MuJoCo's step timer.

The sides take turns in one process; the table shows the median of each.

Usage: python benchmarks/steps.py
"""

from __future__ import annotations

import statistics
import time

import mujoco

from wt.batch import Batch, time_steps

STEPS, ARMS, TURNS = 5_000, 16, 7
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
