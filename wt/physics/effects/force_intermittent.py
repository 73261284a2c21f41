"""Pushes at a joint now and then: somebody's hand, a cable that catches, a neighbouring machine."""

from __future__ import annotations

import copy
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import Evident, OnInputs, Shown
from wt.physics.motion import Motion
from wt.physics.pushes import CLEAR, Push, flat, of, pushes
from wt.physics.replay import Inputs
from wt.physics.scene import Scene
from wt.physics.script import Script, number, wrapped
from wt.physics.units import HINGE, Units
from wt.physics.usual import SMOOTH_S, smoothed, unusual
from wt.types import Location

_THRESHOLDS = (Evident.DEVIATIONS, 9.0)
_LEAST = 0.02
"""Share of a joint's large forces that a push has at least."""
_SMOOTHED = 4.3
"""Length of a bell from a tenth of its height to a tenth, in its deviations."""
_COURSE = 0.1
"""Deviation [share] of a push's height, since none has the very course that is fitted."""
_TURNING = 0.5
"""Share of a joint's dry friction that a push has at least."""
_MEET_S = 0.1
"""Time between pushes that are looked at together [s]: no push is shorter."""
_TOLD = 6
"""Pushes that a sentence lists."""


@register
class ForceIntermittent(Evident, OnInputs):
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
    momentary = True
    plotted_over = "time"
    pushes: tuple[Push, ...] = ()
    everywhere: bool = False
    """Whether these are the pushes of all recordings there are."""

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
        if self.everywhere:
            return self, theta
        return self._of(seen(motion, at, _THRESHOLDS[0]))

    def beside(self, theta: Float[np.ndarray, " parameter"], elsewhere: Shown) -> Shown:
        """The pushes of both."""
        effect, theirs = elsewhere
        more = effect.pushes if isinstance(effect, ForceIntermittent) else ()
        mine = [p._replace(height=x) for p, x in zip(self.pushes, theta, strict=False)]
        others = [p._replace(height=x) for p, x in zip(more, theirs, strict=False)]
        known = {p[:4] for p in mine}
        return self._of([*mine, *(p for p in others if p[:4] not in known)])

    def evident(
        self, motion: Motion, at: Location
    ) -> (
        tuple[ForceIntermittent, Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]
        | None
    ):
        """All pushes on the joint; where feet step, no force stands out of the usual ones."""
        found = [] if motion.scene.free else seen(motion, at)
        if not found:
            return None
        effect, theta = self._of(found)
        effect.everywhere = True
        # a bell that is smoothed by another loses height, and its error grows with what it lost
        usual = float(unusual(motion).deviation[motion.scene.dof(at.name)])
        length = np.array([np.ptp(p.window) for p in found])
        error = usual * np.hypot(1.0, _SMOOTHED * SMOOTH_S / length)
        return effect, theta, 2.0 * np.hypot(error, _COURSE * theta)

    def only(
        self, theta: Float[np.ndarray, " parameter"], kept: Bool[np.ndarray, " parameter"]
    ) -> Shown:
        """Some of the pushes."""
        effect = self.shaped(flat([p for p, k in zip(self.pushes, kept, strict=True) if k]))
        return effect, theta[kept]

    def _of(
        self, pushed: Sequence[Push]
    ) -> tuple[ForceIntermittent, Float[np.ndarray, " parameter"]]:
        """The effect of some pushes, with the torques that they have."""
        if not pushed:
            return type(self)(), np.zeros(1)
        return self.shaped(flat(pushed)), np.array([p.height for p in pushed])

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Pushes that stand out of the residual of the joint."""
        if self.pushes:
            return [flat(self.pushes)]
        trains = {flat(seen(motion, at, threshold)) for threshold in _THRESHOLDS}
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


def seen(motion: Motion, at: Location, threshold: float = _THRESHOLDS[0]) -> list[Push]:
    """Pushes on a joint, which do not show in the same positions at other times.

    Nor are any where something brakes the joint for a while: that turns as the motion does.

    Args:
        motion: the recordings.
        at: the joint.
        threshold: robust deviations of what models are usually off by, from which a push shows.
    """
    dof, left = motion.scene.dof(at.name), unusual(motion)
    force = np.where(motion.calm, left.force[:, dof], 0.0)
    demand = smoothed(motion, motion.demand[:, dof])
    least = _LEAST * float(np.quantile(np.abs(demand), 0.95))
    # where a joint turns back, friction is known no better than when
    dry = float(left.dry[dof])
    least = max(threshold * float(left.deviation[dof]), least, _TURNING * dry)
    level = least + dry * left.still[:, dof]
    found, smooth = pushes(motion, force, level), smoothed(motion, force)
    then = [p for p in found if _only_then(motion, dof, smooth, p)]
    return [p for train in _trains(then) if not _brake(motion, dof, smooth, train) for p in train]


def _trains(found: Sequence[Push]) -> list[list[Push]]:
    """Pushes of which each begins where the one before ends, together."""
    trains: list[list[Push]] = []
    for push in found:
        last = trains[-1][-1] if trains else None
        meets = last is not None and push.window[0] - last.window[1] < _MEET_S
        if last is not None and meets and push.recording == last.recording:
            trains[-1].append(push)
        else:
            trains.append([push])
    return trains


def _brake(
    motion: Motion, dof: int, force: Float[np.ndarray, " sample"], train: Sequence[Push]
) -> bool:
    """Whether one force against the motion explains what several pushes in a row are read off.

    It has one figure where they have five each, so that it need not be better: it is to explain as
    much of a moment as a push has to. Where the joint never turned it may be either.
    """
    if len(train) < 2:
        return False
    rows = np.zeros(len(motion), bool)
    for s in motion.segments:
        if s.recording == int(train[0].recording):
            t = motion.t[s.rows]
            rows[s.rows] = (t >= train[0].window[0]) & (t <= train[-1].window[1])
    against = smoothed(motion, -np.sign(motion.v[:, dof]) * rows)[rows]
    against, acted = against - against.mean(), force[rows] - force[rows].mean()
    size = float(against @ acted) / (float(against @ against) + 1e-12)
    left = float(((acted - size * against) ** 2).sum())
    return size > 0.0 and left < (1.0 - CLEAR) * float((acted**2).sum())


def _only_then(motion: Motion, dof: int, force: Float[np.ndarray, " sample"], push: Push) -> bool:
    """Whether the joint feels no such force where it is pushed, at other times."""
    course = np.zeros(len(motion))
    for s in motion.segments:
        if s.recording == int(push.recording):
            course[s.rows] = push.course(motion.t[s.rows])
    q, then = motion.q[:, dof], course > 0.5
    low, high = q[then].min(), q[then].max()
    other = (course < 0.01) & (q >= low) & (q <= high)
    like = force[other] * np.sign(push.height) > 0.5 * np.abs(force[then]).max()
    return not other.any() or bool(like.mean() < 0.5)
