"""Lightning's logger interface on a function: where ``self.log`` of the module ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities import rank_zero_only

MetricSink = Callable[[Mapping[str, float], int], None]
"""Called with metrics by name and the step they belong to."""


class SinkLogger(Logger):
    """Hands metrics to a sink: workers have no store of their own, and report to who has.

    The step is the module's own, which it logs as ``step``: Lightning's counts every optimizer.
    """

    def __init__(self, sink: MetricSink) -> None:
        """Keep the sink."""
        super().__init__()
        self._sink = sink
        self._handed_on: tuple[int | None, frozenset[str]] | None = None

    @property
    def name(self) -> str:
        """Of no meaning here: the sink knows what it is the metrics of."""
        return "wt"

    @property
    def version(self) -> int:
        """Of no meaning here."""
        return 0

    @rank_zero_only
    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Hand metrics on, without Lightning's count of epochs."""
        values = {k: float(v) for k, v in metrics.items() if k != "epoch"}
        # Lightning brings what was logged last at every step, until something else is logged
        brought = step, frozenset(values)
        if values and brought != self._handed_on:
            self._sink(values, int(step or 0))
            self._handed_on = brought

    def log_hyperparams(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 – Lightning's
        """The run has them already, whole."""
