"""Diagnosis: where a model and recordings of the real machine part, why, and what to write.

Map: ``pipeline`` is the six steps in order; ``smooth`` makes a :class:`~wt.physics.motion.Motion`
of recordings; ``screen`` compares thousands of hypotheses on the force residual; ``decide``
replays the survivors; ``locate``, ``proof`` and ``remainder`` say where, how much better, and what
is left; ``measured`` and ``sensed`` what else the robot reports says to it; ``result`` and
``evidence`` hold what comes out; ``words``, ``figures``, ``report``, ``robot_drawing`` and
``playback`` show it, and ``write`` writes it.

The package can be called: ``wt.diagnose("robot.xml", ["a.parquet"])`` is :func:`diagnose`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wt.diagnose.report.report import Report
    from wt.types import Recording


def diagnose(
    model: str | Path,
    recordings: Sequence[str | Path | Recording],
    holdout: Sequence[str | Path | Recording] = (),
    *,
    seed: int = 0,
    jobs: int | str | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Report:
    """Find what a model leaves out, from recordings of the real machine.

    In a notebook the result shows itself; ``.show()`` prints it, ``.write(folder)`` writes the
    report, the patched model and the rest.

    Args:
        model: an MJCF file.
        recordings: what to fit: Parquet files of the recording format, or recordings.
        holdout: recordings for the proof only. Without any, the last of several recordings is
            held out, or the last quarter of a single one.
        seed: of everything random.
        jobs: where recordings are replayed: on so many cores (by default all), or with
            ``"ray"`` on a Ray cluster (see :func:`wt.physics.spread.over`); the answer is the same.
        progress: called as the work goes on, with what is being done and the share behind, 0…1.

    Raises:
        ModelError: the MJCF cannot be used.
        RecordingError: a recording cannot be used.
        UserError: ``jobs`` is none of these, or there is no Ray or no cluster.
    """
    from wt.diagnose.pipeline import diagnose as run
    from wt.diagnose.report.report import Report
    from wt.physics.spread import over

    with over(jobs):
        return Report.of(run(model, recordings, holdout, seed=seed, progress=progress))


class _Callable(ModuleType):
    """A module that is called as its function of the same name.

    ``import wt.diagnose`` makes the package an attribute of ``wt`` whatever that held before, so
    a function of this name could not live there; the package itself has to be callable.
    """

    __call__ = staticmethod(diagnose)
    __wrapped__ = staticmethod(diagnose)  # whose signature help() shows


sys.modules[__name__].__class__ = _Callable
