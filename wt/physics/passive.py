"""Passive DC motors: MuJoCo's element for friction with memory and for cogging."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

Array = np.ndarray

_NO_INPUT = 16
"""MuJoCo's code of ``input="none"``."""
_PRESLIDING = 1e-3
"""Deflection of the bristles at which friction slides [rad]."""


def add_passive(
    spec: mujoco.MjSpec,
    at: str,
    what: str,
    *,
    joint: bool = False,
    lugre: Sequence[float] | None = None,
    cogging: Sequence[float] | None = None,
) -> None:
    """Add a DC motor without inputs to a joint, in place; the user's commands keep their order.

    Args:
        spec: the model.
        at: an actuator, whose joint it acts on, or a joint.
        what: the last part of its name.
        joint: whether ``at`` is a joint.
        lugre: stiffness, damping, coulomb, static, velocity.
        cogging: amplitude [N·m], poles, phase [rad].
    """
    target = at if joint else spec.actuator(at).target
    motor = spec.add_actuator(name=f"{at}_{what}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=target)
    given = {"lugre": lugre, "cogging": cogging}
    chosen = {name: np.array(value, float) for name, value in given.items() if value is not None}
    motor.set_to_dcmotor(motorconst=np.zeros(2), resistance=1.0, ctrlspec=_NO_INPUT, **chosen)


def bristle_stiffness(spec: mujoco.MjSpec, joint: str, friction: float) -> tuple[float, float]:
    """Stiffness and damping of bristles that are stiff, and stable at the model's time step."""
    compiled = spec.copy().compile()
    inertia = float(compiled.dof_M0[compiled.joint(joint).dofadr[0]])
    h = compiled.opt.timestep
    # ω h ≤ 0.3 keeps the explicit integration of bristle and joint stable
    stiffness = min(friction / _PRESLIDING, inertia * (0.3 / h) ** 2)
    return stiffness, float(np.sqrt(stiffness * inertia))
