"""Drives that obey another law than MuJoCo's: their command is moved so that the force is right."""

from __future__ import annotations

import abc

import mujoco
import numpy as np

from wt.physics.live import Live, StepState
from wt.physics.scene import Drive, Scene

Array = np.ndarray


def without_limits(spec: mujoco.MjSpec, actuator: str) -> None:
    """Lift the clamps of an actuator's command and force, in place; :class:`DriveLaw` has them."""
    element = spec.actuator(actuator)
    element.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
    element.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE


class DriveLaw(Live):
    """Base of laws that turn the force a drive would give into the force it gives.

    Attributes:
        theta: parameters of each replay, (n, n_theta).
    """

    def __init__(self, drive: Drive, scene: Scene, theta: Array) -> None:
        """Prepare for the replays of ``theta``."""
        self.theta = theta
        self._drive = drive
        m, i = scene.model, drive.index
        wide = np.array([-np.inf, np.inf])
        self._ctrl = m.actuator_ctrlrange[i] if m.actuator_ctrllimited[i] else wide
        self._force = m.actuator_forcerange[i] if m.actuator_forcelimited[i] else wide

    @abc.abstractmethod
    def force(self, wanted: Array, drive: Drive, v: Array, t: Array) -> Array:
        """Force on the joint, (n,) [N·m].

        Args:
            wanted: what the model's drive would give, (n,) [N·m].
            drive: the drive.
            v: joint velocities, (n,) [rad/s].
            t: time since the recording's start, (n,) [s].
        """

    def act(self, state: StepState) -> None:
        """Move the command."""
        d = self._drive
        u = np.clip(state.u[:, d.index], *self._ctrl)
        q, v = state.q[:, d.dof] * d.gear, state.v[:, d.dof] * d.gear
        rest = d.bias[0] + d.bias[1] * q + d.bias[2] * v
        wanted = np.clip(d.gain * u + rest, *self._force) * d.gear
        given = self.force(wanted, d, state.v[:, d.dof], state.t)
        # force = gear · (gain · u + rest), solved for u
        state.u[:, d.index] = (given / d.gear - rest) / d.gain
