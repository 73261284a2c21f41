"""The change that hidden effects make in recordings, over their noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from wt.prove.case import Case, HiddenEffect
from wt.prove.controllers import OUTER_KP
from wt.prove.rigs import RIGS
from wt.prove.sensing import measure
from wt.prove.trajectory import HiddenTrajectory
from wt.prove.world import hidden_plant, record, sensor_effects


def visibility(case: Case, calm: Sequence[float] = ()) -> float:
    """Rms change of recordings by all hidden effects over their noise; see :func:`visibilities`."""
    return _change(case, case.truth, (), calm)


def visibilities(case: Case, calm: Sequence[float] = ()) -> tuple[float, ...]:
    """For each hidden effect the rms change that it makes in the recordings, over their noise.

    It is the change of positions at the joint and in the fit recording where it is largest, the
    other hidden effects acting in both worlds; sensor effects are counted too. The controller of
    a torque-controlled rig is outside the model and hides in its commands what a servo shows in
    positions: there, the change of its torque over its stiffness counts as well. Of a trunk its
    height, roll and pitch count, not its place, in which any difference adds up.

    Args:
        case: the trial.
        calm: shares of the motions' usual sizes, of its world.
    """
    return tuple(
        _change(case, case.truth, tuple(o for o in case.truth if o is not truth), calm)
        for truth in case.truth
    )


def _change(
    case: Case,
    acting: Sequence[HiddenEffect],
    others: Sequence[HiddenEffect],
    calm: Sequence[float],
) -> float:
    rig = RIGS[case.rig]
    sharp = replace(case.sensing, noise=0.0, bits=30, drops=0.0)
    stiffness = np.array([OUTER_KP * link.kp for link in rig.links])
    change = 0.0
    for index in range(len(case.motions) - 1):
        seen, sent, traces = [], [], []
        for hidden in (acting, others):
            size = calm[index] if calm else 1.0
            trace, steps = record(case, hidden_plant(case, hidden), index, size)
            columns = measure(
                rig, sharp, trace, steps, sensor_effects(case, hidden), np.random.default_rng(0)
            )[0]
            seen.append(np.stack([columns[f"qpos/{joint}"] for joint in rig.joints]))
            sent.append(trace.u.T)
            traces.append(trace)
        apart = ((seen[0] - seen[1]) ** 2).mean(axis=1)
        if rig.motor:
            apart = np.maximum(apart, (((sent[0] - sent[1]).T / stiffness) ** 2).mean(axis=0))
        change = max(change, math.sqrt(apart.max()) / case.sensing.position_noise)
        if (base := case.sensing.base) is not None:
            leans = (_lean(traces[0]) - _lean(traces[1])) / np.array(
                [base.position, base.turn, base.turn]
            )
            change = max(change, math.sqrt((leans**2).mean(axis=0).max()))
    return change


def _lean(trace: HiddenTrajectory) -> Float[np.ndarray, "sample 3"]:
    """Height [m], and the world's vertical in the trunk's x and y [rad]."""
    w, x, y, z = trace.base_q[:, 3:].T
    return np.stack([trace.base_q[:, 2], 2 * (x * z - w * y), 2 * (y * z + w * x)], axis=1)
