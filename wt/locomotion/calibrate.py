"""Commands scaled inside a policy's graph, so that what is asked for is what is reached.

The reward for following a command is nearly flat close to it, and what following costs is not: PPO
leaves a policy that turns a fifth too slowly, whatever the command. Where that is so in both
directions alike, a factor on the command makes up for it.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
from jaxtyping import Float
from onnx import numpy_helper

from wt.locomotion.evaluate import PolicyEvaluation
from wt.show.files import write_together
from wt.worlds.policy import CARD, COMMAND, GRAPH, PolicyCard

LARGEST = 1.4
"""Largest factor: beyond it the policy would be asked for commands it was never trained on."""
_ALIKE = 1.1  # largest ratio of what is reached of two opposite commands
_WORTH = 0.02  # smallest change


def factors(figures: PolicyEvaluation) -> Float[np.ndarray, "command=3"]:
    """Command over what is reached of it, by axis of the command [-].

    It is 1 where robots fell, where both directions differ, and where it would be beyond
    :data:`LARGEST` or hardly matter.
    """
    by_axis = np.ones(len(COMMAND))
    for a, axis in enumerate(COMMAND):
        tried = [t for t in figures.tracking if t.axis == axis]
        reached = np.array([t.mean / t.command for t in tried])
        if not len(tried) or any(t.fallen for t in tried) or reached.min() <= 0.0:
            continue
        factor = float(1.0 / reached.mean())
        alike = reached.max() <= _ALIKE * reached.min()
        if alike and abs(factor - 1.0) >= _WORTH and 1.0 / LARGEST <= factor <= LARGEST:
            by_axis[a] = factor
    return by_axis


def calibrate(folder: Path, by: Float[np.ndarray, "command=3"]) -> None:
    """Scale the commands of the policy in a folder; graph and card are replaced together.

    Args:
        folder: of ``policy.onnx`` and its card.
        by: factor of each command, on top of those that it has.
    """
    card = PolicyCard.read(folder / CARD)
    model = onnx.load(folder / GRAPH)
    scale = _input_scale(model.graph)
    values = numpy_helper.to_array(scale).copy()
    rows = [card.observation.index(f"command/{axis}") for axis in COMMAND]
    values[rows] *= by
    scale.CopyFrom(numpy_helper.from_array(values, scale.name))
    content = model.SerializeToString(deterministic=True)
    card = replace(
        card,
        sha256=hashlib.sha256(content).hexdigest(),
        training=card.training
        | {f"{axis}_factor": float(x) for axis, x in zip(COMMAND, values[rows], strict=True)},
    )
    write_together(folder, {GRAPH: content, CARD: card.text()})


def _input_scale(graph: onnx.GraphProto) -> onnx.TensorProto:
    """The factors that observations are multiplied with before anything else."""
    first = next(node for node in graph.node if "observation" in node.input)
    return next(x for x in graph.initializer if x.name in first.input)
