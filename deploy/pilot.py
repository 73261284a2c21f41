"""A policy at work: the observation from a state, the action in a thread, the targets from it.

Inference runs in a thread of its own, so that one that hangs cannot keep the control loop from
noticing, and from telling the drives to brake.
"""

from __future__ import annotations

import time
from queue import Empty, SimpleQueue
from threading import Thread

import numpy as np
from jaxtyping import Float64

from deploy.robot import Joints, State
from wt.errors import WorkError
from wt.worlds.policy import Policy, PolicyCard

Question = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Observation, command and clock, as :meth:`wt.worlds.policy.Policy.act` takes them."""

_WARM_UP = 50  # inferences, before the first that counts


class Pilot:
    """One policy on one robot.

    Attributes:
        card: what the policy says about itself.
        pose: that the action 0 asks for [rad].
        gains: position and velocity gains of the drives [N·m/rad, N·m·s/rad].
        rate_hz: of the policy.
        seconds: how long each inference took [s].
        over: never; the operator ends a walk.
    """

    over = False

    def __init__(self, policy: Policy) -> None:
        """Start the thread and warm the policy up."""
        self.card: PolicyCard = policy.card
        self.seconds: list[float] = []
        self._policy = policy
        self.pose: Joints = np.array(policy.card.default)
        self.gains = np.array(policy.card.stiffness), np.array(policy.card.velocity_gain)
        self.rate_hz = policy.card.rate_hz
        self._scale = np.array(policy.card.action_scale)
        self._number = 0  # of the last question
        self._questions: SimpleQueue[tuple[int, Question]] = SimpleQueue()
        self._answers: SimpleQueue[tuple[int, np.ndarray | Exception, float]] = SimpleQueue()
        self.begin()
        for _ in range(_WARM_UP):
            nothing = np.zeros((1, 6 + 3 * len(policy.card.joints)), np.float32)
            policy.act(nothing, self._told, self._tick(0.0))
        self.begin()
        Thread(target=self._work, daemon=True, name="policy").start()

    def begin(self) -> None:
        """Forget the last action and start the gait's clock anew."""
        self.action = np.zeros(len(self.card.joints), np.float32)
        self._clock, self._steps = self._policy.clock(1), 0
        self._told = np.zeros((1, 3))

    def ask(self, state: State, command: Float64[np.ndarray, "xyz=3"]) -> None:
        """Have the next action computed.

        Args:
            state: what the robot measures.
            command: velocities forward and to the left [m/s], turning rate to the left [rad/s].
        """
        self._told = np.clip(command, *self._reach())[None]
        clock = self._tick(self._steps / self.rate_hz)
        self._steps += 1
        self._number += 1
        self._questions.put((self._number, (self.observe(state)[None], self._told, clock)))

    def answer(self, wait: float) -> np.ndarray | None:
        """The action that was asked for last, in units of the action scale; None if not there yet.

        Args:
            wait: how long to wait for it [s].

        Raises:
            WorkError: the policy failed.
        """
        number = 0
        while number != self._number:  # an older one comes too late to be of use
            try:
                number, action, seconds = self._answers.get(timeout=wait)
            except Empty:
                return None
        if isinstance(action, Exception):
            raise WorkError(f"the policy failed ({action}); export it again") from action
        self.seconds.append(seconds)
        return action

    def targets(self, action: np.ndarray) -> Joints:
        """Joint targets of an action [rad]; it becomes the last action."""
        self.action = action
        return self.pose + self._scale * action.astype(np.float64)

    def observe(self, state: State) -> np.ndarray:
        """The policy's observation of a state: :meth:`wt.worlds.legged.LeggedRobot.channels`."""
        parts = (state.gyro, gravity(state.quaternion), state.position, state.velocity, self.action)
        return np.concatenate(parts, dtype=np.float32)

    def _reach(self) -> tuple[np.ndarray, np.ndarray]:
        largest = np.array(self.card.command_limits)
        return -largest, largest

    def _tick(self, now: float) -> np.ndarray:
        return self._clock.read(np.array([now]), self._told)

    def _work(self) -> None:
        while True:
            number, question = self._questions.get()
            begin = time.perf_counter()
            try:
                action: np.ndarray | Exception = self._policy.act(*question)[0]
            except Exception as error:  # the control loop is to know, and goes on
                action = error
            self._answers.put((number, action, time.perf_counter() - begin))


def gravity(quaternion: Float64[np.ndarray, "wxyz=4"]) -> Float64[np.ndarray, "xyz=3"]:
    """Direction of gravity in the trunk's frame, (0, 0, −1) when upright; from wxyz."""
    w, x, y, z = quaternion / max(float(np.linalg.norm(quaternion)), 1e-9)
    # −(third row of the rotation matrix)
    return np.array([2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1])
