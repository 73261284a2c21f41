"""Places for an obstacle: an arm's outer links run into it now and then, the others never."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.errors import WorkError
from wt.prove.case import Case
from wt.prove.hidden import Parameters, Plant
from wt.prove.rigs import RIGS
from wt.prove.world import commands

DEPTH = {"obvious": 0.05, "clear": 0.032, "faint": 0.02}
"""Level → distance behind the face that the servos would take a link to [m]."""
_EVERY = 0.02  # s, between the poses that are looked at
_CLEAR = 0.03  # m, between the face and all that is not to touch it
_TRIES = 400


def obstacle(case: Case) -> Parameters:
    """Position and normal of its face.

    Args:
        case: the trial; its motions say where the arm goes, its level how deep.

    Raises:
        WorkError: these motions leave no place for one.
    """
    rig = RIGS[case.rig]
    plant = Plant(rig, [], case.gain, np.ones((2, len(rig.links))))
    swept = [_swept(plant, case, index) for index in range(len(case.motions))]
    outer = len(rig.links) // 2
    last = np.concatenate([points[:, -outer:].reshape(-1, 3) for points in swept[:-1]])
    rng = np.random.default_rng([case.seed, 7])
    for _ in range(_TRIES):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        # points in front of the face have a positive height over it
        face = (last @ normal).min() + DEPTH[case.level] * rng.uniform(0.9, 1.1)
        heights = [points @ normal - face - rig.links[-1].radius for points in swept]
        behind = float(np.array(rig.links[0].pos) @ normal) < face + _CLEAR
        if not behind and _fits(heights, outer):
            touching = last[last @ normal < face + 0.01].mean(axis=0)
            position = touching + (face - touching @ normal) * normal
            return {"position": [*position.tolist()], "normal": [*normal.tolist()]}
    raise WorkError(f"case '{case.name}': no place for an obstacle; choose another seed")


def _swept(plant: Plant, case: Case, index: int) -> Float[np.ndarray, "time link 3"]:
    """Ends of all links at times of one recording, where the servos give way to gravity.

    Returns:
        World positions [m].
    """
    path, steps = commands(case, plant, index)
    samples = np.searchsorted(steps * plant.h, np.arange(0, steps[-1] * plant.h, _EVERY))
    # kp·(u − q) = gravity's torque, nearly
    path = path[samples] - plant.gravity_torques(path[samples]) / plant.kp
    data, links = mujoco.MjData(plant.model), plant.rig.links
    ends = np.empty((len(path), len(links), 3))
    for k, q in enumerate(path):
        data.qpos[plant.q_at] = q
        mujoco.mj_kinematics(plant.model, data)
        for i, link in enumerate(links):
            body = data.body(link.body)
            ends[k, i] = body.xpos + body.xmat.reshape(3, 3) @ np.array(link.to)
    return ends


def _fits(heights: list[Float[np.ndarray, "_time link"]], outer: int) -> bool:
    """True if only the outer links touch, now and then in each fit recording, never at first."""
    if any(h[:, :-outer].min() < _CLEAR or h[:5].min() < _CLEAR for h in heights):
        return False
    inside = [h[:, -outer:].min(axis=1) < 0 for h in heights]
    touches = [int((np.diff(touching.astype(int)) == 1).sum()) for touching in inside[:-1]]
    if min(touches) < 1 or sum(touches) < 4 or not all(0.01 < i.mean() < 0.35 for i in inside[:-1]):
        return False
    # held out, the servos must not press harder than in what was seen
    return bool(heights[-1].min() > min(h.min() for h in heights[:-1]) - 0.05)
