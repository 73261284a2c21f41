"""Steps of several episodes at once, as transitions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wt.types import Transitions

Row = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of a step: o, a, the state after it and what was hidden, (episode, channel) each."""


def in_order(
    rows: Sequence[Row], sim_step: Callable[[np.ndarray, np.ndarray, None], np.ndarray]
) -> Transitions:
    """Episode after episode, with S's answers with nothing hidden."""
    o, a, after, hidden = (
        np.concatenate(np.stack(each, axis=1)).astype(np.float32)
        for each in zip(*rows, strict=True)
    )
    index = np.arange(len(o))
    return Transitions(
        o=o, a=a, s_next=after, nominal=sim_step(o, a, None), hidden=hidden,
        episode=index // len(rows), step=index % len(rows),
    )  # fmt: skip
