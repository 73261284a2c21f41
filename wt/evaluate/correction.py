"""Action correction: the action under which the simulator itself does what translation says.

Overwriting a simulator's state leaves whatever it keeps inside unchanged. Correcting the action
instead, as grounded action transformation does (Hanna and Stone 2017), keeps it consistent. The
paper names the combination with translated targets as an extension. Here the simulator is its own
inverse model: one damped Gauss-Newton step on its finite differences.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wt.worlds.closed_loop import ClosedLoop

Array = np.ndarray

NUDGE = 0.02
"""Step of the finite differences [rad]."""
DAMPING = 0.3
"""How dear a change of action is, relative to the mean square of the simulator's response: far
joints barely move some channels in one control step, and contacts make responses jump."""
LARGEST = 0.3
"""Largest change of an action [rad]."""


Answer = Callable[[Array], Array]
"""S's states after the step, (N, n_state), under actions, (N, n_action); always from one state."""


def corrected_action(
    world: ClosedLoop, o: Array, a: Array, hidden: Array, target: Array, scale: Array
) -> Array:
    """Actions that bring S from (o, hidden) nearest to a target state.

    Args:
        world: whose simulator it is.
        o: observations, (N, n_obs).
        a: the policy's actions, (N, n_action).
        hidden: hidden variables, (N, n_hidden).
        target: state channels that are wanted after the step, (N, n_state).
        scale: what differences are measured in, (n_state,).

    Returns:
        (N, n_action), float32.
    """
    return correct(lambda action: world.advance("sim", o, action, hidden)[0], a, target, scale)


def correct(answer: Answer, a: Array, target: Array, scale: Array) -> Array:
    """The same for any simulator.

    Args:
        answer: the simulator.
        a: the policy's actions, (N, n_action) [rad].
        target: state channels that are wanted after the step, (N, n_state).
        scale: what differences are measured in, (n_state,).

    Returns:
        (N, n_action), float32.
    """
    base = answer(a)
    response = np.empty((len(a), base.shape[1], a.shape[1]))
    for j in range(a.shape[1]):
        nudged = a.copy()
        nudged[:, j] += NUDGE
        response[:, :, j] = (answer(nudged) - base) / scale / NUDGE
    wanted = (target - base) / scale
    gram = np.einsum("nij,nik->njk", response, response)
    size = np.einsum("njj->n", gram) / a.shape[1]
    damped = gram + (DAMPING * size + 1e-9)[:, None, None] * np.eye(a.shape[1])
    # δa = (JᵀJ + λI)⁻¹ Jᵀ (target − S(o, a))
    change = np.linalg.solve(damped, np.einsum("nij,ni->nj", response, wanted)[:, :, None])
    return np.asarray(a + np.clip(change[:, :, 0], -LARGEST, LARGEST), np.float32)
