"""One ONNX graph of a trained model: (o, a, o′ of S) → o′ of R, in physical units.

The normaliser is part of the model, so whoever runs the graph needs neither torch nor our
statistics. The file holds everything: weights inside, a dynamic ``batch`` axis, and nothing of
the machine that wrote it, so that the same weights give the same bytes everywhere.
"""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from wt.errors import ModelError
from wt.types import Array, TransitionSpec

if TYPE_CHECKING:
    from google.protobuf.message import Message
    from onnx import ModelProto

INPUTS = ("o", "a", "o_next_sim")
OUTPUT = "o_next_real"
OPSET = 18


def export(
    model: torch.nn.Module,
    spec: TransitionSpec,
    path: Path | str,
    *,
    example: tuple[Array, Array, Array],
) -> None:
    """Write ``model`` in evaluation mode as a single ONNX file; the model itself is untouched.

    Args:
        model: maps float32 tensors o (batch, n_obs), a (batch, n_action) and o′ of S
            (batch, n_obs) to o′ of R (batch, n_obs), all in physical units.
        spec: layout of the task's transitions.
        path: the file to write.
        example: o, a and o′ of S, each at least one row, physical units.

    Raises:
        ModelError: the example or the model's output has another shape than ``spec`` says, or
            the model uses something that ONNX cannot express.
    """
    expected = (spec.n_obs, spec.n_action, spec.n_obs)
    for name, array, width in zip(INPUTS, example, expected, strict=True):
        if array.ndim != 2 or array.shape[1] != width or not len(array):
            raise ModelError(
                f"export: example {name!r} has shape {array.shape}, task {spec.task!r} needs "
                f"(batch, {width}) with at least one row"
            )
    device = next((p.device for p in model.parameters()), torch.device("cpu"))
    # Two rows: torch.export takes an axis of length 1 for a constant.
    inputs = tuple(
        torch.from_numpy(np.resize(x, (2, x.shape[1])).astype(np.float32)).to(device)
        for x in example
    )
    with _evaluating(model), torch.no_grad(), _quiet():
        shape = tuple(model(*inputs).shape)
        if shape != (2, spec.n_obs):
            raise ModelError(
                f"export: the model answers two rows with shape {shape}, "
                f"task {spec.task!r} needs (2, {spec.n_obs})"
            )
        proto = _graph(model, inputs)
    path = Path(path)
    temporary = path.with_name(path.name + ".tmp")
    try:
        temporary.write_bytes(proto.SerializeToString(deterministic=True))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def eager(model: torch.nn.Module) -> Callable[[Array, Array, Array], Array]:
    """The model in evaluation mode as a function of arrays: what ONNX is compared with.

    Args:
        model: as in :func:`export`.

    Returns:
        A function of o (N, n_obs), a (N, n_action), o′ of S (N, n_obs), all float32, that
        returns o′ of R (N, n_obs), float32.
    """
    device = next((p.device for p in model.parameters()), torch.device("cpu"))

    def call(o: Array, a: Array, o_next_sim: Array) -> Array:
        with _evaluating(model), torch.no_grad():
            tensors = (torch.tensor(x, dtype=torch.float32) for x in (o, a, o_next_sim))
            return model(*(x.to(device) for x in tensors)).cpu().numpy()

    return call


def _graph(model: torch.nn.Module, inputs: tuple[torch.Tensor, ...]) -> ModelProto:
    batch = torch.export.Dim("batch")
    try:
        program = torch.onnx.export(
            model,
            inputs,
            input_names=INPUTS,
            output_names=(OUTPUT,),
            opset_version=OPSET,
            dynamic_shapes=({0: batch},) * len(inputs),
            dynamo=True,
            verbose=False,
        )
    except torch.onnx.errors.OnnxExporterError as error:
        raise ModelError(
            f"export: {type(model).__name__} cannot be written as an ONNX graph "
            f"({str(error).strip().splitlines()[0]}); WT_DEBUG=1 shows where"
        ) from error
    assert program is not None  # None only from the exporter that dynamo replaces
    proto = program.model_proto
    _strip(proto)
    closed = [i.name for i in proto.graph.input if not i.type.tensor_type.shape.dim[0].dim_param]
    if closed:
        raise ModelError(
            f"export: {type(model).__name__} fixes the batch size of '{closed[0]}': its code turns "
            "a length into a number; use tensor.shape[0] there"
        )
    return proto


def _strip(proto: ModelProto) -> None:
    """Remove the exporter's notes: source lines and file names of this machine."""

    def clear(messages: Iterable[Message]) -> None:
        for message in messages:
            message.ClearField("metadata_props")
            message.ClearField("doc_string")

    graphs = [proto.graph, *proto.functions]
    clear([proto, *graphs])
    for graph in graphs:
        clear(graph.node)
        clear(graph.value_info)
    clear([*proto.graph.input, *proto.graph.output, *proto.graph.initializer])


@contextmanager
def _evaluating(model: torch.nn.Module) -> Iterator[None]:
    """Evaluation mode inside; afterwards every submodule is in the mode it was in before."""
    training = [(module, module.training) for module in model.modules()]
    model.eval()
    try:
        yield
    finally:
        for module, mode in training:
            module.training = mode


@contextmanager
def _quiet() -> Iterator[None]:
    """Hide what the exporter says about torchvision, its own internals and shared axis names."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*LeafSpec.*", category=FutureWarning)
            warnings.filterwarnings("ignore", message=".*axis name: batch.*", category=UserWarning)
            yield
    finally:
        logger.setLevel(level)
