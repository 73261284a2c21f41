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
from dataclasses import asdict, dataclass, replace
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float

from wt.types import Channel, Transitions, TransitionSpec
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


FACTORS = tuple(
    Channel(f"log_factor/{name}", "1")
    for name in (
        "stiffness", "velocity_gain", "damping", "frictionloss", "trunk_mass_scale",
        "limb_mass_scale", "floor_friction",
    )
)  # fmt: skip
"""What is another in each simulator: logarithms of factors on S's physics, named as its options."""


@runtime_checkable
class Varied(Protocol):
    """A world that can vary its S."""

    def lessons(self, count: int, seed: int, progress: Progress | None = None) -> Transitions:
        """Closed-loop transitions of simulators around S, ``count`` of them, as of ``collect``.

        Their hidden variables are known, as S's are, and so is their physics: :func:`lessons_spec`
        is their layout. ``nominal`` is the answer of S itself.
        """
        ...


def identity() -> dict[str, object]:
    """What decides, besides S, how simulators around it are drawn, and what is told of them."""
    return {**asdict(AROUND_S), "factors": [channel.name for channel in FACTORS]}


def lessons_spec(spec: TransitionSpec) -> TransitionSpec:
    """Layout of lessons: behind a task's hidden variables stand the factors of each simulator."""
    return replace(spec, hidden=(*spec.hidden, *FACTORS))


def drawn(
    rng: np.random.Generator, count: int, widths: Widths = AROUND_S
) -> Float[np.ndarray, "simulator factor"]:
    """Logarithms of the factors of so many simulators around S."""
    half = [
        widths.drives, widths.drives, widths.friction, widths.friction, widths.trunk, widths.limbs,
        widths.floor,
    ]  # fmt: skip
    return rng.uniform(-1.0, 1.0, (count, len(FACTORS))) * half


def varied(
    model: mujoco.MjModel,
    trunk: str,
    joints: tuple[str, ...],
    log_factors: Float[np.ndarray, " factor"],
) -> mujoco.MjModel:
    """A simulator near another: a copy with other drives, friction and masses.

    Args:
        model: S, whose joints have position drives of their names.
        trunk: name of the trunk's body.
        joints: names of the robot's joints; what else is in S, such as a load, stays as it is.
        log_factors: of :data:`FACTORS`.
    """
    near = copy.copy(model)
    stiffness, velocity_gain, damping, frictionloss, trunk_scale, limb_scale, floor = np.exp(
        log_factors
    )
    drives = [model.actuator(joint).id for joint in joints]
    near.actuator_gainprm[drives, 0] *= stiffness
    near.actuator_biasprm[drives, 1] *= stiffness
    near.actuator_biasprm[drives, 2] *= velocity_gain
    dofs = [int(model.joint(joint).dofadr[0]) for joint in joints]
    near.dof_damping[dofs] *= damping
    near.dof_frictionloss[dofs] *= frictionloss
    body = model.body(trunk).id
    limbs = [int(model.joint(joint).bodyid[0]) for joint in joints]
    for bodies, scale in (([body], trunk_scale), (limbs, limb_scale)):
        near.body_mass[bodies] *= scale
        near.body_inertia[bodies] *= scale
    near.geom_friction[np.isin(model.geom_bodyid, [body, *limbs]), 0] *= floor
    mujoco.mj_setConst(near, mujoco.MjData(near))
    return near
