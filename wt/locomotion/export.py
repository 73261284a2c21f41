"""From rsl_rl's actor to the files of a policy: the ONNX graph and its card.

The graph has a dynamic batch and everything inside; rsl_rl's own export has neither. What it
computes is compared with the net before anything is written.
"""

from __future__ import annotations

import copy
import hashlib
import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf

from wt.errors import WorkError
from wt.export.graph import graph
from wt.locomotion.config import PolicyConfig
from wt.locomotion.evaluate import PolicyEvaluation
from wt.locomotion.train import Trained
from wt.run.track import source
from wt.show.files import write_together, write_whole
from wt.worlds.legged import RATE_HZ
from wt.worlds.policy import CARD, GRAPH, LOCAL, PolicyCard, gains, metadata, observed

PACKAGES = ("mujoco", "numpy", "onnx", "rsl-rl-lib", "torch")
_PARITY = 1e-4  # largest difference of an action that rounding explains, in units of the scale


@dataclass(frozen=True)
class Origin:
    """What made a policy.

    Attributes:
        made_by: the command line.
        task: what it is for.
        run_path: its run in MLflow, as on the card.
        sources: sha256 of what it was made from, as on the card.
    """

    made_by: str
    task: str
    run_path: str = LOCAL
    sources: Mapping[str, str] = field(default_factory=dict)


class Actor(torch.nn.Module):
    """The mean action of an actor as a function of one tensor: normaliser, then net.

    Joints that it does not move get the action 0. It never saw another last action of theirs, so
    an exploration that moves them is hidden from it.
    """

    normalizer: torch.nn.Module
    mlp: torch.nn.Module
    seen: torch.Tensor
    spread: torch.Tensor

    def __init__(self, model: Any, config: PolicyConfig) -> None:  # noqa: ANN401 – rsl_rl's MLPModel
        """Copy the parts of rsl_rl's ``MLPModel``, trained with a configuration."""
        super().__init__()
        self.normalizer = copy.deepcopy(model.obs_normalizer)
        self.mlp = copy.deepcopy(model.mlp)
        joints, moved = config.body().joints, config.moved()
        channels = observed(config.body(), config.gait is not None)
        unmoved = {f"last_action/{joint}" for joint in joints if joint not in moved}
        seen = [float(channel.name not in unmoved) for channel in channels]
        self.register_buffer("seen", torch.tensor(seen))
        rows = [[float(joint == name) for joint in joints] for name in moved]
        self.register_buffer("spread", torch.tensor(rows))
        self.eval()

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions for observations with commands, (batch, n_in) → (batch, n)."""
        actions: torch.Tensor = self.mlp(self.normalizer(observation * self.seen)) @ self.spread
        return actions


def write(
    trained: Trained,
    config: PolicyConfig,
    folder: Path,
    origin: Origin,
) -> PolicyCard:
    """Write ``policy.onnx`` and ``card.json`` into a folder, both or neither.

    The card has no evaluation yet: :func:`judged` adds it.

    Args:
        trained: result of the training.
        config: its configuration.
        folder: of the policy; it is made.
        origin: what made it.

    Raises:
        WorkError: the graph computes something else than the net.
    """
    robot = config.body()
    channels = observed(robot, config.gait is not None)
    actor = Actor(trained.actor, config)
    stiffness, velocity_gain = gains(robot, config.physics or robot.physics)
    card = PolicyCard(
        name=config.name,
        robot=robot.name,
        task=origin.task,
        rate_hz=RATE_HZ,
        joints=list(robot.joints),
        default=list(robot.default),
        action_scale=list(robot.action_scale),
        stiffness=stiffness,
        velocity_gain=velocity_gain,
        observation=[channel.name for channel in channels],
        observation_units=[channel.unit for channel in channels],
        command_limits=list(config.commands.largest),
        sha256="",
        made_by=origin.made_by,
        commit=source().commit,
        run_path=origin.run_path,
        sources=dict(origin.sources),
        training={
            "iterations": trained.iterations,
            "seconds": round(trained.seconds, 1),
            "samples": trained.samples,
        },
        config=OmegaConf.to_container(OmegaConf.structured(config)),  # type: ignore[arg-type]
        clock_period=config.gait.period if config.gait else None,
        clock_rests=config.gait is None or config.gait.rests,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        packages={"python": platform.python_version()}
        | {package: importlib.metadata.version(package) for package in PACKAGES},
    )
    example = (torch.zeros(2, len(channels)),)
    content = graph(actor, example, ("observation",), "action", metadata=metadata(card))
    _compare(actor, content, len(channels))
    card = replace(card, sha256=hashlib.sha256(content).hexdigest())
    folder.mkdir(parents=True, exist_ok=True)
    write_together(folder, {GRAPH: content, CARD: card.text()})
    return card


def judged(folder: Path, figures: PolicyEvaluation) -> None:
    """Write what was measured of a policy into the card in its folder."""
    card = PolicyCard.read(folder / CARD)
    write_whole(folder / CARD, replace(card, evaluation=figures.plain()).text())


def _compare(actor: Actor, content: bytes, n_in: int) -> None:
    import onnxruntime

    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    rows = np.random.default_rng(0).normal(size=(7, n_in)).astype(np.float32)
    with torch.no_grad():
        wanted = actor(torch.from_numpy(rows)).numpy()
    difference = float(np.abs(session.run(None, {"observation": rows})[0] - wanted).max())
    if not difference <= _PARITY * max(1.0, float(np.abs(wanted).max())):
        raise WorkError(
            f"export: the ONNX graph differs from the net by {difference:.2g}, {_PARITY} may be; "
            "nothing was written: try another version of torch or onnxruntime"
        )
