"""Pushes at a joint now and then: somebody's hand, a cable that catches, a neighbouring machine."""

from __future__ import annotations

import copy
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import FromRecordings, OnInputs, Shown
from wt.physics.motion import Motion
from wt.physics.pushes import Push, flat, of, pushes
from wt.physics.replay import Inputs
from wt.physics.scene import Scene
from wt.physics.script import Script, number, wrapped
from wt.physics.units import HINGE, Units
from wt.types import Location

_THRESHOLDS = (5.0, 9.0)  # robust deviations above the usual
_TOLD = 6
"""Pushes that a sentence lists."""


@register
class ForceIntermittent(FromRecordings, OnInputs):
    """τ = Σ torqueₖ · courseₖ(t): pushes, each with its own torque, time and flanks.

    When they are is no part of ``theta``: it stands in the signature's shape, five figures of a
    :class:`~wt.physics.pushes.Push` each, and :meth:`shaped` returns the effect that replays them,
    with one torque for each.
    """

    id = "joint.force_intermittent"
    kind = "joint"
    parameters = (Parameter("torque", "N·m", -1e8, 1e8, 1e-3, neutral=0.0),)
    reference = "S. Haddadin, A. De Luca and A. Albu-Schäffer, Robot collisions, IEEE T-RO 33, 2017"
    native = False
    odds_against = 8.0
    reads_residual = True
    read_off = sys.maxsize
    plotted_over = "time"
    pushes: tuple[Push, ...] = ()

    def shaped(self, shape: Shape) -> ForceIntermittent:
        """The effect bound to pushes."""
        bound = copy.copy(self)
        bound.pushes = of(shape)
        (torque,) = type(self).parameters
        axes = tuple(str(i + 1) for i in range(len(bound.pushes)))
        # instead of the class's: one component for each push
        bound.__dict__["parameters"] = (replace(torque, axes=axes),)
        return bound

    def elsewhere(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> Shown:
        """The pushes that these recordings show."""
        return self._of(pushes(motion, _left(motion, at), _THRESHOLDS[0]))

    def beside(self, theta: Float[np.ndarray, " parameter"], elsewhere: Shown) -> Shown:
        """The pushes of both."""
        effect, theirs = elsewhere
        more = effect.pushes if isinstance(effect, ForceIntermittent) else ()
        mine = [p._replace(height=x) for p, x in zip(self.pushes, theta, strict=False)]
        others = [p._replace(height=x) for p, x in zip(more, theirs, strict=False)]
        known = {p[:4] for p in mine}
        return self._of([*mine, *(p for p in others if p[:4] not in known)])

    def _of(self, pushed: Sequence[Push]) -> Shown:
        """The effect of some pushes, with the torques that they have."""
        if not pushed:
            return type(self)(), np.zeros(1)
        return self.shaped(flat(pushed)), np.array([p.height for p in pushed])

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Pushes that stand out of the residual of the joint."""
        if self.pushes:
            return [flat(self.pushes)]
        left = _left(motion, at)
        trains = {flat(pushes(motion, left, threshold)) for threshold in _THRESHOLDS}
        return sorted(shape for shape in trains if shape)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force per newton metre of each push."""
        courses = [np.zeros(len(motion)) for _ in of(shape)]
        for s in motion.segments:
            for push, course in zip(of(shape), courses, strict=True):
                if int(push.recording) == s.recording:
                    course[s.rows] = push.course(motion.t[s.rows])
        return motion.on(motion.scene.dof(at.name), *courses)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The torques."""
        return coefficients

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Push in this recording at its times."""
        torque = inputs.torque.setdefault(scene.dof(at.name), np.zeros(len(inputs.t)))
        for push, size in zip(self.pushes, theta, strict=False):
            if int(push.recording) == inputs.recording:
                torque += size * push.course(inputs.t)

    def observed(self) -> Mapping[str, tuple[str, tuple[float, ...]]]:
        """Recording of each push, and the start and end of each, one after another."""
        return {
            "recordings": ("-", tuple(p.recording for p in self.pushes)),
            "windows": ("s", tuple(x for p in self.pushes for x in p.window)),
        }

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Push in each recording at its times."""
        rows: dict[int, list[str]] = {}
        for push, size in zip(self.pushes, theta, strict=False):
            figures = ", ".join(map(number, (push.start, push.end, push.flank, size)))
            rows.setdefault(int(push.recording), []).append(f"({figures})")
        each = [f"    {i}: ({', '.join(rows_text)},)," for i, rows_text in rows.items()]
        force = (
            "pushes = {  # recording: middles of both flanks, their length [s], and torque",
            *(line for rows_text in each for line in wrapped(rows_text)),
            "}.get(self.recording, ())",
            f'_, _, dof = self._joint("{at.name}", qpos, qvel)',
            "for start, end, flank, torque in pushes:",
            "    course = np.tanh((t - start) / flank) - np.tanh((t - end) / flank)",
            "    f[:, dof] += 0.5 * torque * course / np.tanh(0.5 * (end - start) / flank)",
        )
        return Script(force=force, helpers=("joint",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        several = len({p.recording for p in self.pushes}) > 1
        said = []
        for push, size in zip(self.pushes, theta, strict=False):
            start, end = push.window
            where = f" of recording {int(push.recording) + 1}" if several else ""
            said.append(f"{size:.3g} {units.force} at {start:.2f}–{end:.2f} s{where}")
        more = f", and {len(said) - _TOLD} more" if len(said) > _TOLD else ""
        return f"Joint {at.name} is pushed now and then: {', '.join(said[:_TOLD])}{more}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"the same motion again, with nothing and nobody near {at.name}"


def _left(motion: Motion, at: Location) -> Float[np.ndarray, " sample"]:
    """What is left of a joint's residual, without moments of blows."""
    return np.where(motion.calm, motion.unexplained[:, motion.scene.dof(at.name)], 0.0)
