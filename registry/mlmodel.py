"""A model's folder as MLflow knows models: what ``mlflow.pyfunc`` and ``mlflow.onnx`` load.

Beside the graph and its card come ``MLmodel`` with signature and example, the versions that are
needed (``requirements.txt``), the columns of a frame, and a copy of :mod:`registry.served`, which
runs the graph. Nothing is pickled.
"""

from __future__ import annotations

import importlib.metadata
import json
import platform
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from registry import served
from registry.card import sha256

REQUIREMENTS = ("mlflow", "numpy", "onnx", "onnxruntime", "pandas")
_MODULE = "wt_served"  # of the copy: no name that somebody has
_EXAMPLE = "input_example.json"
_ENVIRONMENTS = {"python_env": "python_env.yaml", "conda_env": "conda.yaml"}


@dataclass(frozen=True)
class Frames:
    """The columns of frames that a graph maps to each other.

    Attributes:
        inputs: channels of each input of the graph, in order.
        outputs: channels of each output.
        example: rows of each input, (row, channel), physical units.
    """

    inputs: Mapping[str, Sequence[str]]
    outputs: Mapping[str, Sequence[str]]
    example: Mapping[str, Float[np.ndarray, "row _"]]


@dataclass(frozen=True)
class Files:
    """A graph, its card, and all that makes them a model to MLflow.

    Attributes:
        graph: the ONNX file.
        card: the JSON file that goes along.
        frames: columns of the graph's inputs and outputs.
        run_id: run that made the model.
    """

    graph: Path
    card: Path
    frames: Frames
    run_id: str

    def write(self, folder: Path, model_id: str) -> None:
        """Fill a new, empty folder.

        Args:
            folder: gets copies of graph and card, and the rest.
            model_id: id of MLflow's logged model.
        """
        for file in (self.graph, self.card):
            shutil.copy(file, folder / file.name)
        (folder / "code").mkdir()
        shutil.copy(str(served.__file__), folder / "code" / f"{_MODULE}.py")
        inputs, outputs = (_columns(ports) for ports in (self.frames.inputs, self.frames.outputs))
        of_graph = {"graph": self.graph.name, "sha256": sha256(self.graph)}
        _json(folder / served.COLUMNS, {**of_graph, "inputs": inputs, "outputs": outputs})
        rows = np.hstack([self.frames.example[port] for port in inputs]).astype(float)
        _json(folder / _EXAMPLE, {"columns": _flat(inputs), "data": rows.tolist()})
        packages = [f"{name}=={importlib.metadata.version(name)}" for name in REQUIREMENTS]
        (folder / "requirements.txt").write_text("\n".join(packages) + "\n")
        # what `mlflow models predict` and `serve` make an environment of; JSON is YAML
        python = platform.python_version()
        _json(
            folder / _ENVIRONMENTS["python_env"],
            {"python": python, "dependencies": ["-r requirements.txt"]},
        )
        _json(
            folder / _ENVIRONMENTS["conda_env"],
            {
                "channels": ["conda-forge"],
                "dependencies": [f"python={python}", "pip", {"pip": packages}],
            },
        )
        self._describe(folder, model_id, _flat(inputs), _flat(outputs))

    def _describe(
        self, folder: Path, model_id: str, inputs: Sequence[str], outputs: Sequence[str]
    ) -> None:
        """Write ``MLmodel``: signature, example, and how either flavour is loaded."""
        import mlflow.pyfunc
        from mlflow.models import Model, ModelSignature
        from mlflow.types import ColSpec, DataType, Schema

        # double takes a frame of either precision; the graph itself works in single
        signature = ModelSignature(
            Schema([ColSpec(DataType.double, name) for name in inputs]),
            Schema([ColSpec(DataType.float, name) for name in outputs]),
        )
        model = Model(
            run_id=self.run_id,
            model_id=model_id,
            signature=signature,
            saved_input_example_info={
                "artifact_path": _EXAMPLE,
                "type": "dataframe",
                "pandas_orient": "split",
            },
        )
        mlflow.pyfunc.add_to_model(model, loader_module=_MODULE, code="code", **_ENVIRONMENTS)
        model.add_flavor(
            "onnx",
            onnx_version=importlib.metadata.version("onnx"),
            data=self.graph.name,
            providers=["CPUExecutionProvider"],
            onnx_session_options=None,
            code=None,
        )
        model.save(folder / "MLmodel")


def _columns(ports: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    return {port: [f"{port}/{channel}" for channel in names] for port, names in ports.items()}


def _flat(columns: Mapping[str, Sequence[str]]) -> list[str]:
    return [name for names in columns.values() for name in names]


def _json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
