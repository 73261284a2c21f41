"""Replays of recordings on patched models, many at once with ``mujoco.batch``."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.activation import late
from wt.physics.job import Job, Patched
from wt.physics.lean import rest_idle
from wt.physics.limbs import Limb, Limbs, limbs
from wt.physics.planted import Planted
from wt.physics.quiet import quiet
from wt.physics.remembered import Contents, Remembered, contents
from wt.physics.replay import Inputs, Stretch
from wt.physics.runner import chosen
from wt.physics.scene import Scene
from wt.physics.stepping import simulate

_ALIKE, _ALIKE_LIVE = 0.75, 0.5
"""Replays that need this share of the steps of the longest take as many: more calls cost more, and
most where a law acts at every step."""


@dataclass(frozen=True, eq=False)
class Replays:
    """Reports of replays of hypotheses at the samples of all stretches, one after another.

    Attributes:
        q: joint positions, (H, N, nv); NaN where a replay exploded.
        v: joint velocities, (H, N, nv).
    """

    q: Float[np.ndarray, "hypothesis sample dof"]
    v: Float[np.ndarray, "hypothesis sample dof"]


class Replayer:
    """Replays stretches of recordings on models patched by hypotheses.

    The simulations of a call run side by side, on a compiled model for each set of effects that the
    model holds; what acts in the replay itself needs none of its own. Where they run is
    for :func:`wt.physics.spread.over` to say.
    """

    def __init__(self, scene: Scene, stretches: Sequence[Stretch], step: float = 5e-4) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            step: physics step [s]. It need not divide the sampling interval: commands are averaged
                over steps, and what sensors report is interpolated between them.
        """
        self.scene = scene
        self.stretches = tuple(stretches)
        self.step = step
        lengths = [(s.t[-1] - s.t[0]) / self.step for s in self.stretches]
        self._steps = {
            live: dict(zip(self.stretches, _shared(lengths, alike), strict=True))
            for live, alike in ((False, _ALIKE), (True, _ALIKE_LIVE))
        }
        self._inputs: dict[tuple[Stretch, int], Inputs] = {}
        self._known = Remembered()

    def run(self, hypotheses: Sequence[Sequence[Planted]]) -> Replays:
        """Replay every stretch on every hypothesis, unless that has been done lately."""
        if not hypotheses:
            return Replays(*chosen().replay(self, []))
        return Replays(*self._known.paths(hypotheses, self._new))

    def _new(
        self, hypotheses: list[Sequence[Planted]]
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """Replay hypotheses where the chosen runner runs them: positions and velocities.

        Limbs that are independent are replayed apart, each as often as hypotheses differ in it, and
        from what was replayed of it lately.
        """
        parts = [None if self._limbs is None else self._limbs.on(h) for h in hypotheses]
        apart = [(h, part) for h, part in enumerate(parts) if part is not None]
        whole = [h for h, part in enumerate(parts) if part is None]
        if not apart:
            return chosen().replay(self, hypotheses)
        samples = sum(len(s.t) for s in self.stretches)
        path = np.empty((2, len(hypotheses), samples, self.scene.model.nv))
        if whole:
            path[:, whole] = chosen().replay(self, [hypotheses[h] for h in whole])
        for k, (limb, own) in enumerate(self._own):
            said = own.run([part[k] for _, part in apart])
            for i, (h, _) in enumerate(apart):
                path[0, h][:, limb.dofs], path[1, h][:, limb.dofs] = said.q[i], said.v[i]
        return path

    @functools.cached_property
    def _limbs(self) -> Limbs | None:
        motion = self.stretches[0].motion
        return None if motion is None else limbs(self.scene, motion)

    @functools.cached_property
    def _own(self) -> tuple[tuple[Limb, Replayer], ...]:
        """Each limb, with the replays of it alone."""
        each = self._limbs.each if self._limbs else ()
        return tuple(
            (limb, Replayer(limb.scene, [limb.stretch(s) for s in self.stretches], self.step))
            for limb in each
        )

    @quiet()  # replays of bad hypotheses explode, and NaN says it
    def part(
        self, hypotheses: Sequence[Sequence[Planted]], stretches: Sequence[int], threads: int
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """Replay some stretches on some hypotheses in this process.

        What one replay says does not depend, to the bit, on which others run beside it.

        Args:
            hypotheses: H of them.
            stretches: indices of the stretches.
            threads: how many to use; 0 for one a core.

        Returns:
            Positions and velocities at the N samples of these stretches, one after another,
            (2, H, N, nv); NaN where a replay exploded.
        """
        samples = [len(self.stretches[s].t) for s in stretches]
        ends = np.cumsum(samples)
        path = np.full((2, len(hypotheses), int(ends[-1]), self.scene.model.nv), np.nan)
        groups: dict[tuple[object, ...], list[tuple[int, int, Job]]] = {}
        models: dict[Contents, mujoco.MjModel] = {}
        for h, hypothesis in enumerate(hypotheses):
            written = contents([p for p in hypothesis if p.in_model])
            try:
                model = models[written] if written in models else self.compile(hypothesis)
            except (ValueError, mujoco.FatalError):
                # MuJoCo refuses such parameters: as bad as a replay that explodes
                continue
            models[written] = model
            patched = Patched(self.scene, hypothesis, model)
            for k, s in enumerate(stretches):
                stretch = self.stretches[s]
                job = Job(patched, stretch, self.inputs(stretch, patched.live))
                groups.setdefault(job.layout, []).append((h, k, job))
        for members in groups.values():
            for outputs, (h, k, _) in zip(
                simulate([job for *_, job in members], threads), members, strict=True
            ):
                rows = slice(ends[k] - samples[k], ends[k])
                path[0, h, rows], path[1, h, rows] = outputs.q, outputs.v
        return path

    def inputs(self, stretch: Stretch, live: bool = False) -> Inputs:
        """Inputs of a stretch before any effect changes them, where a law is live or none is."""
        h, steps = self.step, self._steps[live][stretch]
        if (stretch, steps) not in self._inputs:
            before = stretch.steps_before(h)
            t = stretch.t[0] + h * np.arange(-before, steps)
            u = stretch.commands(h, steps, before)
            given = Inputs(stretch.recording, t, h, u, before=before, stretch=stretch)
            for i in late(self.scene.model):
                own = float(self.scene.model.actuator_delay[i])
                given.u[:, i] = given.delayed(given.u[:, i], own)
            self._inputs[stretch, steps] = given
        return self._inputs[stretch, steps]

    def compile(self, hypothesis: Sequence[Planted]) -> mujoco.MjModel:
        """The model of a hypothesis, with the replays' time step."""
        spec = self.scene.slim.copy()
        spec.option.timestep = self.step
        for planted in hypothesis:
            planted.model(spec)
        model = spec.compile()
        rest_idle(model)
        return model


def _shared(lengths: Sequence[float], alike: float) -> list[int]:
    """Steps that each stretch takes, of those that it needs: nearly as many run side by side."""
    needed = [max(1, int(np.ceil(length - 1e-6))) for length in lengths]
    taken, most = [0] * len(needed), 0
    for i in sorted(range(len(needed)), key=lambda i: -needed[i]):
        if needed[i] < alike * most or not most:
            most = needed[i]
        taken[i] = most
    return taken
