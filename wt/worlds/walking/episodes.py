"""Collection from walking robots: episode after episode under their policy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool

from wt.types import TransitionSpec
from wt.worlds.legged import Herd
from wt.worlds.policy import Policy
from wt.worlds.walking.options import WalkingOptions


def episodes(
    herd: Herd,
    policy: Policy,
    read: Callable[[Herd], np.ndarray],
    spec: TransitionSpec,
    options: WalkingOptions,
    rng: np.random.Generator,
    watch: Callable[[], None] | None = None,
) -> tuple[dict[str, np.ndarray], int]:
    """One episode of each robot, or several where it falls.

    Args:
        herd: the robots.
        policy: that walks.
        read: reads the hidden variables of a herd, (robot, hidden).
        spec: layout of the transitions.
        options: commands, noise and length.
        rng: of starts, commands and noise.
        watch: called before every physics step.

    Returns:
        Fields of transitions by name, robot after robot, without ``nominal``; and the number of
        falls.
    """
    robot, robots, n = herd.robot, herd.size, spec.n_state
    steps = options.episode_steps
    herd.reset(np.arange(robots), rng, options.start)
    limits = options.command * np.array(policy.card.command_limits)
    command = rng.uniform(-limits, limits, (robots, 3))
    clock = policy.clock(robots)
    keep = np.exp(-herd.dt / options.noise_seconds)
    shape = (robots, len(robot.joints))
    noise = options.noise * rng.standard_normal(shape)
    widths = {"o": spec.n_obs, "a": shape[1], "s_next": n, "hidden": len(spec.hidden)}
    fields = {name: np.empty((robots, steps, k), np.float32) for name, k in widths.items()}
    begins = np.zeros((robots, steps), bool)
    begins[:, 0] = True
    falls = 0
    for k in range(steps):
        changed = rng.random(robots) < herd.dt / options.command_seconds
        command[changed] = rng.uniform(-limits, limits, (int(changed.sum()), 3))
        noise *= keep
        noise += options.noise * np.sqrt(1 - keep**2) * rng.standard_normal(shape)
        seen = herd.observe()
        action = policy.act(seen, command, clock.read(herd.time, command)) + noise
        fields["o"][:, k, :n], fields["o"][:, k, n:] = seen[:, :n], robot.targets(herd.action)
        fields["hidden"][:, k] = read(herd)
        herd.step(action, watch)
        fields["a"][:, k] = robot.targets(herd.action)
        fields["s_next"][:, k] = herd.observe()[:, :n]
        fallen = np.flatnonzero(herd.fallen())
        falls += len(fallen)
        herd.reset(fallen, rng, options.start)
        if k + 1 < steps:
            begins[fallen, k + 1] = True
    flat = {name: x.reshape(robots * steps, -1) for name, x in fields.items()}
    return {**flat, **_numbered(begins)}, falls


def _numbered(begins: Bool[np.ndarray, "robot step"]) -> dict[str, np.ndarray]:
    """Episode and step of each transition, robot after robot, given where episodes begin."""
    first = np.flatnonzero(begins.reshape(-1))
    episode = np.cumsum(begins.reshape(-1)) - 1
    return {"episode": episode, "step": np.arange(begins.size) - first[episode]}
