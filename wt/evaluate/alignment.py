"""Alignment: how a simulator follows a translation, in rollouts and in fine-tuning alike.

``state``   what a robot observes of itself is overwritten; what is hidden stays
``stance``  the same, and what is hidden moves so that standing feet stay where they are
``action``  the step is taken again, under the action that brings the simulator nearest to it

Overwriting a simulator's state leaves whatever it keeps inside unchanged. Correcting the action
instead, as grounded action transformation does (Hanna and Stone 2017), keeps it consistent. The
paper names the combination with translated targets as an extension. Here the simulator is its own
inverse model: one damped Gauss-Newton step on its finite differences.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from wt.config import Alignment

NUDGE = 0.02
"""Step of the finite differences [rad]."""
DAMPING = 0.3
"""Price of a change of action, relative to the mean square of the simulator's response: far joints
barely move some channels in one control step, and contacts make responses jump."""
LARGEST = 0.3
"""Largest change of an action [rad]."""


@runtime_checkable
class SimulatorStep(Protocol):
    """A control step that S has just taken, and whose end can still be changed.

    Whoever owns the simulator's state implements it: a rollout keeps arrays, fine-tuning a herd.

    Attributes:
        action: the actions under which it was taken, (N, n_action) [rad].
    """

    action: Float[np.ndarray, "robot action"]

    def end_state(
        self, action: Float[np.ndarray, "robot action"]
    ) -> Float[np.ndarray, "robot state"]:
        """S's state had it taken the step under other actions; the step itself stands."""
        ...

    def overwrite(self, target: Float[np.ndarray, "robot state"], keep_stance: bool) -> None:
        """End in ``target``; what is hidden stays, or moves with the standing feet."""
        ...

    def retake(self, action: Float[np.ndarray, "robot action"]) -> None:
        """End where other actions lead."""
        ...


def align(
    step: SimulatorStep,
    target: Float[np.ndarray, "robot state"],
    alignment: Alignment,
    scale: Float[np.ndarray, " state"] | None,
) -> None:
    """Let S's step end at, or near, the translated state.

    Args:
        step: changed in place.
        target: the translated state channels.
        alignment: see the module.
        scale: what differences of states are measured in; only corrected actions need it.
    """
    if alignment == "action":
        assert scale is not None  # whoever chooses "action" brings one
        step.retake(corrected_action(step.end_state, step.action, target, scale))
    else:
        step.overwrite(target, keep_stance=alignment == "stance")


def corrected_action(
    end_state: Callable[[np.ndarray], np.ndarray],
    a: Float[np.ndarray, "robot action"],
    target: Float[np.ndarray, "robot state"],
    scale: Float[np.ndarray, " state"],
) -> Float32[np.ndarray, "robot action"]:
    """Actions that bring S nearest to a target state.

    Args:
        end_state: S's states after the step, (N, n_state), under actions, (N, n_action); always
            from the same state.
        a: the policy's actions [rad].
        target: state channels that are wanted after the step.
        scale: what differences of states are measured in.

    Returns:
        Actions [rad].
    """
    base = end_state(a)
    response = np.empty((len(a), base.shape[1], a.shape[1]))
    for j in range(a.shape[1]):
        nudged = a.copy()
        nudged[:, j] += NUDGE
        response[:, :, j] = (end_state(nudged) - base) / scale / NUDGE
    wanted = (target - base) / scale
    gram = np.einsum("nij,nik->njk", response, response)
    size = np.einsum("njj->n", gram) / a.shape[1]
    damped = gram + (DAMPING * size + 1e-9)[:, None, None] * np.eye(a.shape[1])
    # δa = (JᵀJ + λI)⁻¹ Jᵀ (target − S(o, a))
    change = np.linalg.solve(damped, np.einsum("nij,ni->nj", response, wanted)[:, :, None])
    return np.asarray(a + np.clip(change[:, :, 0], -LARGEST, LARGEST), np.float32)
