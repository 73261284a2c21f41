"""A trained walking policy: an ONNX graph and the card that says what it may be used for.

The folder of a policy holds ``policy.onnx`` and ``card.json``. The graph has one input
``observation``, (batch, n_in): :meth:`wt.worlds.legged.LeggedRobot.channels` in order, then the
command, then the clock of :mod:`wt.worlds.gait` if the policy walks to one; and one output
``action``, (batch, n), in units of the robot's ``action_scale``. The observation normaliser is part
of it. The graph says of itself, in its ``metadata_props``, what mjlab and Isaac Lab write there,
units, and what made it: see :func:`metadata`.
"""

from __future__ import annotations

import hashlib
import json
import operator
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from wt.errors import ModelError
from wt.types import Channel
from wt.worlds.gait import CLOCK, GaitClock
from wt.worlds.legged import COMMAND, COMMAND_UNITS, RATE_HZ, LeggedRobot
from wt.worlds.legged_model import LeggedPhysics

GRAPH = "policy.onnx"
CARD = "card.json"
SCHEMA = 2
LOCAL = "local"
"""``run_path`` of what no store of runs has, as mjlab writes it."""
_ROUNDED = 6e-4
_NUMBERS = ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale", "rate_hz")
"""Keys of metadata whose values are compared as numbers."""
SHIPPED = Path(__file__).with_name("policies")
"""Folder of the package's policies, one folder each."""


@dataclass(frozen=True, kw_only=True)
class PolicyCard:
    """The facts that are needed to use a policy and to trust it.

    Attributes:
        name: of the policy.
        robot: name of the robot.
        task: what it was trained for: its configuration's name, or the task of a fine-tuning.
        rate_hz: control rate [Hz].
        joints: names in the order of positions, velocities and actions.
        default: pose that the action 0 asks for [rad].
        action_scale: what the action 1 adds to it [rad].
        stiffness: position gains of the drives [N·m/rad].
        velocity_gain: their velocity gains [N·m·s/rad].
        observation: channels of the graph's input, in order: the robot's, the command's, and those
            of a clock if it has one.
        observation_units: of these channels.
        command_limits: largest command that it was trained for, either way.
        sha256: of the graph.
        made_by: the command that made it.
        commit: of the code that ran then; ``"unknown"`` outside git.
        run_path: its run in MLflow, as EXPERIMENT/RUN_ID; :data:`LOCAL` without one.
        sources: sha256 of what it was made from, by name: the ``start_policy`` or ``checkpoint``
            that the training began with, the ``model`` that translated.
        training: iterations, seconds, samples.
        config: the resolved configuration.
        clock_period: T of the clock's channels [s], as :class:`wt.worlds.gait.GaitClock` reads it;
            None without a clock.
        clock_rests: whether the clock rests while the robot is told to stand.
        evaluation: figures of ``wt.locomotion.evaluate``.
        created: UTC, ISO 8601.
        packages: versions of what made it.
        schema: version of this layout.
    """

    name: str
    robot: str
    task: str
    rate_hz: float
    joints: list[str]
    default: list[float]
    action_scale: list[float]
    stiffness: list[float]
    velocity_gain: list[float]
    observation: list[str]
    observation_units: list[str]
    command_limits: list[float]
    sha256: str
    made_by: str
    commit: str
    run_path: str
    sources: dict[str, str]
    training: dict[str, int | float]
    config: dict[str, Any]
    clock_period: float | None = None
    clock_rests: bool = True
    evaluation: dict[str, Any] = field(default_factory=dict)
    created: str = ""
    packages: dict[str, str] = field(default_factory=dict)
    schema: int = SCHEMA

    def config_hash(self) -> str:
        """The sha256 of the resolved configuration, as JSON with its keys in order."""
        return hashlib.sha256(json.dumps(self.config, sort_keys=True).encode()).hexdigest()

    def text(self) -> str:
        """The card as JSON."""
        return json.dumps(asdict(self), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    @classmethod
    def read(cls, path: Path) -> PolicyCard:
        """Read a card.

        Raises:
            ModelError: it is missing, no JSON, or says less or more than a card says.
        """
        if not path.is_file():
            raise ModelError(
                f"{path} is missing: a policy is a folder with {GRAPH} and {CARD}, as "
                "wt-train-policy leaves it"
            )
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ModelError(f"{path} is not JSON ({error}); export the policy again") from error
        names = {f.name for f in fields(cls)}
        if not isinstance(content, dict) or content.get("schema") != SCHEMA or set(content) - names:
            raise ModelError(
                f"{path} is no card of schema {SCHEMA}; export the policy again with this version"
            )
        try:
            return cls(**content)
        except TypeError as error:
            raise ModelError(f"{path}: {error}; export the policy again") from error


def gains(robot: LeggedRobot, physics: LeggedPhysics) -> tuple[list[float], list[float]]:
    """Position and velocity gain of each joint's drive."""
    n = len(robot.joints)
    stiffness, speed = (physics.per_joint(x, n) for x in ("stiffness", "velocity_gain"))
    return list(stiffness), list(speed)


def observed(robot: LeggedRobot, has_clock: bool) -> tuple[Channel, ...]:
    """Channels of a policy's input, in order."""
    commands = zip(COMMAND, COMMAND_UNITS, strict=True)
    return (
        *robot.channels(),
        *(Channel(f"command/{name}", unit) for name, unit in commands),
        *(Channel(f"clock/{name}", "1") for name in CLOCK if has_clock),
    )


def metadata(card: PolicyCard) -> dict[str, str]:
    """What a policy's graph says of itself, in keys and form as mjlab and Isaac Lab write it.

    Lists are joined by commas. Each channel of the observation is a term of its own, without
    history. Theirs are the first nine keys; an action has no unit, it is in units of
    ``action_scale`` [rad]. ``<source>_sha256`` are the card's ``sources``.
    """
    said: dict[str, Sequence[object]] = {
        "run_path": [card.run_path],
        "joint_names": card.joints,
        "joint_stiffness": card.stiffness,
        "joint_damping": card.velocity_gain,
        "default_joint_pos": card.default,
        "action_scale": card.action_scale,
        "observation_names": card.observation,
        "observation_history_lengths": [1] * len(card.observation),
        "command_names": COMMAND,
        "observation_units": card.observation_units,
        "action_units": ["1"] * len(card.joints),
        "command_units": COMMAND_UNITS,
        "rate_hz": [card.rate_hz],
        "robot": [card.robot],
        "task": [card.task],
        "config_hash": [card.config_hash()],
        "commit": [card.commit],
        **{f"{name}_sha256": [digest] for name, digest in card.sources.items()},
    }
    return {key: ",".join(str(value) for value in values) for key, values in said.items()}


class Policy:
    """A policy that may be used with one robot; made by :meth:`load`.

    Attributes:
        card: what it says about itself.
    """

    def __init__(self, card: PolicyCard, graph: bytes, threads: int = 1) -> None:
        """Open the graph of a checked card.

        Args:
            card: what the policy says about itself.
            graph: ONNX.
            threads: of inference.
        """
        import onnxruntime

        self.card, self._graph, self._threads = card, graph, threads
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        providers = ["CPUExecutionProvider"]
        self._session = onnxruntime.InferenceSession(graph, options, providers=providers)

    def __reduce__(self) -> tuple[type[Policy], tuple[PolicyCard, bytes, int]]:
        """Pickle what the session was made of: it cannot be pickled itself."""
        return Policy, (self.card, self._graph, self._threads)

    @classmethod
    def load(
        cls,
        path: Path | str,
        robot: LeggedRobot,
        physics: LeggedPhysics | None = None,
        threads: int = 1,
    ) -> Policy:
        """Load a policy and check that it fits.

        Args:
            path: a policy's folder, the graph in it, or the name of a policy of the package.
            robot: what it is to walk.
            physics: whose gains it is to have been trained for; None for the published.
            threads: of inference.

        Raises:
            ModelError: a file is missing or not the one that the card is of; the policy is of
                another robot, joint order, rate, pose, scale, observation or gains, or its graph
                says so.
        """
        folder = folder_of(Path(path))
        card = PolicyCard.read(folder / CARD)
        graph = folder / GRAPH
        if not graph.is_file():
            raise ModelError(
                f"{graph} is missing beside its card; train or export the policy again"
            )
        content = graph.read_bytes()
        if hashlib.sha256(content).hexdigest() != card.sha256:
            raise ModelError(
                f"{graph} is not the graph that {CARD} is of (their sha256 differ); "
                "export the policy again"
            )
        _check(card, robot, physics or robot.physics, folder)
        policy = cls(card, content, threads)
        _check_metadata(policy._session.get_modelmeta().custom_metadata_map, card, folder)
        return policy

    @cached_property
    def identity(self) -> str:
        """Hash of how it acts: its network and its clock, not what its graph says of itself.

        An export anew, by another commit or under another name, acts the same.
        """
        import onnx

        proto = onnx.load_model_from_string(self._graph)
        for part in (proto.graph, *proto.graph.node):
            part.ClearField("doc_string")
            part.ClearField("metadata_props")
        network = proto.graph.SerializeToString(deterministic=True)
        versions = sorted((used.domain, used.version) for used in proto.opset_import)
        acts = network.hex(), versions, self.card.clock_period, self.card.clock_rests
        return hashlib.sha256(json.dumps(acts).encode()).hexdigest()

    def clock(self, size: int) -> GaitClock:
        """Clocks for ``size`` robots, whose reading :meth:`act` takes."""
        return GaitClock(self.card.clock_period, size, self.card.clock_rests)

    def act(
        self,
        observation: Float[np.ndarray, "robot obs"],
        command: Float[np.ndarray, "robot command=3"],
        clock: Float[np.ndarray, "robot clock"],
    ) -> Float32[np.ndarray, "robot joint"]:
        """Actions in units of the action scale.

        Args:
            observation: of :meth:`wt.worlds.legged.Herd.observe`.
            command: velocities [m/s, m/s, rad/s].
            clock: reading of :meth:`clock`: two numbers a robot, none without a rhythm.
        """
        inputs = np.concatenate([observation, command, clock], axis=1, dtype=np.float32)
        action: np.ndarray = self._session.run(["action"], {"observation": inputs})[0]
        return action


def folder_of(path: Path) -> Path:
    """Folder of a policy that is given by it, by the graph in it, or by name.

    Raises:
        ModelError: there is none.
    """
    if path.name == GRAPH:
        return path.parent
    if not path.exists() and len(path.parts) == 1 and (SHIPPED / path).is_dir():
        return SHIPPED / path
    if not path.is_dir():
        known = sorted(p.name for p in SHIPPED.iterdir() if p.is_dir()) if SHIPPED.is_dir() else []
        raise ModelError(
            f"policy {str(path)!r} does not exist; the package has: {', '.join(known) or 'none'}; "
            "wt-train-policy makes others"
        )
    return path


def _check(card: PolicyCard, robot: LeggedRobot, physics: LeggedPhysics, folder: Path) -> None:
    """Compare a card with what is to be walked, the plainest first."""
    stiffness, velocity_gain = gains(robot, physics)
    channels = observed(robot, card.clock_period is not None)
    expected: Mapping[str, object] = {
        "robot": robot.name,
        "rate_hz": RATE_HZ,
        "joints": list(robot.joints),
        "observation": [channel.name for channel in channels],
        "observation_units": [channel.unit for channel in channels],
        "default": list(robot.default),
        "action_scale": list(robot.action_scale),
        "stiffness": stiffness,
        "velocity_gain": velocity_gain,
    }
    for name, wanted in expected.items():
        given = getattr(card, name)
        if _differ(given, wanted):
            where = _first_difference(given, wanted)
            raise ModelError(
                f"policy {folder} does not fit: its {name} differs from {robot.name}'s ({where}); "
                "take a policy that was trained for this robot, or train one: wt-train-policy"
            )


def _check_metadata(said: Mapping[str, str], card: PolicyCard, folder: Path) -> None:
    """Compare what the graph says of itself with its card."""
    for key, wanted in metadata(card).items():
        if key not in said:
            raise ModelError(
                f"policy {folder} does not fit: its graph's metadata lack {key}, which its card "
                f"has ({wanted[:40]}…); export the policy again"
            )
        given, known = said[key].split(","), wanted.split(",")
        same = _close if key in _NUMBERS else operator.eq
        if len(given) != len(known) or not all(map(same, given, known)):
            where = _first_difference(given, known)
            raise ModelError(
                f"policy {folder} does not fit: its graph's metadata and its card differ in "
                f"{key} ({where}); export the policy again"
            )


def _close(given: str, wanted: str) -> bool:
    """Whether two numbers of metadata agree, to the three decimals that mjlab writes."""
    try:
        return abs(float(given) - float(wanted)) <= _ROUNDED
    except ValueError:
        return False


def _differ(given: object, wanted: object) -> bool:
    if isinstance(wanted, list) and wanted and isinstance(wanted[0], float):
        same = isinstance(given, list) and len(given) == len(wanted)
        return not (same and np.allclose(np.array(given), wanted, rtol=1e-4, atol=1e-6))
    return given != wanted


def _first_difference(given: object, wanted: object) -> str:
    if isinstance(given, list) and isinstance(wanted, list):
        if len(given) != len(wanted):
            return f"{len(given)} values instead of {len(wanted)}"
        for i, (a, b) in enumerate(zip(given, wanted, strict=True)):
            if _differ([a], [b]):
                return f"number {i} is {a!r} instead of {b!r}"
    return f"{given!r} instead of {wanted!r}"
