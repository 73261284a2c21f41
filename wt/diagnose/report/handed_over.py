"""The files that run: what of a diagnosis is handed over to MuJoCo, before it is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wt.diagnose.report.verify import HOLDOUT, MODEL, PHYSICS, holdout_npz
from wt.diagnose.selection.holdout import Holdout
from wt.diagnose.unknown.force import graphed
from wt.mjcf.edit import patched_xml
from wt.mjcf.physics import physics_py
from wt.physics.planted import Hypothesis

RESIDUAL = "residual.onnx"


@dataclass(frozen=True)
class HandedOver:
    """Contents of the files.

    Attributes:
        model_xml: the MJCF with the findings.
        physics_py: what MJCF cannot say; None if it says it all.
        residual_onnx: learned laws; None if there are none.
        holdout_npz: where replays of the held-out recordings begin, and what they are against.
    """

    model_xml: str
    physics_py: str | None
    residual_onnx: bytes | None
    holdout_npz: bytes

    @property
    def contents(self) -> dict[str, str | bytes]:
        """By name of the file."""
        files = {
            MODEL: self.model_xml,
            PHYSICS: self.physics_py,
            RESIDUAL: self.residual_onnx,
            HOLDOUT: self.holdout_npz,
        }
        return {name: content for name, content in files.items() if content is not None}


def hand_over(
    holdout: Holdout,
    complete: Hypothesis,
    comments: tuple[Hypothesis, Sequence[str]],
    recordings: Sequence[str],
    timestep: float | None,
) -> HandedOver:
    """Make the files.

    Args:
        holdout: the held-out recordings.
        complete: everything that was found, and corrections.
        comments: what of it is written into the MJCF, and a sentence for each.
        recordings: names of all recordings, by index.
        timestep: a finer one than the model's own [s], if the recordings need it.
    """
    scene = holdout.smoothed.motion.scene
    named, graph = graphed(complete)
    everywhere = tuple(
        mine.beside(there) for mine, there in zip(named, holdout.here(named), strict=True)
    )
    shown = holdout.stretches[0].recording
    return HandedOver(
        patched_xml(scene, *comments, timestep=timestep),
        physics_py(scene, everywhere, recordings, shown),
        graph,
        holdout_npz(holdout, complete, recordings),
    )
