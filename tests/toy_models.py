"""Exported models whose answer is known in closed form, with their cards, ready to push."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper

from registry.card import HeldOut, describe
from wt.config import Mean, Method, Nets, TranslationConfig
from wt.export.onnx import eager, export
from wt.nets.world_model import WorldModel
from wt.translate import Exported
from wt.types import TransitionSpec

HELD_OUT = HeldOut("test pairs", "data", "mse", 0.5)


def save(
    folder: Path,
    spec: TransitionSpec,
    nodes: Sequence[onnx.NodeProto],
    constants: Mapping[str, np.ndarray],
    golden: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    *,
    name: str = "wt-toy",
    metrics: Mapping[str, float] | None = None,
    heldout: HeldOut = HELD_OUT,
    parity: float | None = 0.0,
) -> Path:
    """Write ``model.onnx`` and ``card.json``.

    Args:
        folder: a new one.
        spec: layout of the task's transitions.
        nodes: from ``o``, ``a``, ``o_next_sim`` and the constants to ``o_next_real``.
        constants: what else the nodes read.
        golden: o, a, o′ of S and the nodes' answer, a few rows each.
        name: registered name.
        metrics: further metrics of the card.
        heldout: the metric that decides about ``champion``.
        parity: what the card says of it.

    Returns:
        The folder.
    """

    def port(port_name: str, width: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(port_name, TensorProto.FLOAT, ["batch", width])

    graph = helper.make_graph(
        nodes,
        "toy",
        [port("o", spec.n_obs), port("a", spec.n_action), port("o_next_sim", spec.n_obs)],
        [port("o_next_real", spec.n_obs)],
        [numpy_helper.from_array(x, constant) for constant, x in constants.items()],
    )
    opset = [helper.make_opsetid("", 18)]
    folder.mkdir()
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=10), folder / "model.onnx")
    card = describe(
        folder / "model.onnx", spec, name=name, data_hash="data-1", config_hash="config-1",
        commit="0" * 40, metrics=metrics or {}, heldout=heldout, parity=parity, golden=golden,
    )  # fmt: skip
    card.save(folder)
    return folder


def shifted(folder: Path, spec: TransitionSpec, shift: float, name: str = "wt-toy") -> Path:
    """Write a model by which R is S, moved by a constant; see :func:`save`."""
    rng, by = np.random.default_rng(0), np.array(shift, np.float32)
    widths = (spec.n_obs, spec.n_action, spec.n_obs)
    o, a, s = (rng.normal(size=(2, width)).astype(np.float32) for width in widths)
    node = helper.make_node("Add", ["o_next_sim", "shift"], ["o_next_real"])
    return save(folder, spec, [node], {"shift": by}, (o, a, s, s + by), name=name)


def carrying(spec: TransitionSpec) -> WorldModel:
    """An untrained model that moves states, and what is hidden, by some hundredths."""
    torch.manual_seed(0)
    method = Method(
        mean=Mean(kind="average", simulator="encoded", width=16, depth=1),
        nets=Nets(latent=2, width=8, depth=1),
        translation=TranslationConfig(anchored=True, reach=1e6),
    )
    model = WorldModel(spec, method).eval()
    assert model.frame.hidden is not None
    with torch.no_grad():
        model.strength.zero_()  # nothing beyond the mean field
        model.frame.change.std.fill_(0.05)
        model.frame.hidden.unit.fill_(0.05)
        model.frame.hidden.gain.copy_(torch.linspace(0, 1, len(spec.hidden)))
    return model


def exported(folder: Path, model: WorldModel, name: str = "wt-toy") -> Path:
    """Write a model that carries what is hidden on, with its card; returns the folder."""
    spec, rng, shift = model.spec, np.random.default_rng(0), model.frame.hidden
    assert shift is not None
    widths = (spec.n_obs, spec.n_action, spec.n_obs, len(spec.hidden))
    *inputs, hidden = (rng.normal(size=(3, width)).astype(np.float32) for width in widths)
    folder.mkdir()
    whole, usual = Exported(model), shift.center.numpy()
    export(whole, spec, folder / "model.onnx", example=tuple(inputs), hidden=usual)
    card = describe(
        folder / "model.onnx", spec, name=name, data_hash="data-1", config_hash="config-1",
        commit="0" * 40, metrics={}, heldout=HELD_OUT, parity=0.0,
        golden=(*inputs, eager(whole)(*inputs)),
        carried=(hidden, eager(whole, which=-1)(*inputs, hidden)),
    )  # fmt: skip
    card.save(folder)
    return folder
