"""A training that begins with a policy: its weights come from the ONNX graph that everybody has.

The graph holds the actor and its normaliser. What values its states have is not in it, so the
critic learns that first, while the actor stays as it is.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import torch
from jaxtyping import Float
from onnx import numpy_helper
from rsl_rl.runners import OnPolicyRunner

from wt.errors import ModelError
from wt.worlds.legged import LeggedRobot
from wt.worlds.policy import CARD, GRAPH, Policy, PolicyCard, folder_of

_PARITY = 1e-4  # largest difference of an action, in units of the scale


_Inputs = Float[np.ndarray, "*_ input"]
_Layer = tuple[Float[np.ndarray, "_ _"], Float[np.ndarray, " _"]]


def of_other_drives(path: Path, robot: LeggedRobot) -> Policy:
    """A policy to begin with, whatever gains it was trained for.

    Args:
        path: its folder, or the name of a policy of the package.
        robot: what it is to walk.

    Raises:
        ModelError: as :meth:`wt.worlds.policy.Policy.load`, but for the gains.
    """
    card = PolicyCard.read(folder_of(path) / CARD)
    drives = replace(
        robot.physics, stiffness=tuple(card.stiffness), velocity_gain=tuple(card.velocity_gain)
    )
    return Policy.load(path, robot, drives)


def take_over(runner: OnPolicyRunner, policy: Policy, path: str, warm_up: int) -> None:
    """Let a new runner's actor compute what a policy does, then let the critic learn its values.

    Args:
        runner: with new nets of the policy's sizes.
        policy: whose weights are taken.
        path: its folder or name.
        warm_up: iterations in which the critic alone learns.

    Raises:
        ModelError: the graph is no normaliser and MLP of these sizes.
    """
    actor = runner.alg.get_policy()
    scale, mean, spread, layers = _weights(folder_of(Path(path)) / GRAPH)
    # what the graph scales in front of its normaliser, as calibrated commands, the normaliser does
    scale = np.where(scale > 0.0, scale, 1.0)
    mean, spread = mean / scale, spread / scale
    linear = [module for module in actor.mlp.modules() if isinstance(module, torch.nn.Linear)]
    wanted = [tuple(layer.weight.shape) for layer in linear]
    if wanted != [weight.shape for weight, _ in layers]:
        raise ModelError(
            f"policy {path}: its layers are {[w.shape for w, _ in layers]}, those of its card's "
            f"configuration {wanted}; take a policy that wt-train-policy has exported"
        )
    normalizer = actor.obs_normalizer
    with torch.no_grad():
        for module, (weight, bias) in zip(linear, layers, strict=True):
            module.weight.copy_(torch.from_numpy(weight.copy()))
            module.bias.copy_(torch.from_numpy(bias.copy()))
        std = torch.from_numpy(spread.copy()) - normalizer.eps
        normalizer._mean.copy_(torch.from_numpy(mean.copy()))
        normalizer._std.copy_(std)
        normalizer._var.copy_(std**2)
        # as many samples as it has seen, so that a few new ones do not shift it
        normalizer.count.fill_(int(policy.card.training.get("samples", 1e6)))
    _compare(runner, policy, path)
    _warm_up(runner, warm_up)


def _weights(
    path: Path,
) -> tuple[_Inputs, _Inputs, _Inputs, list[_Layer]]:
    """Factors of the inputs, the normaliser's mean and divisor, each layer's weight and bias."""
    graph = onnx.load(path).graph
    arrays = {x.name: numpy_helper.to_array(x) for x in graph.initializer}
    constants: dict[str, list[list[np.ndarray]]] = {"Mul": [], "Sub": [], "Div": [], "Gemm": []}
    for node in graph.node:
        if node.op_type in constants:
            constants[node.op_type].append([arrays[name] for name in node.input if name in arrays])
    first = [constants[kind] for kind in ("Mul", "Sub", "Div")]
    one_each = all(len(nodes) == 1 == len(nodes[0]) for nodes in first)
    if not one_each or any(len(layer) != 2 for layer in constants["Gemm"]):
        raise ModelError(f"{path} is no normaliser and MLP as wt-train-policy exports them")
    scale, mean, spread = (nodes[0][0] for nodes in first)
    return scale, mean, spread, [(w, b) for w, b in constants["Gemm"]]


def _compare(runner: OnPolicyRunner, policy: Policy, path: str) -> None:
    observations = runner.env.get_observations().to(runner.device)
    with torch.inference_mode():
        got = runner.alg.get_policy()(observations).cpu().numpy()
    rows = observations["policy"].cpu().numpy()
    n = len(policy.card.observation) - 3 - (2 if policy.card.clock_period else 0)
    wanted = policy.act(rows[:, :n], rows[:, n : n + 3], rows[:, n + 3 :])
    moved = wanted[:, np.abs(wanted).max(axis=0) > 0] if got.shape != wanted.shape else wanted
    difference = np.abs(got - moved).max() if got.shape == moved.shape else np.inf
    if not difference <= _PARITY * max(1.0, float(np.abs(wanted).max())):
        raise ModelError(
            f"policy {path}: the nets that take its weights over act otherwise (by "
            f"{difference:.2g}); take a policy that wt-train-policy has exported"
        )


def _warm_up(runner: OnPolicyRunner, iterations: int) -> None:
    actor = runner.alg.get_policy()
    for parameter in actor.parameters():
        parameter.requires_grad_(False)
    for iteration in range(iterations):
        runner.current_learning_iteration = iteration
        runner.learn(1)
    for parameter in actor.parameters():
        parameter.requires_grad_(True)
