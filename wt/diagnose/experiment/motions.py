"""Motions of one joint that tell causes apart, each from rest to rest inside its reach."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.diagnose.experiment import signals
from wt.diagnose.experiment.reach import MILD, Reach
from wt.physics.scene import Scene
from wt.types import Location

_RAMP_S = 1.5
# shares of a joint's time in a programme
_SLOW, _STEPS, _SINES = (0.18, 0.13, 0.13), 0.14, 0.24
_SPEEDS = (0.06, 0.2, 0.6)  # of reversals, as shares of the fastest recorded
_CREEP = 0.03  # rad/s: slow enough for Stribeck's curve
_TORQUE_BAND = (0.2, 2.0)
_SIZES = (0.4, 0.8)  # of what a joint may do: motions that are offered one by one
_UNHURRIED, _REST_S = 0.8, 1.0  # share of the greatest speed on the way to a pose, and rest there
_SHORTEST_S = 2.0  # of a motion without the ways there and back


def telling_joints(scene: Scene, at: Location) -> Sequence[str]:
    """The joints that tell most about a place."""
    m = scene.model
    if at.name in scene.joints and at.kind in ("joint", "sensor"):
        return [at.name]
    if at.kind == "actuator":
        return [drive.joint for drive in scene.driven(at)]
    if at.kind == "pair":
        return [name for name in at.name.split("+") if name in scene.joints]
    if at.kind == "body" and mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, at.name) > 0:
        # what acts on a body is felt most at the joints next to it
        return [j for j in scene.joints if scene.carries(m.body(at.name).id)[scene.dof(j)]][-2:]
    return scene.joints


def programme(
    reach: Reach, dof: int, n: int, dt: float, rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Reversals, steps, sines and rests of one joint in the middle of its reach."""
    rest, speed = float(reach.rest[dof]), float(reach.speed[dof])
    centre = 0.5 * float(reach.low[dof] + reach.high[dof])
    half = 0.5 * float(reach.high[dof] - reach.low[dof])
    ramp = _ramp(rest, centre, speed, dt)
    left = n - 2 * ramp
    speeds = [speed * share for share in _SPEEDS]
    speeds[0] = min(speeds[0], _CREEP)
    parts = [
        signals.reversals(round(share * left), dt, v, 0.8 * half)
        for share, v in zip(_SLOW, speeds, strict=True)
    ]
    parts.append(signals.steps(round(_STEPS * left), dt, speed, 0.5 * half, rng))
    band = (0.1, min(8.0, 0.1 / dt))
    parts.append(signals.multisine(round(_SINES * left), dt, 0.8 * speed, 0.8 * half, band))
    last = left - sum(map(len, parts))
    parts.append(signals.holds(last, dt, speed, half))
    there = signals.move(rest, centre, ramp)
    return np.concatenate([there, centre + np.concatenate(parts), there[::-1]])


def mild(
    scene: Scene, reach: Reach, joint: str, n: int, dt: float, turn: int
) -> Float[np.ndarray, " sample"]:
    """A small multisine of one joint around its rest."""
    dof = scene.dof(joint)
    servo = any(d.servo for d in scene.drives if d.joint == joint)
    half = 0.5 * float(reach.high[dof] - reach.low[dof])
    size = min(0.3 * half, MILD)
    rest, speed = float(reach.rest[dof]), float(reach.speed[dof])
    # beside an end, away from it; else around the pose where gravity left it
    centre = float(np.clip(rest, reach.low[dof] + size, reach.high[dof] - size))
    ramp = _ramp(rest, centre, speed, dt)
    band = (0.1, min(5.0, 0.1 / dt)) if servo else _TORQUE_BAND
    wave = signals.multisine(n - 2 * ramp, dt, 0.5 * speed, size, band, turn)
    there = signals.move(rest, centre, ramp)
    return np.concatenate([there, centre + wave, there[::-1]])


def _ramp(start: float, end: float, speed: float, dt: float) -> int:
    """Samples of a minimum-jerk move, which peaks at 1.875 times its mean speed."""
    return round(max(_RAMP_S, 1.875 * abs(end - start) / speed) / dt)


def singles(
    scene: Scene, reach: Reach, joint: str, n: int, dt: float, rng: np.random.Generator
) -> Iterator[tuple[str, Float[np.ndarray, "sample dof"]]]:
    """Each kind of motion of a joint by itself, n samples long with the ways there and back.

    Args:
        scene: the machine.
        reach: what its joints may do.
        joint: the one that moves.
        n: samples.
        dt: their distance [s].
        rng: of steps.

    Yields:
        The motion in words, and positions of all joints [rad or m].
    """
    dof = scene.dof(joint)
    rest, speed = float(reach.rest[dof]), float(reach.speed[dof])
    low, high = float(reach.low[dof]), float(reach.high[dof])
    servo = any(d.servo for d in scene.drives if d.joint == joint)
    for share in _SIZES if servo else (0.5 * s for s in _SIZES):
        size = 0.5 * share * (high - low)
        centre = float(np.clip(rest, low + size, high - size))
        ramp = max(1, round(1.875 * abs(centre - rest) / (0.5 * speed) / dt))
        left = n - 2 * ramp
        if left * dt < _SHORTEST_S:
            continue
        there = signals.move(rest, centre, ramp)
        waves = _waves(speed, size, left, dt, rng) if servo else _loose(speed, size, left, dt)
        for words, wave in waves:
            q = np.tile(reach.rest, (n, 1))
            q[:, dof] = np.concatenate([there, centre + wave, there[::-1]])
            yield words, q


def sweeps(
    scene: Scene, reach: Reach, joint: str, most: int, dt: float
) -> Iterator[tuple[str, Float[np.ndarray, "sample dof"]]]:
    """A servo goes towards either end and back, as far as there is time for.

    A load whose sign never changed may change it there, however slowly the machine may move.

    Args:
        scene: the machine.
        reach: what its joints may do.
        joint: the one that moves.
        most: samples, at most.
        dt: their distance [s].

    Yields:
        The motion in words, and positions of all joints [rad or m].
    """
    if not any(d.servo for d in scene.drives if d.joint == joint):
        return
    dof = scene.dof(joint)
    for end, words in ((reach.low[dof], "one end"), (reach.high[dof], "the other end")):
        pose = reach.rest.copy()
        pose[dof] = end
        yield f"goes towards {words} and back", _there_and_back(reach, pose, 0, most, dt)


def together(
    scene: Scene, reach: Reach, most: int, dt: float, rng: np.random.Generator
) -> Iterator[tuple[str, Float[np.ndarray, "sample dof"]]]:
    """All servos at once: a rest in another pose, where every load is another.

    Args:
        scene: the machine.
        reach: what its joints may do.
        most: samples, at most; where it would take longer, it goes as far as there is time for.
        dt: their distance [s].
        rng: of the poses.

    Yields:
        The motion in words, and positions of all joints [rad or m].
    """
    servos = list(dict.fromkeys(d.dof for d in scene.drives if d.servo))
    half, middle = 0.5 * (reach.high - reach.low), 0.5 * (reach.high + reach.low)
    for share, sign in itertools.product((*_SIZES, 1.0), (1.0, -1.0)):
        pose = reach.rest.copy()
        ends = middle + sign * rng.choice([-1.0, 1.0], len(half)) * share * half
        pose[servos] = ends[servos]
        rests = round(_REST_S / dt)
        yield "the machine rests in another pose", _there_and_back(reach, pose, rests, most, dt)


def _there_and_back(
    reach: Reach, pose: Float[np.ndarray, " dof"], rests: int, most: int, dt: float
) -> Float[np.ndarray, "sample dof"]:
    """To a pose, so many samples of rest, and back; as far as there is time for."""
    seconds = 1.875 * float((np.abs(pose - reach.rest) / reach.speed).max()) / _UNHURRIED
    count, longest = max(2, round(seconds / dt)), max(2, (most - rests) // 2)
    if count > longest:
        pose = reach.rest + longest / count * (pose - reach.rest)
    way = signals.move(0.0, 1.0, min(count, longest))[:, None]
    there = reach.rest + way * (pose - reach.rest)
    return np.concatenate([there, np.tile(pose, (rests, 1)), there[::-1]])


def _waves(
    speed: float, size: float, n: int, dt: float, rng: np.random.Generator
) -> Iterator[tuple[str, Float[np.ndarray, " sample"]]]:
    """What a servo can be told to do, around a centre."""
    for share, words in zip(_SPEEDS, ("creeps", "goes slowly", "goes fast"), strict=True):
        v = min(speed * share, _CREEP) if share == _SPEEDS[0] else speed * share
        yield f"{words} to and fro", signals.reversals(n, dt, v, size)
    yield "steps", signals.steps(n, dt, speed, size, rng)
    band = (0.1, min(8.0, 0.1 / dt))
    yield "swings at many frequencies", signals.multisine(n, dt, 0.8 * speed, size, band)
    yield "rests at several angles", signals.holds(n, dt, speed, size)


def _loose(
    speed: float, size: float, n: int, dt: float
) -> Iterator[tuple[str, Float[np.ndarray, " sample"]]]:
    """What a motor without a position servo can do without getting lost."""
    for turn, band in enumerate((_TORQUE_BAND, (_TORQUE_BAND[1], min(6.0, 0.1 / dt)))):
        words = "swings slowly" if turn == 0 else "swings fast"
        yield words, signals.multisine(n, dt, 0.5 * speed, size, band, turn)
