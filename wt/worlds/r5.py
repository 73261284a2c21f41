"""R5: an arm that tracks end-effector poses, with or without a hidden external force.

*Normal*: nothing is hidden. *Force*: a force of 0–200 N on the gripper appears, turns and
vanishes without warning. It is held during a control step, so that the hidden variable of a
transition is one vector, and it is bounded twice: scaled down where it would load a joint beyond
``torque_cap``, and absent while the arm is near a joint limit or faster than ``speed_cap``. In a
direction drawn at random the wrist bears little: half of what acts is below 62 N. With several
``directions`` to choose from, half of it is above 90 N.

The collecting policy follows reference motions (``wt.worlds.motion``) with a slow integral
correction of what the joints lag behind, plus coloured exploration noise. The correction makes
actions react to forces and to the arm's own physics, as a real controller's do, which is the
leakage that the paper's classifier and FiLM decoder exist for.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float, Float32

from wt.batch import Batch
from wt.errors import ConfigError
from wt.types import Channel, Domain, Pairs, Transitions, TransitionSpec
from wt.worlds import r5_model
from wt.worlds.base import NOTHING_HIDDEN, Progress, register
from wt.worlds.motion import MotionSettings, plan_routes
from wt.worlds.r5_force import ForceSettings, HiddenForce
from wt.worlds.r5_model import GRIPPER, JOINTS, ArmPhysics


@dataclass(frozen=True)
class PolicySettings:
    """The collecting policy around the reference motion.

    Attributes:
        integral_gain: correction per second of the joint error [1/s].
        integral_limit: largest correction [rad].
        noise: standard deviation of the exploration noise [rad].
        noise_seconds: its correlation time [s].
    """

    integral_gain: float = 1.0
    integral_limit: float = 0.3
    noise: float = 0.05
    noise_seconds: float = 0.1

    def __post_init__(self) -> None:
        """Refuse settings that no motion follows from."""
        if not (min(self.integral_gain, self.integral_limit, self.noise) >= 0):
            raise ConfigError(f"world.policy: {self} has a negative number; zero or more is needed")
        if not self.noise_seconds > 0:
            raise ConfigError(
                f"world.policy.noise_seconds is {self.noise_seconds}; it must be above zero"
            )


@dataclass(frozen=True)
class R5Options:
    """The ``world:`` section of ``conf/r5*.yaml``.

    Attributes:
        sim: physics of domain S.
        real: physics of domain R.
        force: the hidden force; None for the Normal condition.
        policy: the collecting policy.
        motion: its reference motions.
        rate_hz: control rate [Hz].
        timestep: physics step [s]; must divide the control step.
        arms: simulations stepped together.
        episode_steps: control steps before an arm starts anew elsewhere.
        threads: physics threads; 0 for one per core.
    """

    sim: ArmPhysics
    real: ArmPhysics
    force: ForceSettings | None = None
    policy: PolicySettings = field(default_factory=PolicySettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    rate_hz: float = 50.0
    timestep: float = 0.002
    arms: int = 500
    episode_steps: int = 200
    threads: int = 0

    def __post_init__(self) -> None:
        """Refuse clocks that do not fit together, and sizes of nothing."""
        for name in ("rate_hz", "timestep", "arms", "episode_steps"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"world.{name} is {getattr(self, name)}; it must be above zero")
        substeps = 1.0 / (self.rate_hz * self.timestep)
        if abs(substeps - round(substeps)) > 1e-6:
            raise ConfigError(
                f"world.timestep {self.timestep} s does not divide the control step of "
                f"{1.0 / self.rate_hz:g} s (world.rate_hz {self.rate_hz:g}); change either"
            )
        if int(self.motion.route_seconds * self.rate_hz) < self.episode_steps + 2:
            raise ConfigError(
                f"world.motion.route_seconds {self.motion.route_seconds:g} is shorter than an "
                f"episode of world.episode_steps {self.episode_steps} and two more; change either"
            )
        if self.threads < 0:
            raise ConfigError(f"world.threads is {self.threads}; 0 is one per core")


def _channels(prefix: str, unit: str) -> tuple[Channel, ...]:
    return tuple(Channel(f"{prefix}/{joint}", unit) for joint in JOINTS)


@register("r5")
class R5World:
    """Two R5 arms that differ in gains, friction, armature and masses; see the module."""

    options = R5Options

    def __init__(self, options: R5Options) -> None:
        """Build both domains' models.

        Args:
            options: see :class:`R5Options`.
        """
        self._options = options
        self.force_body = GRIPPER if options.force else None
        self.note = None if options.force else NOTHING_HIDDEN
        self.shard = options.arms * options.episode_steps
        hidden = tuple(Channel(f"force/{axis}", "N") for axis in "xyz") if options.force else ()
        self.spec = TransitionSpec(
            task="r5_force" if options.force else "r5_normal",
            rate_hz=options.rate_hz,
            joints=JOINTS,
            observation=_channels("qpos", "rad")
            + _channels("qvel", "rad/s")
            + _channels("last_action", "rad"),
            n_state=12,
            action=_channels("ctrl", "rad"),
            hidden=hidden,
            pose=tuple(range(6)),
        )
        self._models = {
            "sim": r5_model.build(options.sim, options.timestep),
            "real": r5_model.build(options.real, options.timestep),
        }
        self._substeps = round(1.0 / (options.rate_hz * options.timestep))

    def identity(self) -> dict[str, object]:
        """The options; the models follow from them, and threads change nothing."""
        options = asdict(self._options)
        del options["threads"]
        return {"world": "r5", **options}

    def model(self, domain: Domain) -> mujoco.MjModel:
        """The compiled MJCF of a domain."""
        return self._models[domain]

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """Closed-loop transitions of one domain, episode after episode; see :class:`World`."""
        options = self._options
        arms = min(options.arms, -(-count // options.episode_steps))
        batches = -(-count // (arms * options.episode_steps))
        seeds = np.random.SeedSequence(seed).spawn(batches)
        parts = []
        for b, s in enumerate(seeds):
            parts.append(self._episodes(domain, arms, b * arms, np.random.default_rng(s)))
            if progress:
                progress(min(count, (b + 1) * arms * options.episode_steps), count)
        fields = {name: np.concatenate([part[name] for part in parts])[:count] for name in parts[0]}
        nominal = self.sim_step(fields["o"], fields["a"], None)
        return Transitions(nominal=nominal, **fields)

    def sim_step(
        self,
        o: Float[np.ndarray, "arm obs"],
        a: Float[np.ndarray, "arm joint"],
        hidden: Float[np.ndarray, "arm hidden"] | None,
    ) -> Float32[np.ndarray, "arm state"]:
        """S's answer to (o, a) under a hidden force; see :class:`World`."""
        return self.domain_step("sim", o, a, hidden)

    def domain_step(
        self,
        domain: Domain,
        o: Float[np.ndarray, "arm obs"],
        a: Float[np.ndarray, "arm joint"],
        hidden: Float[np.ndarray, "arm hidden"] | None,
    ) -> Float32[np.ndarray, "arm state"]:
        """One control step of a domain from a given observation, action and force.

        Returns:
            The state channels one control step later, (N, n_state), float32.
        """
        model = self._models[domain]
        out = np.empty((len(o), self.spec.n_state), np.float32)
        size = min(len(o), 4096)
        batch = Batch(model, size, self._options.threads)
        gripper = model.body(GRIPPER).id
        for start in range(0, len(o), size):
            stop = min(start + size, len(o))
            n = stop - start
            ids = np.arange(n)
            batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
            batch.qpos[:n] = o[start:stop, :6]
            batch.qvel[:n] = o[start:stop, 6:12]
            batch.ctrl[:n] = a[start:stop]
            if hidden is not None and hidden.shape[1]:
                batch.xfrc_applied[:n, gripper, :3] = hidden[start:stop]
            batch.step(ids, nstep=self._substeps)
            out[start:stop, :6] = batch.qpos[:n]
            out[start:stop, 6:] = batch.qvel[:n]
        return out

    def answers(self, real: Transitions) -> Float32[np.ndarray, "transition state"]:
        """S's answers under the same force; see :class:`World`."""
        return self.sim_step(real.o, real.a, real.hidden)

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """R's closed-loop transitions and S's answers under the same force."""
        real = self.collect("real", count, seed)
        return Pairs(real, self.answers(real))

    def _episodes(
        self, domain: Domain, arms: int, first: int, rng: np.random.Generator
    ) -> dict[str, np.ndarray]:
        """One episode of each arm, flattened to (arms · steps, …) in episode order."""
        options, model = self._options, self._models[domain]
        steps, dt = options.episode_steps, 1.0 / options.rate_hz
        routes = self._routes()
        route = rng.integers(len(routes), size=arms)
        start = rng.integers(routes.shape[1] - steps - 1, size=arms)
        batch = Batch(model, arms, options.threads)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        qpos, qvel, ctrl = batch.qpos, batch.qvel, batch.ctrl  # live views
        qpos[:] = routes[route, start] + 0.05 * rng.standard_normal((arms, 6))
        low, high = model.jnt_range[:, 0] + 0.05, model.jnt_range[:, 1] - 0.05
        force = HiddenForce(options.force, model, batch, rng) if options.force else None
        correction, noise = np.zeros((arms, 6)), np.zeros((arms, 6))
        keep = np.exp(-dt / options.policy.noise_seconds)
        last = qpos.copy()
        n_hidden = len(self.spec.hidden)
        obs = np.empty((arms, steps, 18), np.float32)
        act = np.empty((arms, steps, 6), np.float32)
        after = np.empty((arms, steps, 12), np.float32)
        hid = np.empty((arms, steps, n_hidden), np.float32)
        for k in range(steps):
            target = routes[route, start + k + 1]
            error = routes[route, start + k] - qpos
            limit = options.policy.integral_limit
            correction += options.policy.integral_gain * dt * error
            np.clip(correction, -limit, limit, out=correction)
            noise *= keep
            noise += options.policy.noise * np.sqrt(1 - keep**2) * rng.standard_normal((arms, 6))
            action = np.clip(target + correction + noise, low, high).astype(np.float32)
            obs[:, k, :6], obs[:, k, 6:12], obs[:, k, 12:] = qpos, qvel, last
            act[:, k] = action
            ctrl[:] = action
            if force is not None:
                hid[:, k] = force.draw(batch)
            batch.step(nstep=self._substeps)
            after[:, k, :6], after[:, k, 6:] = qpos, qvel
            last = action
        index = np.arange(arms * steps)
        return {
            "o": obs.reshape(arms * steps, -1),
            "a": act.reshape(arms * steps, -1),
            "s_next": after.reshape(arms * steps, -1),
            "hidden": hid.reshape(arms * steps, n_hidden),
            "episode": first + index // steps,
            "step": index % steps,
        }

    def _routes(self) -> Float[np.ndarray, "route sample joint"]:
        return _cached_routes(self._models["sim"], self._options.motion, self._options.rate_hz)


@lru_cache(maxsize=4)
def _cached_routes(
    model: mujoco.MjModel, motion: MotionSettings, rate_hz: float
) -> Float[np.ndarray, "route sample joint"]:
    return plan_routes(model, GRIPPER, motion, rate_hz, seed=0)
