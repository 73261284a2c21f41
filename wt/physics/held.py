"""Signals that are held from one sample to the next, as commands are."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def impulses(
    t: Float[np.ndarray, " sample"],
    held: Float[np.ndarray, "sample column"],
    edges: Float[np.ndarray, " edge"],
) -> Float[np.ndarray, "interval column"]:
    """Integrals of held signals over intervals; over an interval's length, their means.

    Args:
        t: times of the samples, (K,) [s].
        held: values from each sample to the next, (K, n); the first was held before, and the last
            goes on being held.
        edges: ends of the intervals, one after another, (I + 1,) [s].
    """
    integral = np.zeros_like(held)  # from the first sample on
    integral[1:] = np.cumsum(held[:-1] * np.diff(t)[:, None], axis=0)
    first, last = min(t[0], edges[0]) - 1.0, max(t[-1], edges[-1]) + 1.0
    integral = np.vstack(
        [held[:1] * (first - t[0]), integral, integral[-1] + held[-1:] * (last - t[-1])]
    )
    knots = np.concatenate([[first], t, [last]])
    columns = [np.diff(np.interp(edges, knots, column)) for column in integral.T]
    return np.stack(columns, axis=1) if columns else np.zeros((len(edges) - 1, 0))
