"""Keyframes of a patched model: the user's, with the joints and filters that were added in balance.

MuJoCo appends zeros to a keyframe's vectors, wherever in the tree the new joints are: a rotor would
start a turn away from its link, and joints behind it would have each other's angles.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco

from wt.physics.activation import following
from wt.physics.hooks import Stateful
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene

_FOLLOWING = (
    int(mujoco.mjtDyn.mjDYN_FILTER),
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT),
    int(mujoco.mjtDyn.mjDYN_PID),
)
_POSITIONS = {int(mujoco.mjtJoint.mjJNT_FREE): (7, 6), int(mujoco.mjtJoint.mjJNT_BALL): (4, 3)}


def balance(spec: mujoco.MjSpec, scene: Scene, hypothesis: Hypothesis) -> bool:
    """Complete the keyframes of a patched spec, in place; tells whether there was a need to."""
    given = scene.given
    if not given.nkey:
        return False
    patched = spec.copy().compile()
    if (patched.nq, patched.na) == (given.nq, given.na):
        return False
    for i, key in enumerate(spec.keys):
        data = mujoco.MjData(patched)
        data.ctrl[:] = given.key_ctrl[i]
        _copy(given, patched, data, i)
        for p in hypothesis:
            if isinstance(p.effect, Stateful):
                _start(
                    p.effect.balanced(p.at, p.theta, scene, _joints(patched, data), data.ctrl), data
                )
        key.qpos, key.act = data.qpos.copy(), data.act.copy()
        if given.key_qvel[i].any():
            key.qvel = data.qvel.copy()
    return True


def _copy(given: mujoco.MjModel, patched: mujoco.MjModel, data: mujoco.MjData, key: int) -> None:
    """The user's own joints and activations, by name; new filters have let the command through."""
    for j in range(given.njnt):
        name = given.joint(j).name
        nq, nv = _POSITIONS.get(int(given.jnt_type[j]), (1, 1))
        q, v = given.jnt_qposadr[j], given.jnt_dofadr[j]
        there_q, there_v = patched.joint(name).qposadr[0], patched.joint(name).dofadr[0]
        data.qpos[there_q : there_q + nq] = given.key_qpos[key, q : q + nq]
        data.qvel[there_v : there_v + nv] = given.key_qvel[key, v : v + nv]
    slow = following(patched).tolist()
    for i in range(patched.nactuator):
        start, count = patched.actuator_actadr[i], patched.actuator_actnum[i]
        names = [given.actuator(k).name for k in range(given.nactuator)]
        k = names.index(patched.actuator(i).name) if patched.actuator(i).name in names else -1
        if k >= 0 and given.actuator_actnum[k] == count and count:
            before = given.actuator_actadr[k]
            data.act[start : start + count] = given.key_act[key, before : before + count]
        elif int(patched.actuator_dyntype[i]) in _FOLLOWING and i in slow:
            data.act[start] = data.ctrl[patched.actuator_ctrladr[i]]


def _joints(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, tuple[float, float]]:
    """Position and velocity of every hinge and slide."""
    single = [j for j in range(model.njnt) if int(model.jnt_type[j]) not in _POSITIONS]
    return {
        model.joint(j).name: (
            float(data.qpos[model.jnt_qposadr[j]]),
            float(data.qvel[model.jnt_dofadr[j]]),
        )
        for j in single
    }


def _start(states: Mapping[str, tuple[float, float]], data: mujoco.MjData) -> None:
    for name, (q, v) in states.items():
        data.joint(name).qpos, data.joint(name).qvel = q, v
