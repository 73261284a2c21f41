"""What a model shows by itself: it explodes, falls, guesses its masses, orders its drives oddly."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import mujoco
import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.physics.scene import Scene

_STEPS_S = 1.0
_FAST = 1e3  # rad/s or m/s, that nothing does
_DENSITY = 1000.0
_MOST_STEPS = 4000
_UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
             mujoco.mjtWarning.mjWARN_BADQACC)  # fmt: skip


@register
class Model:
    """The model runs, and says what it weighs."""

    kinds: ClassVar[tuple[str, ...]] = ("model_explodes", "model_falls", "masses_guessed",
                                        "actuator_order")  # fmt: skip
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one of each kind; the last two are notes."""
        scene = subject.scene
        if scene is None:
            return
        yield from _runs(scene)
        yield from _masses(scene)
        yield from _order(scene)


def _runs(scene: Scene) -> Iterable[AuditFinding]:
    """Hold the model's own pose for a while."""
    m = scene.given
    after = explodes(scene)
    if after is not None:
        pose = "its first keyframe" if m.nkey > 0 else "its zero pose"
        yield AuditFinding(
            "model_explodes",
            (),
            ("world",),
            f"Held in {pose}, the model becomes unstable after {after:.3g} s at a time step "
            f"of {1e3 * m.opt.timestep:.3g} ms",
            'a smaller <option timestep="…"/>, softer gains, or bodies that do not overlap',
        )
        return
    d = _held(m)
    start = d.qpos.copy()
    mujoco.mj_step(m, d, _steps(m))
    yield from _fell(scene, m, d, start, m.nkey > 0)


def explodes(scene: Scene) -> float | None:
    """Time after which a model explodes that is held in its own pose [s]; None if it does not."""
    m = scene.given
    d = _held(m)
    for _ in range(_steps(m)):
        mujoco.mj_step(m, d)
        if unstable(d):
            return float(d.time)
    return None


def unstable(d: mujoco.MjData) -> bool:
    """Tell whether a simulation has exploded."""
    warned = any(d.warning[int(w)].number for w in _UNSTABLE)
    return bool(warned or not np.isfinite(d.qpos).all() or np.abs(d.qvel).max(initial=0.0) > _FAST)


def _steps(m: mujoco.MjModel) -> int:
    return min(int(_STEPS_S / m.opt.timestep), _MOST_STEPS)


def _held(m: mujoco.MjModel) -> mujoco.MjData:
    """The model in its first keyframe, or its zero pose."""
    d = mujoco.MjData(m)
    if m.nkey > 0:
        mujoco.mj_resetDataKeyframe(m, d, 0)
    else:
        _hold(m, d)
    return d


def _hold(m: mujoco.MjModel, d: mujoco.MjData) -> None:
    """Commands of position drives that hold the pose they are in."""
    for i in range(m.nactuator):
        if m.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT and m.actuator_biasprm[i, 1] < 0.0:
            joint = int(m.actuator_trnid[i, 0])
            d.ctrl[i] = d.qpos[m.jnt_qposadr[joint]]


def _fell(
    scene: Scene, m: mujoco.MjModel, d: mujoco.MjData, start: np.ndarray, home: bool
) -> Iterable[AuditFinding]:
    """A base that drops although position drives hold the keyframe's pose."""
    driven = [i for i in range(m.nactuator) if m.actuator_biasprm[i, 1] < 0.0]
    if not home or len(driven) < m.nactuator or not driven:
        return
    for name in scene.free:
        at = int(m.jnt_qposadr[m.joint(name).id])
        before, after = start[at + 2], d.qpos[at + 2]
        if before > 0.0 and after < 0.5 * before:
            yield AuditFinding(
                "model_falls",
                (),
                (f"joint {name}",),
                f"Held in its first keyframe the model drops from {before:.3g} to {after:.3g} m in "
                f"{_STEPS_S:g} s",
                "check the feet's contacts with the floor, the keyframe and the drives' gains",
            )


def _masses(scene: Scene) -> Iterable[AuditFinding]:
    """Bodies that weigh what their shapes of water would."""
    spec = scene.written()
    guessed = []
    for body in spec.bodies[1:]:
        if body.explicitinertial or not scene.given.body(body.name).mass[0] if body.name else True:
            continue
        shapes = list(body.geoms)
        if shapes and all(np.isnan(g.mass) and g.density == _DENSITY for g in shapes):
            guessed.append(body.name)
    moving = [name for name in scene.moving if name]
    if moving and set(moving) <= set(guessed):
        yield AuditFinding(
            "masses_guessed",
            (),
            tuple(f"body {name}" for name in guessed),
            "Every moving body has the mass of its shape at 1000 kg/m³, MuJoCo's default: no mass "
            "is given",
            "an <inertial> for each body, or mass= on its geoms",
            0.5,
        )


def _order(scene: Scene) -> Iterable[AuditFinding]:
    """Drives in another order than their joints: easily mistaken in a log without names."""
    order = [d.dof for d in scene.drives]
    if len(set(order)) == len(order) and order != sorted(order):
        yield AuditFinding(
            "actuator_order",
            (),
            tuple(f"actuator {d.name}" for d in scene.drives),
            "The actuators come in the order "
            + ", ".join(d.joint for d in scene.drives)
            + ", and their joints do not",
            "name columns after actuators, never by number",
            0.5,
        )
