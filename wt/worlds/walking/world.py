"""Walking: a legged robot under a trained policy, on flat ground, on blocks, or with a payload.

The observation is proprioceptive: angular velocity and direction of gravity in the trunk's frame,
joint positions and velocities, and the last action, which are joint targets here. What it leaves
out is the hidden variable of a transition: where the trunk is and how fast it moves, and whatever
else moves in S, such as a ball in a box. Both domains stand on the same ground; they differ in
gains, friction and masses. A pair is S, set to R's observation *and* hidden variable, under R's
action.

R may carry something that S does not have (``concealed``), or that stands in S as another model
has it (``model``: a load on slides that a diagnosis found). What R's recordings say of the trunk
then still holds for S, but where S's own load is cannot be read off R. So S goes along: at every
step its trunk and joints are set to R's, and its load stays as its own last step left it, from rest
at the beginning of an episode. This looks at nothing but R's past motion, which a robot's estimator
gives as well, and it is what happens to hidden state when states are overwritten in use. In S's own
unpaired transitions the load simply moves as S's simulation moves it.

Transitions come from the policy in closed loop under changing commands, with coloured exploration
noise. A robot that falls starts anew, as another episode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from wt.errors import WorkError
from wt.types import Channel, Domain, Pairs, Recording, Transitions, TransitionSpec
from wt.worlds import given_model
from wt.worlds.base import Progress, register
from wt.worlds.closed_loop import ReferenceRollouts
from wt.worlds.legged import RATE_HZ, Herd
from wt.worlds.policy import Policy
from wt.worlds.robots import robot_of
from wt.worlds.terrain import GroundHeights
from wt.worlds.varied import drawn, lessons_spec, varied
from wt.worlds.walking.episodes import episodes
from wt.worlds.walking.options import WalkingOptions
from wt.worlds.walking.recording import HerdRecorder
from wt.worlds.walking.rollout import astray, walk
from wt.worlds.walking.state import TRUNK, WalkingState

MOST_FALLS = 6.0
"""Falls per robot and minute beyond which a policy does not walk here."""


class _Made(NamedTuple):
    """Herds that walk for a collection.

    Attributes:
        herd: makes one of a size, in a domain.
        read: reads its hidden variables, (robot, hidden).
        spec: layout of the transitions.
    """

    herd: Callable[[Domain, int], Herd]
    read: Callable[[Herd], np.ndarray]
    spec: TransitionSpec


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
            ModelError: the policy or the model is missing, or is one of another robot.
        """
        self._options, self.note = options, options.note
        self._robot = robot_of(options.robot)
        self._policy = Policy.load(options.policy, self._robot, options.sim)
        self._models = {"real": self.description("real").compile()}
        if options.model is None:
            self._models["sim"] = self.description("sim").compile()
        else:
            self._models["sim"] = given_model.load(options.model, self._robot)
        self._state = {d: WalkingState(self._robot, model) for d, model in self._models.items()}
        self._ground = GroundHeights(options.blocks)
        self.shard = options.robots * options.episode_steps
        joints, condition = self._robot.joints, "flat"
        if options.payload or options.blocks:
            condition = "payload" if options.payload else "uneven"
        condition = "concealed" if options.concealed else condition
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
            hidden=self._state["sim"].channels,
            pose=tuple(range(6, 6 + n)),
        )

    def identity(self) -> dict[str, object]:
        """The options and how the policy acts; threads and where a file lies change nothing."""
        options = asdict(self._options)
        del options["threads"], options["policy"], options["model"]
        return {"world": "walking", "policy": self._policy.identity, **options}

    def model(self, domain: Domain) -> mujoco.MjModel:
        """The compiled MJCF of a domain."""
        return self._models[domain]

    def description(self, domain: Domain) -> mujoco.MjSpec:
        """The MJCF that the options describe, for S also where a ``model`` takes its place."""
        options = self._options
        physics = options.sim if domain == "sim" else options.real
        return self._robot.describe(physics, options.timestep, options.scene(domain))

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """Closed-loop transitions of one domain, episode after episode; see :class:`World`.

        Raises:
            WorkError: the policy falls all the time.
        """
        made = _Made(self._herd, self._read(domain), self.spec)
        return self._collected(domain, made, count, seed, progress)

    def lessons(self, count: int, seed: int, progress: Progress | None = None) -> Transitions:
        """Transitions of robots that each have physics around S's; see :class:`Varied`.

        Raises:
            WorkError: the policy falls all the time there.
        """
        sim, robot = self._models["sim"], self._robot
        rng, factors = np.random.default_rng((seed, 1)), np.empty((0, 0))

        def herd(domain: Domain, size: int) -> Herd:
            nonlocal factors
            made, factors = self._herd(domain, size), drawn(rng, size)
            made.batch.set_models([varied(sim, robot.trunk, robot.joints, f) for f in factors])
            return made

        def read(herd: Herd) -> np.ndarray:
            return np.hstack([self._read("sim")(herd), factors])

        made = _Made(herd, read, lessons_spec(self.spec))
        return self._collected("sim", made, count, seed, progress)

    def _collected(
        self,
        domain: Domain,
        made: _Made,
        count: int,
        seed: int,
        progress: Progress | None,
    ) -> Transitions:
        """Transitions of the herds that are made, one for each batch of episodes."""
        options = self._options
        robots = min(options.robots, -(-count // options.episode_steps))
        batches = -(-count // (robots * options.episode_steps))
        seeds = np.random.SeedSequence(seed).spawn(batches)
        parts, falls, before = [], 0, 0
        for b, s in enumerate(seeds):
            herd, rng = made.herd(domain, robots), np.random.default_rng(s)
            part, fell = episodes(herd, self._policy, made.read, made.spec, options, rng)
            part["episode"] += before
            before = int(part["episode"][-1]) + 1
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

    def record(self, count: int, seed: int, robots: int) -> list[Recording]:
        """Recordings of R by an estimator while :meth:`collect` goes on.

        Args:
            count: as in ``collect("real", count, seed)``, of which these are the same walks.
            seed: likewise.
            robots: number of recordings, one an episode, of the first robots that do not fall.

        Raises:
            WorkError: fewer robots walk through an episode.
        """
        options = self._options
        size = min(options.robots, -(-count // options.episode_steps))
        (first,) = np.random.SeedSequence(seed).spawn(1)
        herd, rng = self._herd("real", size), np.random.default_rng(first)
        recorder = HerdRecorder(herd, size)
        part, _ = episodes(
            herd, self._policy, self._read("real"), self.spec, options, rng, recorder
        )
        ends = part["step"].reshape(size, -1)[:, -1]
        walked = np.flatnonzero(ends == options.episode_steps - 1)[:robots]
        if len(walked) < robots:
            raise WorkError(
                f"only {len(walked)} of {size} robots walked through an episode, {robots} are to "
                "be recorded; record fewer, or raise world.robots"
            )
        noise = np.random.default_rng((seed, 1))
        return [recorder.recording(int(i), noise) for i in walked]

    def sim_step(
        self,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot joint"],
        hidden: Float[np.ndarray, "robot hidden"] | None,
    ) -> Float32[np.ndarray, "robot state"]:
        """S's answer to (o, a) under a hidden variable; see :class:`World`.

        Without one the robot stands on flat ground, moves as its lowest foot, which is at rest,
        tells, and the ball lies in the middle of its box.
        """
        return self.domain_step("sim", o, a, hidden)

    def domain_step(
        self,
        domain: Domain,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot joint"],
        hidden: Float[np.ndarray, "robot hidden"] | None,
    ) -> Float32[np.ndarray, "robot state"]:
        """One control step of a domain from a given observation, action and hidden variable.

        Returns:
            The state channels one control step later.
        """
        return self._stepped(domain, o, a, hidden)[0]

    def advance(
        self,
        domain: Domain,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot joint"],
        hidden: Float[np.ndarray, "robot hidden"],
    ) -> tuple[Float32[np.ndarray, "robot state"], Float32[np.ndarray, "robot hidden_after"]]:
        """One control step, and the hidden variables after it; see :class:`ClosedLoop`."""
        return self._stepped(domain, o, a, hidden)

    def truth(self, count: int, past: int, horizon: int, seed: int) -> ReferenceRollouts:
        """R under its policy; see :class:`ClosedLoop`."""
        options = self._options
        truth = walk(
            self._herd("real", count),
            self._policy,
            self._read("real"),
            start=options.start,
            limits=options.command * np.array(self._policy.card.command_limits),
            command_seconds=options.command_seconds,
            past=past,
            horizon=horizon,
            rng=np.random.default_rng(seed),
        )
        if not self._apart:
            return truth
        n, steps = truth.a.shape[:2]
        step = np.arange(n * steps) % steps
        o, a, h = (x[:, :steps].reshape(n * steps, -1) for x in (truth.o, truth.a, truth.hidden))
        hidden = truth.hidden.copy()
        hidden[:, :steps] = self._followed(o, a, h, step)[1].reshape(n, steps, -1)
        return replace(truth, hidden=hidden)

    def act(
        self, o: Float[np.ndarray, "robot obs"], context: Float[np.ndarray, "robot context"]
    ) -> Float[np.ndarray, "robot joint"]:
        """The policy's joint targets; see :class:`ClosedLoop`."""
        n = self.spec.n_state
        seen = np.hstack([o[:, :n], self._robot.actions(o[:, n:])])
        return self._robot.targets(self._policy.act(seen, context[:, :3], context[:, 3:]))

    def stance(
        self,
        answer: Float[np.ndarray, "robot state"],
        target: Float[np.ndarray, "robot state"],
        hidden: Float[np.ndarray, "robot hidden"],
    ) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables with which standing feet stay; see :class:`ClosedLoop`."""
        return self._state["sim"].feet.kept(answer, target, hidden, self._ground.height)

    def astray(
        self, s: Float[np.ndarray, "robot state"], hidden: Float[np.ndarray, "robot hidden"]
    ) -> Bool[np.ndarray, " robot"]:
        """True where a robot cannot be; see :class:`ClosedLoop`."""
        ground = self._ground.height(hidden[:, 0], hidden[:, 1])
        return astray(self._robot, s, hidden, ground)

    def answers(self, real: Transitions) -> Float32[np.ndarray, "transition state"]:
        """S's answers from the same state; see :class:`World`."""
        return self._paired(real).sim_next

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """R's closed-loop transitions and S's answers from the same state; see the module."""
        return self._paired(self.collect("real", count, seed))

    def _paired(self, real: Transitions) -> Pairs:
        if not self._apart:
            return Pairs(real, self.sim_step(real.o, real.a, real.hidden))
        sim_next, hidden = self._followed(real.o, real.a, real.hidden, real.step)
        return Pairs(replace(real, hidden=hidden), sim_next)

    @property
    def _apart(self) -> bool:
        """True if something else moves in S than in R."""
        return self._state["sim"].channels != self._state["real"].channels

    def _herd(self, domain: Domain, size: int) -> Herd:
        options = self._options
        scene = options.scene(domain)
        return Herd(self._robot, self._models[domain], size, scene, options.threads)

    def _read(self, domain: Domain) -> Callable[[Herd], np.ndarray]:
        """A reader of a domain's hidden variables; NaN where R says nothing of S's."""
        read = self._state[domain].hidden
        if domain == "sim" or not self._apart:
            return read
        missing = len(self.spec.hidden) - TRUNK
        return lambda herd: np.pad(
            read(herd)[:, :TRUNK], ((0, 0), (0, missing)), constant_values=np.nan
        )

    def _stepped(
        self,
        domain: Domain,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot joint"],
        hidden: Float[np.ndarray, "robot hidden"] | None,
    ) -> tuple[Float32[np.ndarray, "robot state"], Float32[np.ndarray, "robot hidden_after"]]:
        size, n = min(len(o), 2048), self.spec.n_state
        herd, read = self._herd(domain, size), self._read(domain)
        known = TRUNK if domain == "real" and self._apart else len(self.spec.hidden)
        out = np.empty((len(o), n), np.float32)
        after = np.empty((len(o), len(self.spec.hidden)), np.float32)
        for start in range(0, len(o), size):
            rows = slice(max(0, min(start, len(o) - size)), min(start + size, len(o)))
            h = None if hidden is None else hidden[rows, :known]
            self._state[domain].restore(herd, o[rows], h)
            herd.step(self._robot.actions(a[rows]))
            out[rows], after[rows] = herd.observe()[:, :n], read(herd)
        return out, after

    def _followed(
        self,
        o: Float[np.ndarray, "step obs"],
        a: Float[np.ndarray, "step joint"],
        hidden: Float[np.ndarray, "step hidden"],
        step: Int[np.ndarray, " step"],
    ) -> tuple[Float32[np.ndarray, "step state"], Float[np.ndarray, "step hidden"]]:
        """S along R's motion, its load going on from step to step; see the module.

        Args:
            o: R's observations, episode after episode.
            a: actions.
            hidden: R's hidden variables, NaN beyond the trunk's.
            step: number of the step in its episode, from 0 without gaps.

        Returns:
            S's answers, and the hidden variables with S's own filled in.
        """
        answers = np.empty((len(o), self.spec.n_state), np.float32)
        hidden, after = hidden.copy(), np.empty_like(hidden)
        hidden[:, TRUNK:] = self._state["sim"].rest
        for k in range(int(step.max()) + 1):
            rows = np.flatnonzero(step == k)
            if k:
                hidden[rows, TRUNK:] = after[rows - 1, TRUNK:]
            answers[rows], after[rows] = self._stepped("sim", o[rows], a[rows], hidden[rows])
        return answers, hidden
