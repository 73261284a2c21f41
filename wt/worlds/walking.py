"""Walking: a legged robot under a trained policy, on flat ground, on blocks, or with a payload.

The observation is proprioceptive: angular velocity and direction of gravity in the trunk's frame,
joint positions and velocities, and the last action, which are joint targets here. What it leaves
out is the hidden variable of a transition: where the trunk is and how fast it moves, and with a
payload where the ball is and how it rolls. Both domains stand on the same ground and carry the
same load; they differ in gains, friction and masses. A pair is S, set to R's observation *and*
hidden variable, under R's action.

Transitions come from the policy in closed loop under changing commands, with coloured exploration
noise. A robot that falls starts anew, as another episode.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import mujoco
import numpy as np

from wt.errors import ConfigError, WorkError
from wt.types import Channel, Domain, Pairs, Transitions, TransitionSpec
from wt.worlds.base import Progress, register
from wt.worlds.closed_loop import Truth
from wt.worlds.go2_model import Payload
from wt.worlds.legged import RATE_HZ, TIMESTEP, Herd, Scene, Start
from wt.worlds.legged_model import LeggedPhysics
from wt.worlds.policy import Policy
from wt.worlds.robots import robot_of
from wt.worlds.terrain import Blocks, Ground
from wt.worlds.walking_rollout import astray, walk
from wt.worlds.walking_state import WalkingState

Array = np.ndarray

MOST_FALLS = 6.0
"""Falls per robot and minute beyond which a policy does not walk here."""


@dataclass(frozen=True)
class WalkingOptions:
    """The ``world:`` section of ``conf/go2_*.yaml`` and ``conf/g1_*.yaml``.

    Attributes:
        robot: ``go2`` or ``g1``.
        policy: name of a policy of the package, or a folder that wt-train-policy left.
        sim: physics of domain S; its gains are those that the policy was trained for.
        real: physics of domain R.
        payload: a ball in a box on the back, in both domains; None for nothing.
        blocks: irregular terrain under both; None for a flat floor.
        robots: simulations stepped together.
        episode_steps: control steps before a robot starts anew.
        command: share of the policy's largest command that is asked for at most [-].
        command_seconds: how long a command holds on average [s].
        noise: standard deviation of the exploration noise, in units of the action scale [-].
        noise_seconds: its correlation time [s].
        start: spread of the states in which episodes begin.
        threads: physics threads; 0 for one per core.
    """

    robot: str
    policy: str
    sim: LeggedPhysics
    real: LeggedPhysics
    payload: Payload | None = None
    blocks: Blocks | None = None
    robots: int = 256
    episode_steps: int = 250
    command: float = 0.8
    command_seconds: float = 2.0
    noise: float = 0.05
    noise_seconds: float = 0.1
    start: Start = field(default_factory=lambda: Start(joints=0.05, speed=0.2))
    threads: int = 0

    def __post_init__(self) -> None:
        """Refuse sizes of nothing and times that are none."""
        for name in ("robots", "episode_steps", "command_seconds", "noise_seconds"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"world.{name} is {getattr(self, name)}; it must be above zero")
        if not 0 <= self.command <= 1:
            raise ConfigError(f"world.command is {self.command}; a share of 0 … 1 is needed")
        if not self.noise >= 0:
            raise ConfigError(f"world.noise is {self.noise}; zero or more is needed")
        if self.threads < 0:
            raise ConfigError(f"world.threads is {self.threads}; 0 is one per core")


@register("walking")
class WalkingWorld:
    """A walking robot in two domains; see the module."""

    options = WalkingOptions
    force_body = None

    def __init__(self, options: WalkingOptions) -> None:
        """Build both domains' models and load the policy.

        Args:
            options: see :class:`WalkingOptions`.

        Raises:
            ModelError: the policy is missing, or is one of another robot.
        """
        self._options = options
        self._robot = robot_of(options.robot)
        self._scene = Scene(options.payload, options.blocks)
        self._policy = Policy.load(options.policy, self._robot, options.sim)
        self._models = {
            domain: self._robot.describe(physics, TIMESTEP, self._scene).compile()
            for domain, physics in (("sim", options.sim), ("real", options.real))
        }
        self._state = WalkingState(self._robot, options.payload is not None)
        self.shard = options.robots * options.episode_steps
        joints, condition = self._robot.joints, "flat"
        if options.payload or options.blocks:
            condition = "payload" if options.payload else "uneven"
        targets = tuple(Channel(f"ctrl/{joint}", "rad") for joint in joints)
        n = len(joints)
        self.spec = TransitionSpec(
            task=f"{options.robot}_{condition}",
            rate_hz=RATE_HZ,
            joints=joints,
            observation=self._robot.channels()[: 6 + 2 * n]
            + tuple(Channel(f"last_action/{joint}", "rad") for joint in joints),
            n_state=6 + 2 * n,
            action=targets,
            hidden=self._state.channels,
            pose=tuple(range(6, 6 + n)),
        )

    def identity(self) -> dict[str, object]:
        """The options and the policy's hash; threads change nothing."""
        options = asdict(self._options)
        del options["threads"], options["policy"]
        return {"world": "walking", "policy": self._policy.card.sha256, **options}

    def model(self, domain: Domain) -> mujoco.MjModel:
        """The compiled MJCF of a domain."""
        return self._models[domain]

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """Closed-loop transitions of one domain, episode after episode; see :class:`World`.

        Raises:
            WorkError: the policy falls all the time.
        """
        options = self._options
        robots = min(options.robots, -(-count // options.episode_steps))
        batches = -(-count // (robots * options.episode_steps))
        seeds = np.random.SeedSequence(seed).spawn(batches)
        parts, falls, episodes = [], 0, 0
        for b, s in enumerate(seeds):
            part, fell = self._episodes(domain, robots, np.random.default_rng(s))
            part["episode"] += episodes
            episodes = int(part["episode"][-1]) + 1
            parts.append(part)
            falls += fell
            if progress:
                progress(min(count, (b + 1) * robots * options.episode_steps), count)
        minutes = batches * robots * options.episode_steps / RATE_HZ / 60.0
        if falls > MOST_FALLS * minutes:
            raise WorkError(
                f"the policy '{options.policy}' does not walk in domain {domain}: {falls} falls in "
                f"{minutes:.1f} robot minutes; train one for this world (wt-train-policy), or "
                "bring world.real nearer to world.sim"
            )
        fields = {name: np.concatenate([part[name] for part in parts])[:count] for name in parts[0]}
        nominal = self.sim_step(fields["o"], fields["a"], None)
        return Transitions(nominal=nominal, **fields)

    def sim_step(self, o: Array, a: Array, hidden: Array | None) -> Array:
        """S's answer to (o, a) under a hidden variable; see :class:`World`.

        Without one the robot stands on flat ground, moves as its lowest foot, which is at rest,
        tells, and the ball lies in the middle of its box.
        """
        return self.domain_step("sim", o, a, hidden)

    def domain_step(self, domain: Domain, o: Array, a: Array, hidden: Array | None) -> Array:
        """One control step of a domain from a given observation, action and hidden variable.

        Returns:
            The state channels one control step later, (N, n_state), float32.
        """
        return self._stepped(domain, o, a, hidden)[0]

    def advance(self, domain: Domain, o: Array, a: Array, hidden: Array) -> tuple[Array, Array]:
        """One control step, and the hidden variables after it; see :class:`ClosedLoop`."""
        return self._stepped(domain, o, a, hidden)

    def truth(self, count: int, past: int, horizon: int, seed: int) -> Truth:
        """R under its policy; see :class:`ClosedLoop`."""
        options = self._options
        return walk(
            Herd(self._robot, self._models["real"], count, self._scene, options.threads),
            self._policy,
            self._state,
            start=options.start,
            limits=options.command * np.array(self._policy.card.command_limits),
            command_seconds=options.command_seconds,
            past=past,
            horizon=horizon,
            rng=np.random.default_rng(seed),
        )

    def act(self, o: Array, context: Array) -> Array:
        """The policy's joint targets; see :class:`ClosedLoop`."""
        n = self.spec.n_state
        seen = np.hstack([o[:, :n], self._robot.actions(o[:, n:])])
        return self._robot.targets(self._policy.act(seen, context[:, :3], context[:, 3:]))

    def astray(self, s: Array, hidden: Array) -> Array:
        """Which robots cannot be where they are; see :class:`ClosedLoop`."""
        ground = Ground(self._scene.blocks).height(hidden[:, 0], hidden[:, 1])
        return astray(self._robot, s, hidden, ground)

    def _stepped(
        self, domain: Domain, o: Array, a: Array, hidden: Array | None
    ) -> tuple[Array, Array]:
        size, n = min(len(o), 2048), self.spec.n_state
        herd = Herd(self._robot, self._models[domain], size, self._scene, self._options.threads)
        out = np.empty((len(o), n), np.float32)
        after = np.empty((len(o), len(self.spec.hidden)), np.float32)
        for start in range(0, len(o), size):
            rows = slice(max(0, min(start, len(o) - size)), min(start + size, len(o)))
            h = None if hidden is None or not hidden.shape[1] else hidden[rows]
            self._state.restore(herd, o[rows], h)
            herd.step(self._robot.actions(a[rows]))
            out[rows], after[rows] = herd.observe()[:, :n], self._state.hidden(herd)
        return out, after

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """R's closed-loop transitions and S's answers from the same state."""
        real = self.collect("real", count, seed)
        return Pairs(real, self.sim_step(real.o, real.a, real.hidden))

    def _episodes(
        self, domain: Domain, robots: int, rng: np.random.Generator
    ) -> tuple[dict[str, Array], int]:
        """One episode of each robot, or several where it falls, and the number of falls."""
        options, robot, n = self._options, self._robot, self.spec.n_state
        steps = options.episode_steps
        herd = Herd(robot, self._models[domain], robots, self._scene, options.threads)
        herd.reset(np.arange(robots), rng, options.start)
        limits = options.command * np.array(self._policy.card.command_limits)
        command = rng.uniform(-limits, limits, (robots, 3))
        clock = self._policy.clock(robots)
        keep = np.exp(-herd.dt / options.noise_seconds)
        shape = (robots, len(robot.joints))
        noise = options.noise * rng.standard_normal(shape)
        found = {
            "o": np.empty((robots, steps, self.spec.n_obs), np.float32),
            "a": np.empty((robots, steps, shape[1]), np.float32),
            "s_next": np.empty((robots, steps, n), np.float32),
            "hidden": np.empty((robots, steps, len(self.spec.hidden)), np.float32),
        }
        begins = np.zeros((robots, steps), bool)
        begins[:, 0] = True
        falls = 0
        for k in range(steps):
            changed = rng.random(robots) < herd.dt / options.command_seconds
            command[changed] = rng.uniform(-limits, limits, (int(changed.sum()), 3))
            noise *= keep
            noise += options.noise * np.sqrt(1 - keep**2) * rng.standard_normal(shape)
            seen = herd.observe()
            action = self._policy.act(seen, command, clock.read(herd.time, command)) + noise
            found["o"][:, k, :n], found["o"][:, k, n:] = seen[:, :n], robot.targets(herd.action)
            found["hidden"][:, k] = self._state.hidden(herd)
            herd.step(action)
            found["a"][:, k] = robot.targets(herd.action)
            found["s_next"][:, k] = herd.observe()[:, :n]
            fallen = np.flatnonzero(herd.fallen())
            falls += len(fallen)
            herd.reset(fallen, rng, options.start)
            if k + 1 < steps:
                begins[fallen, k + 1] = True
        flat = {name: x.reshape(robots * steps, -1) for name, x in found.items()}
        return {**flat, **_numbered(begins)}, falls


def _numbered(begins: Array) -> dict[str, Array]:
    """Episode and step of each transition, (robots · steps,), where episodes begin."""
    first = np.flatnonzero(begins.reshape(-1))
    episode = np.cumsum(begins.reshape(-1)) - 1
    return {"episode": episode, "step": np.arange(begins.size) - first[episode]}
