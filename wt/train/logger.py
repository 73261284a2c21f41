"""Where metrics go: from Lightning's ``self.log`` and from plain regressions, into one function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities import rank_zero_only

from wt.train.regression import Progress, Score

MetricSink = Callable[[Mapping[str, float], int], None]
"""Called with metrics by name and the step they belong to."""


class Curves:
    """Held-out errors of regressions as curves ``val/<name>``, by the steps that are done."""

    def __init__(self, sink: MetricSink | None = None, progress: Progress | None = None) -> None:
        """Begin before the first step.

        Args:
            sink: where the errors go.
            progress: told of the steps, too.
        """
        self._sink, self._progress, self._done = sink, progress, 0

    def follow(self, done: int, total: int) -> None:
        """Take note of the steps that are done."""
        self._done = done
        if self._progress:
            self._progress(done, total)

    def drawn(self, name: str, score: Score) -> Score:
        """A score that is also a point of the curve of that name."""

        def told() -> float:
            value = score()
            if self._sink:
                self._sink({f"val/{name}": value}, self._done)
            return value

        return told


class SinkLogger(Logger):
    """Hands metrics to a sink: workers have no store of their own, and report to who has."""

    def __init__(self, sink: MetricSink) -> None:
        """Keep the sink."""
        super().__init__()
        self._sink = sink

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
        if values:
            self._sink(values, int(step or 0))

    def log_hyperparams(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 – Lightning's
        """The run has them already, whole."""
