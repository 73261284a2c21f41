"""Parts that a patch adds to an MJCF: each stands for itself, whatever the user's classes say.

An element that is added bare inherits from ``<default>`` classes: a rotor would be damped as the
user's joints are, a payload would stretch like the user's links. So every part here is of the main
class, not of the ``childclass`` around it, and starts from MuJoCo's factory values; a text states
those of them that differ from the main class.
"""

from __future__ import annotations

import functools
from typing import Any

import mujoco
import numpy as np

_FROM_GEOMS = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)
_NO_VALUES = {
    "alt", "classname", "compiler", "default", "frame", "id", "info", "name", "parent", "path",
    "plugin", "signature", "userdata",
}  # fmt: skip
_STRETCHED = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID)


def add_body(spec: mujoco.MjSpec, parent: mujoco.MjsBody, name: str, **stated: Any) -> Any:  # noqa: ANN401
    """Add a body with attributes of ``MjsBody.add_body``; what it carries weighs what it states."""
    weigh_alone(spec)
    return parent.add_body(name=name, **stated)


def add_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, **stated: Any) -> Any:  # noqa: ANN401
    """Add a joint with attributes of ``MjsBody.add_joint``."""
    return _alone(body.add_joint(spec.default, name=name), "joint", stated)


def add_geom(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, **stated: Any) -> Any:  # noqa: ANN401
    """Add a geom with attributes of ``MjsBody.add_geom``."""
    return _placed(body.add_geom(spec.default, name=name), "geom", stated)


def add_site(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, **stated: Any) -> Any:  # noqa: ANN401
    """Add a site with attributes of ``MjsBody.add_site``."""
    return _placed(body.add_site(spec.default, name=name), "site", stated)


def add_tendon(spec: mujoco.MjSpec, name: str, **stated: Any) -> Any:  # noqa: ANN401
    """Add a tendon with attributes of ``MjSpec.add_tendon``."""
    return _alone(spec.add_tendon(spec.default, name=name), "tendon", stated)


def add_actuator(spec: mujoco.MjSpec, name: str, **stated: Any) -> Any:  # noqa: ANN401
    """Add an actuator with attributes of ``MjSpec.add_actuator``."""
    return _alone(spec.add_actuator(spec.default, name=name), "actuator", stated)


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of an MJCF, which stays as it is; every body of it is there, and weighs its own."""
    copy = spec.copy()
    copy.compiler.fusestatic = False
    return copy.compile()


def settle(spec: mujoco.MjSpec) -> None:
    """Replace by numbers what the compiler derives from other parts that a patch may change.

    A damping *ratio* of a position servo depends on inertia and gain, an inherited control range
    on the joint's range. The robot's controller knows neither.
    """
    affine = mujoco.mjtBias.mjBIAS_AFFINE
    loose = [
        a
        for a in spec.actuators
        if (a.biastype == affine and a.biasprm[2] > 0.0) or a.inheritrange > 0.0
    ]
    if not loose:
        return
    model = compiled(spec)
    for actuator in loose:
        i = model.actuator(actuator.name).id
        actuator.biasprm[:3] = model.actuator_biasprm[i, :3]
        if actuator.inheritrange > 0.0:
            actuator.inheritrange = 0.0
            if model.actuator_actlimited[i]:
                actuator.actrange = model.actuator_actrange[i]
            else:
                actuator.ctrlrange = model.actuator_ctrlrange[i]


def weigh_alone(spec: mujoco.MjSpec) -> None:
    """Replace rules of the compiler that make one body's weight depend on another's by numbers.

    They are those that would overrule what a body's ``inertial`` says: a total mass, least masses
    and inertias, and inertias from geoms even where they are written out.
    """
    compiler = spec.compiler
    least = compiler.boundmass > 0.0 or compiler.boundinertia > 0.0
    from_geoms = int(compiler.inertiafromgeom) == _FROM_GEOMS
    if not (compiler.settotalmass > 0.0 or least or from_geoms):
        return
    write_weights(spec)


def write_weights(spec: mujoco.MjSpec) -> None:
    """Write out the inertia of every body, by whatever rules of the compiler it came about."""
    model, compiler = compiled(spec), spec.compiler
    compiler.settotalmass = -1.0
    compiler.boundmass = compiler.boundinertia = 0.0
    compiler.inertiafromgeom = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO)
    for i, body in enumerate(spec.bodies[1:], start=1):
        write_weight(body, model, i)


def write_weight(body: mujoco.MjsBody, model: mujoco.MjModel, index: int) -> None:
    """Write out the inertia that a body has in a compiled model, in place."""
    body.explicitinertial = True
    body.mass, body.ipos = model.body_mass[index], model.body_ipos[index]
    body.iquat, body.inertia = model.body_iquat[index], model.body_inertia[index]
    body.fullinertia = np.full(6, np.nan)
    body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _alone(element: Any, kind: str, stated: dict[str, Any]) -> Any:  # noqa: ANN401
    for name, value in (_factory(kind) | stated).items():
        setattr(element, name, value)
    return element


def _placed(element: Any, kind: str, stated: dict[str, Any]) -> Any:  # noqa: ANN401
    """The same of what has a place and an extent; no text can take a ``fromto`` back."""
    stretched = bool(np.isfinite(element.fromto[0]))
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    _alone(element, kind, stated)
    if stretched and element.type in _STRETCHED:
        radius = float(element.size[0])
        element.type = mujoco.mjtGeom.mjGEOM_ELLIPSOID
        element.size = [radius, radius, radius]
        up = np.array([0.0, 0.0, radius])
        element.fromto = [*(element.pos + up), *(element.pos - up)]
        element.pos = np.zeros(3)
    return element


@functools.cache
def _factory(kind: str) -> dict[str, Any]:
    """MuJoCo's own values of the attributes of one kind of elements."""
    element = getattr(mujoco.MjSpec().default, kind)
    names = [n for n in dir(element) if not n.startswith("_") and n not in _NO_VALUES]
    values = {n: getattr(element, n) for n in names}
    return {
        n: np.array(v) if isinstance(v, np.ndarray) else v
        for n, v in values.items()
        if not callable(v)
    }
