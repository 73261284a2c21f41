"""Positions beyond the limits that the model gives a joint."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import ClassVar

import mujoco
import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding

_BEYOND, _BEYOND_M = math.radians(4.0), 0.01
_SHARE = 0.01


@register
class Limits:
    """A recording stays inside the model's joint limits."""

    kinds: ClassVar[tuple[str, ...]] = ("joint_limit",)
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each joint that is beyond."""
        scene, recording = subject.scene, subject.recording
        if scene is None or recording is None:
            return
        m = scene.model
        for i in range(m.njnt):
            name = m.joint(i).name
            x = recording.columns.get(f"qpos/{name}")
            if x is None or not m.jnt_limited[i] or np.isfinite(x).sum() < 12:
                continue
            hinge = m.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE
            low, high = m.jnt_range[i]
            seen = np.nanquantile(x, [_SHARE, 1.0 - _SHARE])
            if max(low - seen[0], seen[1] - high) <= (_BEYOND if hinge else _BEYOND_M):
                continue
            unit = "rad" if hinge else "m"
            yield AuditFinding(
                "joint_limit",
                (f"qpos/{name}",),
                (f"joint {name}",),
                f"'qpos/{name}' runs from {np.nanmin(x):.4g} to {np.nanmax(x):.4g} {unit}, and the "
                f"model's joint from {low:.4g} to {high:.4g}: another zero, or wrong limits",
                f"range of joint {name} in the MJCF, or offsets: {{qpos/{name}: …}}",
                0.9,
            )
