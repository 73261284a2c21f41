"""Simulators around S, for lessons that hold beyond it.

What reads hidden motion off a recording learns it from S, where nothing is hidden, and is used on
R, whose drives, friction and masses S has wrong. What it has learned of S alone errs there: a trunk
that hangs lower in softer drives is taken for one that sinks. So it learns from robots each of
which has physics of its own, spread around S as wide as simulators are off, and has to find what
holds for all of them (as policies do under domain randomization: Tobin et al. 2017; and as what
estimates their dynamics does: Kumar et al., RMA, 2021).

How wide is the same for every R, which has to lie within: drives and floor within 28 % of S's,
masses within 16 %, friction in the joints, which nobody knows, within a factor of 3.5.
"""

from __future__ import annotations

import copy
from dataclasses import asdict, dataclass
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np

from wt.types import Transitions
from wt.worlds.base import Progress


@dataclass(frozen=True)
class Widths:
    """Half the width of a factor's distribution, uniform in its logarithm.

    Attributes:
        drives: of position gains, and apart from them of velocity gains.
        friction: of viscous, and apart from it of dry friction in the joints.
        trunk: of the trunk's mass and inertia.
        limbs: of those of all other links.
        floor: of the sliding friction of what touches the ground.
    """

    drives: float = 0.25
    friction: float = 1.25
    trunk: float = 0.15
    limbs: float = 0.1
    floor: float = 0.25


AROUND_S = Widths()


@runtime_checkable
class Varied(Protocol):
    """A world that can vary its S."""

    def lessons(self, count: int, seed: int, progress: Progress | None = None) -> Transitions:
        """Closed-loop transitions of simulators around S, ``count`` of them, as of ``collect``.

        Their hidden variables are known, as S's are; ``nominal`` is the answer of S itself.
        """
        ...


def identity() -> dict[str, float]:
    """What decides, besides S, how simulators around it are drawn."""
    return asdict(AROUND_S)


def varied(
    model: mujoco.MjModel,
    trunk: str,
    joints: tuple[str, ...],
    rng: np.random.Generator,
    widths: Widths = AROUND_S,
) -> mujoco.MjModel:
    """A simulator near another: a copy with other drives, friction and masses.

    Args:
        model: S, whose joints have position drives of their names.
        trunk: name of the trunk's body.
        joints: names of the robot's joints; what else is in S, such as a load, stays as it is.
        rng: decides.
        widths: how near.
    """

    def factor(width: float) -> float:
        return float(np.exp(rng.uniform(-width, width)))

    near = copy.copy(model)
    drives = [model.actuator(joint).id for joint in joints]
    gain = factor(widths.drives)
    near.actuator_gainprm[drives, 0] *= gain
    near.actuator_biasprm[drives, 1] *= gain
    near.actuator_biasprm[drives, 2] *= factor(widths.drives)
    dofs = [int(model.joint(joint).dofadr[0]) for joint in joints]
    near.dof_damping[dofs] *= factor(widths.friction)
    near.dof_frictionloss[dofs] *= factor(widths.friction)
    body = model.body(trunk).id
    limbs = [int(model.joint(joint).bodyid[0]) for joint in joints]
    for bodies, width in (([body], widths.trunk), (limbs, widths.limbs)):
        scale = factor(width)
        near.body_mass[bodies] *= scale
        near.body_inertia[bodies] *= scale
    near.geom_friction[np.isin(model.geom_bodyid, [body, *limbs]), 0] *= factor(widths.floor)
    mujoco.mj_setConst(near, mujoco.MjData(near))
    return near
