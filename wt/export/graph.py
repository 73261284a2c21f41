"""From a torch module to an ONNX graph that stands alone: what all our exports share.

The graph has a dynamic ``batch`` axis, what its maker says of it (``metadata_props``) and nothing
of the machine that wrote it, so that the same weights and words give the same bytes everywhere. It
is of operator set :data:`OPSET` and has passed onnx's own checker, shapes included.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float32

from wt.errors import ModelError

if TYPE_CHECKING:
    from google.protobuf.message import Message
    from onnx import ModelProto

OPSET = 18


def graph(
    model: torch.nn.Module,
    inputs: tuple[torch.Tensor, ...],
    names: Sequence[str],
    *outputs: str,
    metadata: Mapping[str, str],
    defaults: Mapping[str, Float32[np.ndarray, " channel"]] | None = None,
) -> bytes:
    """A model in evaluation mode as the content of an ONNX file.

    Args:
        model: whose outputs' first axis is the batch.
        inputs: of two rows each, since torch.export takes an axis of length 1 for a constant.
        names: of the inputs.
        outputs: names of the outputs.
        metadata: what whoever has nothing but the graph can read in it.
        defaults: by name, inputs that may be left out, and the row that then stands for all.

    Raises:
        ModelError: the model uses something that ONNX cannot express, or fixes the batch size.
    """
    import onnx

    proto = _exported(model, inputs, names, outputs)
    _strip(proto)
    closed = [i.name for i in proto.graph.input if not i.type.tensor_type.shape.dim[0].dim_param]
    if closed:
        raise ModelError(
            f"export: {type(model).__name__} fixes the batch size of '{closed[0]}': its code turns "
            "a length into a number; use tensor.shape[0] there"
        )
    for name, row in (defaults or {}).items():
        _let_be_left_out(proto, name, row, beside=names[0])
    onnx.helper.set_model_props(proto, dict(metadata))
    try:
        onnx.checker.check_model(proto, full_check=True)
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
        raise ModelError(
            f"export: the graph of {type(model).__name__} is not valid ONNX "
            f"({str(error).strip().splitlines()[0]}); try another version of torch or onnx"
        ) from error
    content: bytes = proto.SerializeToString(deterministic=True)
    return content


def _exported(
    model: torch.nn.Module,
    inputs: tuple[torch.Tensor, ...],
    names: Sequence[str],
    outputs: Sequence[str],
) -> ModelProto:
    """What torch's exporter makes of it."""
    batch = torch.export.Dim("batch")
    try:
        with torch.no_grad(), _quiet():
            program = torch.onnx.export(
                model,
                inputs,
                input_names=names,
                output_names=outputs,
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
    return program.model_proto


def listed(values: Sequence[object]) -> str:
    """A list as one metadata value: joined by commas, as robots' own exporters write them."""
    return ",".join(str(value) for value in values)


def _let_be_left_out(
    proto: ModelProto, name: str, row: Float32[np.ndarray, " channel"], beside: str
) -> None:
    """Give an input a default: in ONNX an initializer of the same name.

    It has one row, so that where it is read it is spread over the batch of another input.
    """
    from onnx import helper, numpy_helper

    graph, whole = proto.graph, f"{name}_of_batch"
    for node in graph.node:
        node.input[:] = [whole if given == name else given for given in node.input]
    spread = [
        helper.make_node("Shape", [beside], [f"{name}_rows"], start=0, end=1),
        helper.make_node("Concat", [f"{name}_rows", f"{name}_width"], [f"{name}_shape"], axis=0),
        helper.make_node("Expand", [name, f"{name}_shape"], [whole]),
    ]
    nodes = [*spread, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    width = np.array([len(row)], np.int64)
    graph.initializer.append(numpy_helper.from_array(width, f"{name}_width"))
    graph.initializer.append(numpy_helper.from_array(row[None], name))


def _strip(proto: ModelProto) -> None:
    """Remove the exporter's notes: source lines and file names of this machine."""

    def clear(messages: Iterable[Message]) -> None:
        for message in messages:
            message.ClearField("metadata_props")
            message.ClearField("doc_string")

    graphs = [proto.graph, *proto.functions]
    clear([proto, *graphs])
    for part in graphs:
        clear(part.node)
        clear(part.value_info)
    clear([*proto.graph.input, *proto.graph.output, *proto.graph.initializer])


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
