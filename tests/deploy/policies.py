"""Policies that a test writes by hand."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from wt.worlds.policy import CARD, GRAPH, SHIPPED, PolicyCard, metadata


def write_policy(folder: Path, **changes: object) -> None:
    """A policy of the Go2 whose every action is √(−command/forward): 0, or no number.

    Args:
        folder: it is made.
        changes: of the card, which is that of the shipped policy otherwise.
    """
    card = json.loads((SHIPPED / "go2" / CARD).read_text())
    width, joints = len(card["observation"]), len(card["joints"])
    pick = np.zeros((width, joints), np.float32)
    pick[card["observation"].index("command/forward")] = -1.0
    ports = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])
        for name, size in (("observation", width), ("action", joints))
    ]
    nodes = [
        helper.make_node("MatMul", ["observation", "pick"], ["negative"]),
        helper.make_node("Sqrt", ["negative"], ["action"]),
    ]
    tensor = numpy_helper.from_array(pick, "pick")
    graph = helper.make_graph(nodes, "policy", ports[:1], ports[1:], [tensor])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=8)
    helper.set_model_props(model, metadata(PolicyCard(**card)))
    content = model.SerializeToString()
    onnx.checker.check_model(model)
    folder.mkdir(parents=True)
    (folder / GRAPH).write_bytes(content)
    changes = {"name": "rooted", "sha256": hashlib.sha256(content).hexdigest(), **changes}
    (folder / CARD).write_text(json.dumps({**card, **changes}))
