"""Isolability before data: which causes could be told apart at all, and by which motion.

The model as given is simulated in every kind of motion that an experiment is made of. Two causes
at a joint are compared by what its sensors show of the forces that they would add there, the
signatures of the screen: what is left of one once the other, in any of its shapes and sizes, and
the model's tolerances have taken what they can. A drive whose force is measured shows what is
missing in it beside what is missing behind it. Where that is a share s of it, the one has to be
1/√s times as large as what can just be seen to be told from the other; where nothing is left in any
motion, no such recording tells them apart. A law that contains another is told from it by what it
has besides.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from wt.ask import SOURCE
from wt.ask.design import PART_S
from wt.ask.loop import RATE_HZ, refuse
from wt.ask.measured import Measured, measured
from wt.ask.separation import Beyond
from wt.diagnose.experiment.motions import singles, together
from wt.diagnose.experiment.reach import Reach, reach_of, roomy, too_far
from wt.diagnose.experiment.trial import Trial, as_recording, trial
from wt.diagnose.likelihood.tolerances import forces, tolerances
from wt.diagnose.pace import Say
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.candidates import near
from wt.errors import WorkError
from wt.physics.effect import Effect, effects
from wt.physics.hooks import FromRecordings
from wt.physics.quiet import quiet
from wt.physics.scene import Scene
from wt.types import Location, Recording

NEVER = 30.0
"""Causes that have to be so many times as large as what can be seen are never told apart."""
NOISE = 1e-4
"""Of positions, for what can just be seen [rad or m]."""
_IN_DRIVE = ("actuator.", "sensor.")
"""Effects that a measured force of a drive may show: of what is measured, drives work with some."""
_NOTHING = 1e-9  # share of a signature's largest column that is no more than rounding
_MOST_S = 20.0
_SHRINK, _TRIES = 0.75, 8

Signature = Float[np.ndarray, "_ value"]


@dataclass(frozen=True, order=True)
class Cause:
    """An effect at a place."""

    effect: str
    at: Location

    def __str__(self) -> str:
        """As in tables."""
        return f"{self.effect} at {self.at}"


@dataclass(frozen=True)
class Apart:
    """Two causes.

    Attributes:
        causes: the two.
        times: how many times as large as what can just be seen they have to be; infinite if no
            size is enough.
        motion: that tells them best, in words; "" if none does.
    """

    causes: tuple[Cause, Cause]
    times: float
    motion: str

    @property
    def never(self) -> bool:
        """Whether no motion tells them apart."""
        return not self.times < NEVER

    def to_json(self) -> dict[str, Any]:
        """As in ``plan.json``."""
        return {
            "causes": [_named(cause) for cause in self.causes],
            "times": None if self.never else self.times,
            "motion": None if self.never else self.motion,
        }


@dataclass(frozen=True)
class Plan:
    """What could be told apart at the joints of a machine.

    Attributes:
        joints: for each joint, the driven ones first, every two causes near it.
        replayed: effects that have no signature; only replays of recordings tell these.
        sensors: what is measured.
        unseen: causes that these sensors show in no motion.
    """

    joints: dict[str, tuple[Apart, ...]]
    replayed: tuple[str, ...]
    sensors: Measured
    unseen: tuple[Cause, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The content of ``plan.json``."""
        pairs = {joint: [a.to_json() for a in found] for joint, found in self.joints.items()}
        return {
            "schema": 1,
            "sensors": self.sensors.to_json(),
            "joints": pairs,
            "never_shown": [_named(cause) for cause in self.unseen],
            "only_replays_tell": list(self.replayed),
        }


def _named(cause: Cause) -> dict[str, Any]:
    return {"effect": cause.effect, "at": {"kind": cause.at.kind, "name": cause.at.name}}


@quiet()
def plan(model: Path, progress: Say | None = None) -> Plan:
    """Compare all causes at all joints of a model.

    Args:
        model: the MJCF.
        progress: called as the work goes on.

    Raises:
        ModelError: it cannot be used, or is of a machine that no command can safely move.
        WorkError: none of its motions keeps the limits.
    """
    scene = Scene(model)
    refuse(scene)
    sensors = measured(scene)
    moved = dict(_motions(scene))
    if not moved:
        raise WorkError("no motion keeps the limits of this model: give its joints more room")
    compared: list[tuple[str, _Compared]] = []
    for i, (words, recording) in enumerate(moved.items()):
        if progress:
            progress(f"the machine {words}", i / len(moved))
        compared.append((words, _Compared(Screen(smooth(scene, [Part(recording, 0)])), sensors)))
    screen = compared[0][1].screen
    joints = {}
    driven = dict.fromkeys(d.joint for d in scene.drives)
    for joint in dict.fromkeys((*driven, *scene.own_joints)):  # those that nothing drives move too
        places = near(screen, Location("joint", joint))
        causes = [c for c in _causes(sensors, scene) if c.at in places and c.at.name != "all"]
        pairs = (_apart(pair, compared) for pair in itertools.combinations(causes, 2))
        joints[joint] = tuple(p for p in pairs if p is not None)
    shown = {c for _, each in compared for c in each.signatures}
    unseen = {c for _, each in compared for c in each.unseen} - shown
    told = {c.effect for c in shown | unseen}
    return Plan(joints, tuple(sorted(set(effects()) - told)), sensors, tuple(sorted(unseen)))


def _causes(sensors: Measured, scene: Scene) -> list[Cause]:
    return [
        Cause(effect.id, at)
        for effect in effects().values()
        if not (isinstance(effect, FromRecordings) and effect.reads_residual)
        for at in effect.places(scene)
        if sensors.may_be(effect.id, at)
    ]


class _Compared:
    """Signatures of all causes in one motion, in units of noise; a row for each coefficient."""

    def __init__(self, screen: Screen, sensors: Measured) -> None:
        self.screen = screen
        motion, scene = screen.motion, screen.motion.scene
        self._rows, self._shown = screen.keep / screen.floor, sensors.shown(motion)
        self._forces = [scene.drive(name).dof for name in sensors.drives]
        free = tolerances(scene)
        small = np.stack(forces(motion, free), axis=2)
        drives = np.array([t.planted.effect.id.startswith(_IN_DRIVE) for t in free])
        self._beyond = Beyond(self._flat(small, drives))
        self.signatures: dict[Cause, list[Signature]] = {}
        self.unseen: list[Cause] = []
        for cause in _causes(sensors, scene):
            found = list(self._shapes(effects()[cause.effect], cause.at))
            if any(len(rows) for rows in found):
                self.signatures[cause] = [rows for rows in found if len(rows)]
            elif found:
                self.unseen.append(cause)

    def _shapes(self, effect: Effect, at: Location) -> Iterator[Signature]:
        """The signature in each of its shapes, every row of length one; none that do not show."""
        motion = self.screen.motion
        for shape in effect.shapes(motion, at):
            force = effect.columns(motion, at, shape)
            most = np.linalg.norm(self._weighed(force), axis=1).max(initial=0.0)
            rows = self._flat(force, np.full(force.shape[2], effect.id.startswith(_IN_DRIVE)))
            size = np.linalg.norm(rows, axis=1, keepdims=True)
            seen = size[:, 0] > _NOTHING * most
            if most > 0.0:
                yield rows[seen] / size[seen]

    def _flat(
        self, force: Float[np.ndarray, "sample dof column"], in_drive: Bool[np.ndarray, " column"]
    ) -> Signature:
        """What is seen of forces: by the motion, and by drives whose force is measured."""
        seen = force if self._shown is None else np.einsum("tij,tjc->tic", self._shown, force)
        alone = np.where(in_drive, force, 0.0)
        return np.concatenate([self._weighed(seen), self._weighed(alone, self._forces)], axis=1)

    def _weighed(
        self, force: Float[np.ndarray, "sample dof column"], dofs: Sequence[int] | None = None
    ) -> Signature:
        """Weak forces in units of noise, at some degrees of freedom, a row for each column."""
        chosen = np.arange(force.shape[1]) if dofs is None else np.array(dofs, int)
        weighed = self.screen.weak_force(force) * self._rows[:, :, None]
        return weighed[:, chosen].reshape(-1, force.shape[2]).T

    def left(self, one: Cause, other: Cause) -> float:
        """Share of one signature, all its parts together, that no shape of another explains."""
        signatures, product = self.signatures[one], self._beyond.product
        a = signatures[len(signatures) // 2].sum(axis=0, keepdims=True)
        whole = float(product(a, a)[0, 0])
        most = 0.0
        for b in self.signatures[other]:
            across, within = product(b, a), product(b, b)
            told = float((across.T @ np.linalg.pinv(within, rcond=1e-8) @ across)[0, 0])
            most = max(most, told / max(whole, 1e-300))
        return max(0.0, 1.0 - most) if whole > 0.0 else 0.0


def _apart(pair: tuple[Cause, Cause], compared: Sequence[tuple[str, _Compared]]) -> Apart | None:
    """The motion that tells two causes best; None where one of them shows in none."""
    shares = []
    for words, each in compared:
        if all(cause in each.signatures for cause in pair):
            sizes = [len(each.signatures[cause][0]) for cause in pair]
            # of a law that may contain the other, only what it has besides counts
            ways = [pair, pair[::-1]] if sizes[0] == sizes[1] else [
                pair if sizes[0] > sizes[1] else pair[::-1]
            ]  # fmt: skip
            shares.append((min(each.left(*way) for way in ways), words))
    if not shares:
        return None
    share, words = max(shares)
    times = float("inf") if share <= 0.0 else float(share**-0.5)
    return Apart(pair, times, words if times < NEVER else "")


# -- motions ---------------------------------------------------------------------------------------


def _motions(scene: Scene) -> Iterator[tuple[str, Recording]]:
    """Every kind of motion, of all driven joints one after another, as it would be recorded."""
    reach, rng = _anywhere(scene), np.random.default_rng(0)
    n, dt = round(PART_S * RATE_HZ), 1.0 / RATE_HZ
    kinds: dict[str, list[Float[np.ndarray, "sample dof"]]] = {}
    for joint in dict.fromkeys(d.joint for d in scene.drives):
        if roomy(reach, scene.dof(joint)):
            larger = dict(singles(scene, reach, joint, n, dt, rng))  # of each, the latter of two
            for words, wanted in larger.items():
                kinds.setdefault(words, []).append(wanted)
    for words, wanted in together(scene, reach, round(_MOST_S * RATE_HZ), dt, rng):
        kinds.setdefault(words.removeprefix("the machine "), []).append(wanted)
    for words, parts in kinds.items():
        tried = _safe(scene, reach, np.concatenate(parts))
        if tried is not None:
            recording = as_recording(scene, tried, RATE_HZ, SOURCE, words)
            noise = {
                name: values + NOISE * rng.standard_normal(len(values)) * name.startswith("qpos/")
                for name, values in recording.columns.items()
            }
            yield words, Recording(recording.t, noise, recording.meta)


def _anywhere(scene: Scene) -> Reach:
    """The model's ranges; a joint that nothing drives swings as far and as fast as it likes."""
    reach = reach_of(scene, (), free=True)
    passive = np.ones(len(scene.joints), bool)
    passive[[drive.dof for drive in scene.drives]] = False
    return replace(
        reach,
        slack=np.where(passive, np.inf, reach.slack),
        speed=np.where(passive, np.inf, reach.speed),
    )


def _safe(scene: Scene, reach: Reach, wanted: Float[np.ndarray, "sample dof"]) -> Trial | None:
    """The motion on the model as given, made smaller until it keeps the limits."""
    for k in range(_TRIES):
        tried = trial(scene, reach.smaller(wanted, _SHRINK**k), RATE_HZ)
        if not too_far(scene, reach, tried, RATE_HZ).any():
            return tried
    return None
