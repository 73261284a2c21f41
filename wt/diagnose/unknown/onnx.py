"""A learned force as a small ONNX graph that needs nothing of ours."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import onnx
from jaxtyping import Real
from onnx import TensorProto, helper, numpy_helper

from wt.diagnose.unknown.law import Atom, Law

_OPSET, _IR = 18, 9


def to_onnx(laws: Mapping[str, Law]) -> bytes:
    """The graph: one float32 input (batch, 1) per column, by name; one output a law [N·m].

    It computes in double precision, as the laws themselves do.

    Args:
        laws: by the name of the output; ``force`` is the first.
    """
    graph = _Graph()
    for output, law in laws.items():
        _add(graph, law, output)
    columns = dict.fromkeys(name for law in laws.values() for name in law.columns)
    one: list[str | int | None] = ["batch", 1]
    made = helper.make_graph(
        graph.nodes,
        "residual",
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, one) for n in columns],
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, one) for n in laws],
        graph.constants,
    )
    opset = [helper.make_opsetid("", _OPSET)]
    model = helper.make_model(made, opset_imports=opset, ir_version=_IR)
    said = "; ".join(f"{output} = {law.text()}" for output, law in laws.items())
    model.doc_string = f"Forces [N·m] that the model lacks: {said}"
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _add(graph: _Graph, law: Law, output: str) -> None:
    """Add a law, which is an output of the graph."""
    raw = [graph.add("Cast", name, to=TensorProto.DOUBLE) for name in law.columns]
    x = graph.add("Concat", *raw, axis=1)
    inside = graph.add("Min", graph.add("Max", x, graph.value(law.low)), graph.value(law.high))
    beyond = graph.add("Abs", graph.add("Sub", x, inside))
    fade = graph.add("Sub", graph.value(1.0), graph.add("Div", beyond, graph.value(law.margin)))
    fade = graph.add("Max", fade, graph.value(0.0))
    groups = [
        graph.atoms(inside, kind, law.atoms) for kind in dict.fromkeys(a.kind for a in law.atoms)
    ]
    one = graph.add("Mul", graph.column(x, 0), graph.value(0.0))
    table = graph.add("Concat", *groups, graph.add("Add", one, graph.value(1.0)), axis=1)
    first, second = (
        graph.add("Gather", table, graph.value(law.factors[:, i]), axis=1) for i in (0, 1)
    )
    weights = graph.value(law.weights.reshape(-1, 1))
    force = graph.add("MatMul", graph.add("Mul", first, second), weights)
    for i in range(len(law.columns)):
        force = graph.add("Mul", force, graph.column(fade, i))
    graph.add("Cast", force, to=TensorProto.FLOAT, output=output)


class _Graph:
    """Nodes and constants of a graph that is being built; values are referred to by name."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def add(self, operator: str, *inputs: str, output: str = "", **attributes: int) -> str:
        """Append a node; returns the name of its output."""
        name = output or f"value_{len(self.nodes)}"
        node = helper.make_node(operator, list(inputs), [name])
        node.attribute.extend(helper.make_attribute(k, v) for k, v in attributes.items())
        self.nodes.append(node)
        return name

    def value(self, constant: Real[np.ndarray, "*shape"] | float) -> str:
        """A constant, double or int64."""
        array = np.asarray(constant)
        array = array if array.dtype == np.int64 else array.astype(np.float64)
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def column(self, x: str, index: int) -> str:
        """One column of a table, (batch, 1)."""
        return self.add("Gather", x, self.value(np.array([index])), axis=1)

    def atoms(self, x: str, kind: str, atoms: tuple[Atom, ...]) -> str:
        """Values of all atoms of a kind, (batch, count)."""
        alike = [a for a in atoms if a.kind == kind]
        columns = self.value(np.array([a.column for a in alike], dtype=np.int64))
        x = self.add("Gather", x, columns, axis=1)
        if kind == "linear":
            return x
        if kind == "square":
            return self.add("Mul", self.add("Abs", x), x)
        if kind == "size":
            return self.add("Abs", x)
        b = self.value(np.array([s.b for s in alike]))
        if kind == "side":
            return self.add("Max", self.add("Mul", x, b), self.value(0.0))
        if kind == "sign":
            return self.add("Tanh", self.add("Div", x, b))
        if kind in ("sin", "cos"):
            return self.add(kind.capitalize(), self.add("Mul", x, b))
        a = self.value(np.array([s.a for s in alike]))
        s = self.add("Div", self.add("Sub", x, a), b)
        bell = self.add("Exp", self.add("Neg", self.add("Mul", s, s)))
        return bell if kind == "bump" else self.add("Mul", s, bell)
