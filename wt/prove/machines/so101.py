"""SO-101: a six-servo arm (Feetech STS3215), isaac-sim2real/sage, Apache-2.0."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, between, imported, register
from wt.types import Recording
from wt.worlds.rigs import so101_spec

_SECONDS = 60.0


@register
class So101(Machine):
    """Two motions of a minute to fit, two to score; one was run again."""

    name: ClassVar[str] = "so101"
    folder: ClassVar[str] = "so101"
    source: ClassVar[str] = "isaac-sim2real/sage, Apache-2.0"
    fit: ClassVar[tuple[str, ...]] = ("multisine", "step_response")
    holdout: ClassVar[tuple[str, ...]] = ("fast_transitions", "single_joint_elbow")
    repeated: ClassVar[tuple[str, ...]] = ("fast_transitions",)
    known: ClassVar[str] = (
        "servos softer than the public model's, about 20 ms of delay, dry friction"
    )

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`; the first minute."""
        return between(imported(home / self.folder / motion), 0.0, _SECONDS)

    def given(self) -> mujoco.MjSpec:
        """The public arm with the servo figures published for it, friction included."""
        return so101_spec()
