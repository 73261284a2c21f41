"""Commands between samples: a log that is slower than its controller does not hold all of them.

A recording has the command in force at each sample, which is taken to hold until the next one.
Where the controller ran faster than the log, there were others in between, and replays of the held
ones lag behind by up to half a sample. No machine acts on commands before they come, so that only
such a log makes replays of all its joints err far less once the commands in between are filled in
(H. Akima, 1970, which passes steps without ringing): that says how many there were, too. What they
were on their way is not known: the log of the controller's own rate would tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.recordings.samples import Part, Samples
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import forgets, stretches_of
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene

_COUNTS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20)
_FASTEST_S = 1e-3  # between commands: few controllers are faster
_ASKED_S = 10.0  # of replays
_CHANGING = 0.9  # share of samples that have a new command, or all were recorded


def smooth_as_sent(
    scene: Scene, parts: tuple[Part, ...], step: float, quick: float
) -> tuple[Smoothed, bool]:
    """Recordings, smoothed, with all the commands that were sent.

    Args:
        scene: the machine.
        parts: the recordings.
        step: physics step of the replay that asks what the machine forgets [s].
        quick: … and of those that count commands.

    Returns:
        (the recordings; whether the machine forgets its initial state).
    """
    smoothed = smooth(scene, parts)
    forgetting = forgets(smoothed, step)
    commands = commands_each(smoothed, parts, forgetting, quick)
    return smooth(scene, parts, commands) if commands > 1 else smoothed, forgetting


def commands_each(smoothed: Smoothed, parts: tuple[Part, ...], forgets: bool, step: float) -> int:
    """Number of commands that the controller sent for each sample of recordings, by replays.

    Args:
        smoothed: the recordings, with the commands that they have.
        parts: what they are of.
        forgets: whether the machine forgets its initial state.
        step: physics step of replays [s].
    """
    driven = _driven(smoothed)
    dt = min(s.dt for s in smoothed.samples)
    if not driven.any() or smoothed.motion.scene.free or not _always_new(smoothed):
        return 1
    as_recorded = _error(smoothed, forgets, step)
    if not np.isfinite(as_recorded[driven]).all():  # the model as given runs away
        return 1
    # the mean of two commands an interval, without smoothing anything anew
    early = replace(smoothed, samples=tuple(_earlier(s) for s in smoothed.samples))
    if not _better(_error(early, forgets, step), as_recorded, driven):
        return 1
    best, count = as_recorded, 1
    for n in _COUNTS:
        if dt / n < _FASTEST_S:
            break
        error = _error(smooth(smoothed.motion.scene, parts, n), forgets, step)
        if error[driven].sum() > best[driven].sum():
            break
        best, count = error, n
    return count if _better(best, as_recorded, driven) else 1


def _better(
    error: Float[np.ndarray, " dof"],
    as_recorded: Float[np.ndarray, " dof"],
    driven: Bool[np.ndarray, " dof"],
) -> bool:
    """Tell whether replays of every driven joint err far less."""
    return bool((error[driven] < THRESHOLDS.filled_in * as_recorded[driven]).all())


def _driven(smoothed: Smoothed) -> Bool[np.ndarray, " dof"]:
    """Joints whose drives' commands move."""
    driven = np.zeros(len(smoothed.noise), bool)
    for drive in smoothed.motion.scene.drives:
        driven[drive.dof] |= bool(np.ptp(smoothed.motion.command[:, drive.index]) > 0.0)
    return driven & np.isfinite(smoothed.noise)


def _always_new(smoothed: Smoothed) -> bool:
    """Tell whether nearly every sample has a new command; else the log saw each one held."""
    new = [(np.diff(s.command, axis=0) != 0.0).any(axis=1) for s in smoothed.samples]
    return float(np.concatenate(new).mean()) > _CHANGING


def _earlier(s: Samples) -> Samples:
    """Commands a quarter of the way to the next one."""
    following = np.concatenate([s.command[1:], s.command[-1:]])
    return replace(s, command=0.75 * s.command + 0.25 * following)


def _error(smoothed: Smoothed, forgets: bool, step: float) -> Float[np.ndarray, " dof"]:
    """RMS error of replays of each joint."""
    pairs = stretches_of(smoothed, forgets, _ASKED_S)
    q = Replayer(smoothed.motion.scene, [s for s, _ in pairs], step).run([()]).q[0]
    error = np.nan_to_num(q, nan=np.inf) - np.concatenate([x for _, x in pairs])
    return np.asarray(np.sqrt(np.nanmean(error**2, axis=0)))
