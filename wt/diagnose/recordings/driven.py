"""What held commands do between samples: a part of the motion that is known, and that no spline is.

A command is held until the next, so that a joint's acceleration jumps with each of them. A spline
through samples has no such jumps: at a slow rate its velocity errs by what a command changes within
half an interval, and its errors look like noise. The model's drives say this part of the motion:
the response of the joints' inertia, drives and dampers to the commands alone,

    M(q) w″ = gear · gain · u − K w − C w′,

K and C of drives and joints, from rest at nothing. What is left, of weight, friction, coupling and
all that the model lacks, is smoother than the motion, and is what a spline is fitted to. Where the
model lacks half of a rotor's inertia, or a quarter of a gain, or commands arrive late or through a
filter, what is left has jumps too: once such effects are found, the response is that of the model
with them, to commands as they arrive.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PPoly
from scipy.linalg import expm

from wt.physics import inertia
from wt.physics.held import impulses
from wt.physics.planted import Hypothesis
from wt.physics.replay import Inputs
from wt.physics.scene import Scene, drives

_PLACES = 1000
"""Most places along a segment at which inertia is taken: it changes slowly."""
_SLOW_S = 3e-3  # between commands: a spline follows what faster ones do
_EQUAL_S = 1e-7  # intervals that differ by less are as long
_AT_ONCE = 4096  # steps, of which matrices are held in memory
_PARTS = 4
"""Polynomials in each interval: a stiff drive has answered a command before the next one comes."""
_ARRIVING = 16
"""The same of commands that arrive at any time: a mean over as much of an interval moves a joint by
a 256th of what the command does in half an interval."""
_NONE = -1  # index of a recording that there is not: nothing happens at its times
_RESPONDS = ("body_mass", "body_ipos", "body_iquat", "body_inertia", "dof_armature", "dof_damping")
"""Of a compiled model, beside its drives, what commands are responded to by."""


@dataclass(frozen=True, eq=False)
class Held:
    """What held commands pull a machine's joints by, in one segment.

    Attributes:
        t: time of the samples [s].
        pulls: acceleration by commands alone from each sample to the next, as they were sent.
        arriving: the same as they arrive, in equal parts of each interval.
        mobility: inverse inertia, in some places along the segment.
        place: index of the place, for each interval.
        stiffness, damping: what drives and joints hold against.
    """

    t: Float[np.ndarray, " sample"]
    pulls: Float[np.ndarray, "interval dof"]
    arriving: Float[np.ndarray, "part dof"]
    mobility: Float[np.ndarray, "place dof dof"]
    place: Int[np.ndarray, " interval"]
    stiffness: Float[np.ndarray, " dof"]
    damping: Float[np.ndarray, " dof"]

    @property
    def jolts(self) -> tuple[Float[np.ndarray, " dof"], Float[np.ndarray, " dof"]]:
        """RMS of what jumps move each joint, and its velocity, between two samples."""
        jump, interval = np.diff(self.pulls, axis=0), np.diff(self.t)[1:, None]
        # over half an interval either way, half of it each
        moved, turned = jump * interval**2 / 16.0, jump * interval / 8.0
        return np.sqrt(np.mean(moved**2, axis=0)), np.sqrt(np.mean(turned**2, axis=0))

    def response(self) -> PPoly | None:
        """The response of the joints, w(t), (dof,) [rad or m].

        It is made of some quintics between samples, at which its acceleration jumps. None where it
        runs away.
        """
        nv, pulls = len(self.stiffness), self.arriving
        parts = len(pulls) // len(self.pulls)
        fine, place = _divided(self.t, parts), self.place.repeat(parts)
        interval = np.diff(fine)
        steps = np.stack([place, np.round(interval / _EQUAL_S)], axis=1)
        w, v = np.zeros((2, len(fine), nv))
        ends = np.empty((2, len(pulls), nv))  # accelerations where each polynomial begins and ends
        for begin in range(0, len(steps), _AT_ONCE):
            rows = slice(begin, begin + _AT_ONCE)
            kinds, which = np.unique(steps[rows], axis=0, return_inverse=True)
            step = self._steps(kinds[:, 0].astype(int), kinds[:, 1] * _EQUAL_S)
            for k, kind in enumerate(which.ravel(), begin):
                moved = step[kind] @ np.concatenate([w[k], v[k], pulls[k]])
                w[k + 1], v[k + 1] = moved[:nv], moved[nv:]
            for end, at in zip(ends, (slice(None, -1), slice(1, None)), strict=True):
                against = w[at][rows] * self.stiffness + v[at][rows] * self.damping
                slowed = np.einsum("kij,kj->ki", self.mobility[place[rows]], against)
                end[rows] = pulls[rows] - slowed
        first, last = (w[:-1], v[:-1], ends[0]), (w[1:], v[1:], ends[1])
        found = PPoly(_quintic(interval[:, None], *first, *last), fine)
        return found if np.isfinite(found.c).all() else None

    def _steps(
        self, place: Int[np.ndarray, " kind"], seconds: Float[np.ndarray, " kind"]
    ) -> Float[np.ndarray, "kind state given"]:
        """Matrices from (w, w′, pull) to (w, w′) so many seconds later, in some places."""
        nv, mobility = len(self.stiffness), self.mobility[place]
        system = np.zeros((len(place), 3 * nv, 3 * nv))
        system[:, :nv, nv : 2 * nv] = system[:, nv : 2 * nv, 2 * nv :] = np.eye(nv)
        system[:, nv : 2 * nv, :nv] = -mobility * self.stiffness
        system[:, nv : 2 * nv, nv : 2 * nv] = -mobility * self.damping
        return np.asarray(expm(system * seconds[:, None, None])[:, : 2 * nv])


def held(
    scene: Scene,
    t: Float[np.ndarray, " sample"],
    q: Float[np.ndarray, "sample dof"],
    acted: Float[np.ndarray, "sample actuator"],
    model: mujoco.MjModel | None = None,
    known: Hypothesis = (),
) -> Held | None:
    """What the commands of a segment pull a machine's joints by.

    Args:
        scene: the machine.
        t: time of the samples [s].
        q: where the joints were, roughly [rad or m].
        acted: what each drive acts on from each sample to the next.
        model: of the machine as it was found; None for the scene's.
        known: effects of the machine, some of which may change what arrives of its commands.

    Returns:
        None where nothing drives a joint by itself, where a base floats, whose feet say what it
        weighs, and of fast commands.
    """
    if scene.free or not scene.drives or len(t) < 3 or np.median(np.diff(t)) < _SLOW_S:
        return None
    model = model or scene.model
    force, stiffness, damping = _acting(model, acted[:-1])
    place = np.linspace(0, min(len(force), _PLACES), len(force), endpoint=False).astype(int)
    mobility = _mobility(model, q[np.searchsorted(place, np.arange(place[-1] + 1))])
    pulls = np.einsum("kij,kj->ki", mobility[place], force)
    arriving = pulls.repeat(_PARTS, axis=0)
    if arrives_otherwise(scene, known):
        arrived, *_ = _acting(model, _arrived(scene, t, acted, known))
        arriving = np.einsum("kij,kj->ki", mobility[place].repeat(_ARRIVING, axis=0), arrived)
    return Held(t, pulls, arriving, mobility, place, stiffness, damping)


def arrives_otherwise(scene: Scene, known: Hypothesis) -> bool:
    """Tell whether effects change what arrives of commands: delays and filters do."""
    sent = np.eye(scene.model.nactuator)  # each command jumps once
    h = _SLOW_S  # more than any delay or filter that says something
    inputs = Inputs(_NONE, h * np.arange(len(sent)), h, sent.copy())
    for planted in known:
        planted.drive(inputs, scene)
    return not np.array_equal(inputs.u, sent)


def _arrived(
    scene: Scene,
    t: Float[np.ndarray, " sample"],
    acted: Float[np.ndarray, "sample actuator"],
    known: Hypothesis,
) -> Float[np.ndarray, "part actuator"]:
    """What each drive acts on in equal parts of each interval, by effects that change that."""
    h = float(np.median(np.diff(t))) / _ARRIVING
    edges = t[0] + h * np.arange(int(np.ceil((t[-1] - t[0]) / h)) + 1)
    inputs = Inputs(_NONE, edges[:-1], h, impulses(t, acted, edges) / h)
    for planted in known:
        planted.drive(inputs, scene)
    parts = _divided(t, _ARRIVING)
    return impulses(edges[:-1], inputs.u, parts) / np.diff(parts)[:, None]


def _divided(t: Float[np.ndarray, " sample"], parts: int) -> Float[np.ndarray, " edge"]:
    """Ends of so many equal parts of each interval."""
    count = len(t) - 1
    return np.interp(np.arange(count * parts + 1) / parts, np.arange(count + 1), t)


def responds_otherwise(scene: Scene, known: Hypothesis) -> bool:
    """Tell whether effects change the response to commands: these, inertia, drives or damping."""
    if arrives_otherwise(scene, known):
        return True
    given, model = scene.slim.copy().compile(), as_found(scene, known)
    same = all(np.array_equal(getattr(given, x), getattr(model, x)) for x in _RESPONDS)
    return not same or drives(model) != drives(given)


def as_found(scene: Scene, known: Hypothesis) -> mujoco.MjModel:
    """The model with effects, but for those that add joints, whose states no recording has."""
    if not known:
        return scene.model
    spec = scene.slim.copy()
    for planted in known:
        changed = spec.copy()
        planted.model(changed)
        if len(changed.joints) == len(spec.joints):
            spec = changed
    return spec.compile()


def _acting(
    model: mujoco.MjModel, acted: Float[np.ndarray, "sample actuator"]
) -> tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, " dof"], Float[np.ndarray, " dof"]]:
    """Forces of commands, and what drives and joints hold against: stiffness, damping."""
    force, stiffness = np.zeros((len(acted), model.nv)), np.zeros(model.nv)
    damping = model.dof_damping.copy()
    for drive in drives(model):
        u = np.clip(acted[:, drive.index], *drive.commands)
        force[:, drive.dof] += drive.gear * drive.gain * u
        stiffness[drive.dof] -= drive.gear**2 * drive.bias[1]
        damping[drive.dof] -= drive.gear**2 * drive.bias[2]
    return force, stiffness, damping


def _mobility(
    model: mujoco.MjModel, q: Float[np.ndarray, "place dof"]
) -> Float[np.ndarray, "place dof dof"]:
    """Inverse inertia in each place, by hinges and slides alone."""
    data = mujoco.MjData(model)
    return np.linalg.inv(np.stack([inertia.of_joints(model, data, here) for here in q]))


def _quintic(
    h: Float[np.ndarray, "interval 1"],
    w: Float[np.ndarray, "interval dof"],
    v: Float[np.ndarray, "interval dof"],
    a: Float[np.ndarray, "interval dof"],
    w_end: Float[np.ndarray, "interval dof"],
    v_end: Float[np.ndarray, "interval dof"],
    a_end: Float[np.ndarray, "interval dof"],
) -> Float[np.ndarray, "power interval dof"]:
    """Coefficients of the polynomials with these values and derivatives at both ends."""
    p = (w_end - w - v * h - 0.5 * a * h**2) / h**3
    s = (v_end - v - a * h) / h**2
    c = (a_end - a) / h
    cubic, fourth = 10.0 * p - 4.0 * s + 0.5 * c, (-15.0 * p + 7.0 * s - c) / h
    return np.stack([(6.0 * p - 3.0 * s + 0.5 * c) / h**2, fourth, cubic, 0.5 * a, v, w])
