"""Orders in which channels, or whole joints, stand at each other's place."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wt.check.channels import STEP

Order = dict[int, int]
"""Channel: that whose column holds it; channels at their own place are left out."""
_MOST = 8
"""Exchanges that are made one after another, to sort columns."""
_ALIKE = 0.5
"""Of the logarithm of what is left, by which two orders cannot be told apart."""


def by_exchanges(
    pairs: Sequence[tuple[int, int]], score: Callable[[Order], float]
) -> tuple[Order, bool]:
    """The order that explains most, by exchanging two as long as that helps.

    Args:
        pairs: that may be exchanged.
        score: logarithm of what an order leaves, summed.

    Returns:
        (the order; whether no other last exchange leaves as little).
    """
    order, unique = Order(), True
    least = score(order)
    for _ in range(_MOST):
        trials = [_exchanged(order, *pair) for pair in pairs]
        scores = [score(trial) for trial in trials]
        if min(scores, default=least) > least - STEP:
            break
        least = min(scores)
        unique = sum(other < least + _ALIKE for other in scores) == 1
        order = trials[scores.index(least)]
    return order, unique


def _exchanged(order: Order, i: int, j: int) -> Order:
    changed = {**order, i: order.get(j, j), j: order.get(i, i)}
    return {channel: column for channel, column in changed.items() if channel != column}
