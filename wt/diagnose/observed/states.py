"""States of a machine along replays, in which its sensors are read."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.acting import any_live
from wt.physics.planted import Hypothesis
from wt.physics.replay import Inputs, Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene


class States:
    """States of a machine in which sensors are read.

    Attributes:
        model: the machine with the hypothesis in it.
        data: the state that was set last; its arrays stay where they are.
        exact: true where all forces that a hypothesis adds follow from the joints' state alone.
            Rotors of their own, laws that act step by step and pushes are not.
    """

    def __init__(self, scene: Scene, replayer: Replayer, hypothesis: Hypothesis) -> None:
        """Compile the machine with a hypothesis in it."""
        self.scene, self.step, self.hypothesis = scene, replayer.step, hypothesis
        model = replayer.compile(hypothesis)
        lagging = model.na > 0 or bool((model.actuator_delay > 0.0).any())
        live = any_live(hypothesis)
        self.exact = model.nq == scene.model.nq and not lagging and not live
        if model.nq != scene.model.nq:
            model = replayer.compile(())
        model.sensor_delay[:] = 0.0  # there is no past in which a buffer could have been filled
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        self.model, self.data = model, mujoco.MjData(model)
        joints = [model.joint(name) for name in scene.joints]
        self._q = np.array([int(j.qposadr[0]) for j in joints])
        self._v = np.array([int(j.dofadr[0]) for j in joints])
        # patches add motors without commands
        self._u = [
            scene.model.actuator(model.actuator(i).name).id
            for i in range(model.nactuator)
            for _ in range(model.actuator_ctrlnum[i])
        ]

    def commands(
        self, s: Stretch
    ) -> tuple[Float[np.ndarray, "sample command"], Float[np.ndarray, "sample command"]]:
        """Commands in force just before and just after the samples of a stretch."""
        steps = int(np.ceil((s.t[-1] - s.t[0]) / self.step)) + 1
        t = s.t[0] + self.step * np.arange(steps)
        inputs = Inputs(s.recording, t, self.step, s.commands(self.step, steps), stretch=s)
        for p in self.hypothesis:
            p.drive(inputs, self.scene)
        self.exact &= not inputs.force
        at = np.round((s.t - s.t[0]) / self.step).astype(int)
        return inputs.u[np.maximum(at - 1, 0)], inputs.u[np.minimum(at + 1, steps - 1)]

    def set(
        self,
        q: Float[np.ndarray, " dof"],
        v: Float[np.ndarray, " dof"],
        a: Float[np.ndarray, " dof"],
        u: Float[np.ndarray, " command"],
    ) -> None:
        """Bring ``data`` to a position, velocity, acceleration and command."""
        m, d = self.model, self.data
        d.qpos[self._q], d.qvel[self._v], d.ctrl[:] = q, v, u[self._u]
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_fwdActuation(m, d)
        d.qacc[self._v] = a
        mujoco.mj_inverse(m, d)
