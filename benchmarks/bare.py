"""What a diagnosis takes beside its physics, in ``wt diagnose`` and cases of ``wt prove``.

Every batch that a diagnosis makes is noted, with its models, its initial states and its steps; one
in so many is then stepped again by ``mujoco.batch`` alone, from the same states and under the
commands that it had last. All on one thread of one process, so that what is left is ours: audit,
smoothing, screen, least squares, pictures. Where laws act at every step they count as steps.

Usage: python benchmarks/bare.py [CASE …]       (parts of names of wt prove's cases)
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np

from wt.batch import Batch
from wt.diagnose.pipeline import diagnose
from wt.physics import stepping
from wt.physics.acting import Acting
from wt.physics.job import Job
from wt.physics.live_steps import Stepped
from wt.physics.spread import over
from wt.prove import bench
from wt.shipped import folder

CASES = ("arm3-joint.backlash", "arm6-joint.friction_coulomb")
SEED, EVERY = 0, 20
"""Seed of the cases; and of so many batches one is stepped again."""
ROW = "{:<44} {:>8} {:>10} {:>10} {:>7} {:>12} {:>12}"


@dataclass
class Noted:
    """A batch that was stepped: what it takes to step it again."""

    models: list[mujoco.MjModel]
    state: tuple[np.ndarray, np.ndarray]
    ctrl: np.ndarray
    steps: int = 0
    seconds: float = 0.0


class Watched(Batch):
    """A batch that notes what is done with it."""

    made: ClassVar[list[Noted]] = []

    def set_models(self, models: list[mujoco.MjModel]) -> None:
        """As in ``mujoco.batch``."""
        super().set_models(models)
        self._models = models
        self._noted: Noted | None = None

    def rollout(self, nstep: int, **given: object) -> dict[str, np.ndarray]:
        """As in ``mujoco.batch``."""
        with self._stepping(nstep):
            return dict(super().rollout(nstep, **given))

    @contextmanager
    def _stepping(self, steps: int) -> Iterator[None]:
        noted = self._noted
        if noted is None:
            state = self.bind("qpos").copy(), self.bind("qvel").copy()
            noted = self._noted = Noted(self._models, state, self.bind("ctrl").copy())
            self.made.append(noted)
        began = time.perf_counter()
        yield
        noted.seconds += time.perf_counter() - began
        noted.steps += steps
        noted.ctrl[:] = self.bind("ctrl")


class WatchedLaws(Stepped):
    """Replays in which laws act at every step, noted likewise."""

    def __init__(self, jobs: Sequence[Job], acts: Acting, threads: int) -> None:
        """As without being watched."""
        super().__init__(jobs, acts, threads)
        q, v = (np.stack(x) for x in zip(*(job.initial() for job in jobs), strict=True))
        ctrl = np.stack([job.inputs.u[-1, job.controls] for job in jobs])
        self._noted = Noted([job.model for job in jobs], (q, v), ctrl)
        Watched.made.append(self._noted)

    def path(self, piece: slice) -> np.ndarray:
        """As without being watched."""
        began = time.perf_counter()
        said = super().path(piece)
        self._noted.seconds += time.perf_counter() - began
        self._noted.steps += piece.stop - piece.start
        return said


def main(*cases: str) -> None:
    """Print the table."""
    print(ROW.format("one thread", "wall [s]", "steps [M]", "in them", "share", "steps/s", "bare"))
    arm = folder("examples") / "arm"
    row("wt diagnose examples/arm", arm / "model.xml", sorted(arm.glob("*.parquet")), [])
    for part in cases or CASES:
        case = bench.chosen("full", part, SEED)[0]
        with tempfile.TemporaryDirectory() as name:
            where = Path(name)
            bench.write_files(case, where)
            fit, held = (sorted(where.glob(f"{kind}-*")) for kind in ("fit", "holdout"))
            row(f"wt prove {case.name}", where / "robot.xml", fit, held)


def row(what: str, model: Path, fit: list[Path], holdout: list[Path]) -> None:
    """A diagnosis, and one in so many of its batches bare."""
    Watched.made.clear()
    stepping.Batch, stepping.Stepped = Watched, WatchedLaws  # type: ignore[misc]
    with over("1"):
        began = time.perf_counter()
        diagnose(model, fit, holdout)
        wall = time.perf_counter() - began
    stepping.Batch, stepping.Stepped = Batch, Stepped  # type: ignore[misc]
    inside = sum(n.seconds for n in Watched.made)
    steps = sum(n.steps * len(n.models) for n in Watched.made)
    some = Watched.made[::EVERY]
    bare = sum(n.steps * len(n.models) for n in some) / sum(map(again, some))
    print(
        ROW.format(
            what, f"{wall:.1f}", f"{steps / 1e6:.2f}", f"{inside:.1f} s", f"{inside / wall:.0%}",
            f"{steps / inside:.3g}", f"{bare:.3g}",
        ),
        flush=True,
    )  # fmt: skip


def again(noted: Noted) -> float:
    """Time that the steps of a batch take bare [s]."""
    batch = Batch(noted.models[0], nsim=len(noted.models), nthread=1)
    batch.set_models(noted.models)
    batch.bind("qpos")[:], batch.bind("qvel")[:] = noted.state
    batch.bind("ctrl")[:] = noted.ctrl
    began = time.perf_counter()
    batch.rollout(noted.steps)
    return time.perf_counter() - began


if __name__ == "__main__":
    main(*sys.argv[1:])
