"""SO-101: R is a real arm, known through its recordings; S is MuJoCo's SO-101 as published.

Both are driven by the same command sequences. Nothing is hidden on purpose, but the real servos
answer some 60-140 ms late, limit their speed and stick, and the published model does none of that.
How motions are split stands in :mod:`wt.worlds.so101_motions`.

Observation at time t: positions and velocities of the five arm joints; the last action; then
``history`` delayed copies of positions and of commands, which tell about the servo's lag. The
velocity is the backward difference (q[t] - q[t-1])·rate: it is causal, S can have exactly the
same, and the servo's own register has the same resolution but is up to 20 ms older. The jaw is
commanded in S's closed loop but left out of the transitions (12 g, nothing depends on it).
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int

from wt.batch import Batch
from wt.errors import ConfigError
from wt.types import Channel, Domain, Pairs, Recording, Transitions, TransitionSpec
from wt.worlds import so101_model
from wt.worlds.base import NOTHING_HIDDEN, Progress, register
from wt.worlds.so101_model import ARM_JOINTS, JAW, JOINTS, LIMITS, ServoPhysics
from wt.worlds.so101_motions import TEST, TRAIN, VALIDATION, Motions, vary

_Windows = tuple[
    Float[np.ndarray, "window obs"],
    Float[np.ndarray, "window joint"],
    Float[np.ndarray, "window state"],
    Int[np.ndarray, " window"],
]
"""Observations, actions, next states and step numbers of transitions."""

RATE_HZ = 49.85
N = len(ARM_JOINTS)

_CHUNK = 16384  # simulations stepped together: bounds memory at some 20 MB
_UNEVEN = 0.1  # a sample interval further from the median is a gap
_START_SPREAD = 0.05  # rad, how far from the command an episode of S starts
_LIMITS = np.array([LIMITS[name] for name in JOINTS]).T
_HALF_OPEN = 0.5 * sum(LIMITS[JAW])


@dataclass(frozen=True)
class SO101Options:
    """The ``world:`` section of ``conf/so101.yaml``.

    Attributes:
        recordings: folder of the motion folders.
        train: names of the training motions, relative to ``recordings``.
        validation: names of the motions for choices.
        test: names of the motions for the final numbers.
        history: delayed samples in the observation, at least 1.
        kp: S's position gain [N·m/rad].
        kv: S's velocity gain [N·m·s/rad].
        damping: S's viscous friction [N·m·s/rad].
        frictionloss: S's dry friction [N·m].
        armature: S's rotor inertia at the joint [kg·m²].
        delay: S's delay of a command [s], at most ``history`` control steps.
        model: MJCF that takes the place of S's, such as the ``model.xml`` of a diagnosis, with
            gains, friction and delays of its own; None for the published arm.
        substeps: physics steps per control step.
        episode_steps: length of an episode of S's closed loop [control steps].
        threads: physics threads; 0 for one per core.
    """

    recordings: str = "../shared/recordings/so101"
    train: tuple[str, ...] = TRAIN
    validation: tuple[str, ...] = VALIDATION
    test: tuple[str, ...] = TEST
    history: int = 4
    kp: float = 17.8
    kv: float = 0.0
    damping: float = 0.60
    frictionloss: float = 0.052
    armature: float = 0.028
    delay: float = 0.0
    model: str | None = None
    substeps: int = 8
    episode_steps: int = 500
    threads: int = 0


@register("so101")
class SO101:
    """The real SO-101 and its simulation; see the module."""

    options = SO101Options
    force_body = None
    note = NOTHING_HIDDEN
    shard = sys.maxsize  # recordings cannot be divided by seed

    def __init__(self, options: SO101Options) -> None:
        """Check the options and build S; recordings are read when they are first needed.

        Args:
            options: see :class:`SO101Options`.

        Raises:
            ConfigError: a motion on two sides, or an option out of its range.
        """
        self._options = options
        history, substeps, delay = options.history, options.substeps, options.delay
        for name in ("history", "substeps", "episode_steps"):
            if (value := getattr(options, name)) < 1:
                raise ConfigError(f"world.{name} is {value}; it must be at least 1")
        if not 0.0 <= delay <= history / RATE_HZ:
            raise ConfigError(
                f"world.delay {delay} s must be in 0 … {history / RATE_HZ:.4f} s (history); "
                "raise world.history for more"
            )
        splits = {"train": options.train, "validation": options.validation, "test": options.test}
        self._motions = Motions(options.recordings, splits)
        self._history, self._substeps = history, substeps
        step = 1.0 / (RATE_HZ * substeps)
        servo = ServoPhysics(
            options.kp, options.kv, options.damping, options.frictionloss, options.armature,
            delay=delay,
        )  # fmt: skip
        given = options.model
        self._model = so101_model.load(given, step) if given else so101_model.build(servo, step)
        self._state = _State(self._model)
        observation = _channels("qpos", "rad") + _channels("qvel", "rad/s")
        observation += _channels("last_action", "rad")
        for kind, first in (("qpos", 1), ("ctrl", 2)):
            for lag in range(first, first + history):
                observation += _channels(kind, "rad", f"@-{lag}")
        self.spec = TransitionSpec(
            task="so101",
            rate_hz=RATE_HZ,
            joints=ARM_JOINTS,
            observation=observation,
            n_state=2 * N,
            action=_channels("ctrl", "rad"),
            pose=tuple(range(N)),
            integrated=tuple((j, N + j) for j in range(N)),
        )

    def identity(self) -> dict[str, object]:
        """The options and a fingerprint of every recorded file."""
        files = sorted(Path(self._options.recordings).rglob("*.csv"))
        sizes = {str(f.relative_to(self._options.recordings)): f.stat().st_size for f in files}
        return {"world": "so101", **asdict(self._options), "recorded": sizes}

    def model(self, domain: Domain) -> mujoco.MjModel:
        """S's model; for R the same one, for drawing only."""
        return self._model

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """Transitions of the training motions; see :class:`wt.worlds.base.World`.

        S visits states by running the training commands in closed loop, each episode from a
        random phase with a random shift and tempo, so there are as many as asked for. Its answer
        s_next is that of :meth:`sim_step` to the observation, as it is in evaluation: with the
        unobserved exact velocity it would be another 1 mrad away (a quarter of the gap to R).

        R has only what was recorded: asked for more, it gives all of it (fewer than ``count``);
        asked for less, an unbroken piece of every motion.
        """
        if domain == "real":
            return self._real("train", count, seed, progress)
        rng = np.random.default_rng(seed)
        episodes = -(-count // self._options.episode_steps)
        motions = [_stack(r, "ctrl", JOINTS) for r in self._motions.of("train")]
        commands = vary(motions, episodes, self._options.episode_steps + self._history + 2, rng)
        commands = np.clip(commands, *_LIMITS)
        start = commands[:, 0] + rng.normal(0.0, _START_SPREAD, commands[:, 0].shape)
        positions = np.empty_like(commands)
        for k, now in enumerate(self._closed_loop(commands, start)):
            positions[:, k] = now
            if progress:
                progress(count * k // commands.shape[1], count)
        parts = [
            self._windows(q[:, :N], c[:, :N]) for q, c in zip(positions, commands, strict=True)
        ]
        sim = self._transitions(parts, count, progress)
        return replace(sim, s_next=sim.nominal)

    def sim_step(
        self,
        o: Float[np.ndarray, "sample obs"],
        a: Float[np.ndarray, "sample joint"],
        hidden: Float[np.ndarray, "sample hidden"] | None,
    ) -> Float32[np.ndarray, "sample state"]:
        """S reset to o's positions and velocities, one control step later.

        Commands still under way (``delay``) are those in o. The jaw is held half open.

        Args:
            o: observations.
            a: actions of the five arm joints [rad].
            hidden: ignored: nothing is hidden, so it has no columns or is None.

        Returns:
            Positions [rad] and backward-difference velocities [rad/s].
        """
        del hidden
        parts = [
            self._step_chunk(np.asarray(o[i : i + _CHUNK], float), np.asarray(a[i : i + _CHUNK]))
            for i in range(0, len(o), _CHUNK)
        ]
        return np.concatenate([*parts, np.empty((0, 2 * N))]).astype(np.float32)

    def answers(self, real: Transitions) -> Float32[np.ndarray, "transition state"]:
        """S's answers, nothing being hidden; see :class:`World`."""
        return real.nominal

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """Real transitions of held-out motions, each with S's answer from the same state.

        Args:
            split: ``"validation"`` or ``"test"``.
            count: number of pairs; all there are if there are fewer.
            seed: decides which piece of each motion is taken.

        Raises:
            ConfigError: another split.
            DataError: no recordings.
        """
        if split not in ("validation", "test"):
            raise ConfigError(f"split {split!r} is not known; it must be 'validation' or 'test'")
        real = self._real(split, count, seed, None)
        return Pairs(real, self.answers(real))

    def _real(self, split: str, count: int, seed: int, progress: Progress | None) -> Transitions:
        rng = np.random.default_rng(seed)
        parts = [self._from_recording(r) for r in self._motions.of(split)]
        total = sum(len(part[0]) for part in parts)
        share = min(1.0, count / total)
        pieces = []
        for o, a, s, step in parts:
            length = int(np.ceil(share * len(o)))
            first = int(rng.integers(len(o) - length + 1))
            pieces.append(tuple(x[first : first + length] for x in (o, a, s, step)))
        return self._transitions(pieces, min(count, total), progress)

    def _transitions(
        self, parts: Sequence[tuple[np.ndarray, ...]], count: int, progress: Progress | None
    ) -> Transitions:
        """Join the episodes (o, a, s_next, step), cut to ``count``, add S's nominal answers."""
        o, a, s, step = (np.concatenate(x)[:count] for x in zip(*parts, strict=True))
        episode = np.concatenate([np.full(len(p[0]), i) for i, p in enumerate(parts)])[:count]
        # as they are stored: the nominal answer is exactly that to the stored observation
        o, a = o.astype(np.float32), a.astype(np.float32)
        nominal = self.sim_step(o, a, None)
        if progress:
            progress(count, count)
        return Transitions(o, a, s, nominal, np.empty((count, 0)), episode, step)

    def _from_recording(self, recording: Recording) -> _Windows:
        q, c = (_stack(recording, kind, ARM_JOINTS) for kind in ("qpos", "ctrl"))
        o, a, s, step = self._windows(q, c)
        # a window is used only if none of its samples is missing or late
        late = np.abs(np.diff(recording.t) * RATE_HZ - 1.0) > _UNEVEN
        bad = np.concatenate([[0], np.cumsum(late)])
        lead = self._history + 1
        unbroken = bad[lead + 1 :] == bad[: len(bad) - lead - 1]
        unbroken &= np.isfinite(np.hstack([o, a, s])).all(axis=1)
        return o[unbroken], a[unbroken], s[unbroken], step[unbroken]

    def _windows(
        self, q: Float[np.ndarray, "step joint"], c: Float[np.ndarray, "step joint"]
    ) -> _Windows:
        """Every transition (o, a, s_next, step) of one sequence.

        Args:
            q: positions of the arm joints at each control step [rad].
            c: command in force from that step on [rad].
        """
        lead = self._history + 1
        now = np.arange(lead, len(q) - 1)
        velocity = (q[1:] - q[:-1]) * RATE_HZ  # velocity[k] ends at sample k + 1
        lags = [q[now - k] for k in range(1, lead)] + [c[now - k] for k in range(2, lead + 1)]
        o = np.hstack([q[now], velocity[now - 1], c[now - 1], *lags])
        return o, c[now], np.hstack([q[now + 1], velocity[now]]), now - lead

    def _step_chunk(
        self, o: Float[np.ndarray, "sample obs"], a: Float[np.ndarray, "sample joint"]
    ) -> Float[np.ndarray, "sample state"]:
        """S's answers to at most ``_CHUNK`` observations and actions.

        What S remembers beside its joints' motion is what the observed past leaves in it: it goes
        through that, put where the joints were at each control step.
        """
        n = len(o)
        past = o[:, 3 * N :].reshape(n, 2, self._history, N).transpose(1, 2, 0, 3)
        q = [o[:, :N], *past[0]]  # so many control steps ago
        v = [o[:, N : 2 * N], *((new - old) * RATE_HZ for new, old in itertools.pairwise(q[1:]))]
        v.append(v[-1])
        commands = [a, o[:, 2 * N : 3 * N], *past[1]]
        batch = Batch(self._model, n, self._options.threads)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        position, velocity, control = (batch.bind(x) for x in ("qpos", "qvel", "ctrl"))
        first = self._history if self._state.remembers else 0
        self._state.begin(batch, _with_jaw(q[first], _HALF_OPEN))
        for age in range(first, -1, -1):
            position[:, self._state.q] = _with_jaw(q[age], _HALF_OPEN)
            velocity[:, self._state.v] = _with_jaw(v[age], 0.0)
            control[:, self._state.drives] = _with_jaw(commands[age], _HALF_OPEN)
            for _ in range(self._substeps):
                batch.step()
        after = position[:, self._state.q[:N]]
        return np.hstack([after, (after - q[0]) * RATE_HZ])

    def _closed_loop(
        self,
        commands: Float[np.ndarray, "episode step joint"],
        start: Float[np.ndarray, "episode joint"],
    ) -> Iterator[np.ndarray]:
        """Positions of S, (episode, joint) [rad], at each control step under the commands."""
        episodes, length, _ = commands.shape
        batch = Batch(self._model, episodes, self._options.threads)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        position, control = batch.bind("qpos"), batch.bind("ctrl")
        self._state.begin(batch, np.clip(start, *_LIMITS))
        for k in range(length):
            yield position[:, self._state.q]
            control[:, self._state.drives] = commands[:, k]
            for _ in range(self._substeps):
                batch.step()


class _State:
    """Where a model keeps what belongs to the arm's joints, and whether it remembers more.

    Attributes:
        q: addresses of the positions of :data:`JOINTS`.
        v: of their velocities.
        drives: of their commands.
        remembers: whether filters, late commands or further joints have a state of their own.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Look the names up."""
        joints = [model.joint(name) for name in JOINTS]
        self.q = np.array([joint.qposadr[0] for joint in joints])
        self.v = np.array([joint.dofadr[0] for joint in joints])
        self.drives = np.array([model.actuator_ctrladr[model.actuator(n).id] for n in JOINTS])
        others = [model.joint(i) for i in range(model.njnt) if model.joint(i).name not in JOINTS]
        # what a diagnosis adds to a joint is named after it, and begins where that is
        self._added = [
            (int(joint.qposadr[0]), k)
            for joint in others
            for k, name in enumerate(JOINTS)
            if joint.name.startswith(name)
        ]
        self.remembers = bool(others or model.na or model.actuator_delay.any())

    def begin(self, batch: Batch, q: Float[np.ndarray, "sample joint"]) -> None:
        """Put the joints, and what was added to them, at positions [rad]."""
        position = batch.bind("qpos")
        position[:, self.q] = q
        for address, k in self._added:
            position[:, address] = q[:, k]


def _with_jaw(
    arm: Float[np.ndarray, "sample arm"], jaw: float
) -> Float[np.ndarray, "sample joint"]:
    """Figures of the arm's joints, and the same one of the jaw for all."""
    return np.pad(arm, [(0, 0), (0, 1)], constant_values=jaw)


def _stack(
    recording: Recording, kind: str, joints: Sequence[str]
) -> Float[np.ndarray, "step joint"]:
    return np.stack([recording.columns[f"{kind}/{joint}"] for joint in joints], axis=1)


def _channels(kind: str, unit: str, suffix: str = "") -> tuple[Channel, ...]:
    return tuple(Channel(f"{kind}/{joint}{suffix}", unit) for joint in ARM_JOINTS)
