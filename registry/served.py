"""How MLflow runs a registered model: a copy of this file travels with each of them.

It needs numpy, pandas and onnxruntime, and nothing of ours: whoever has the model can load it with
``mlflow.pyfunc``. A frame holds one row a sample and one column a channel, called
``<input>/<channel>``, e.g. ``o/qpos/joint1``; so does the answer.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pandas as pd

COLUMNS = "columns.json"


class OnnxFrames:
    """An ONNX graph as a function of frames."""

    def __init__(self, folder: Path) -> None:
        """Load the graph of a model's folder.

        Args:
            folder: with ``columns.json``, which names the graph, its sha256, and the columns of
                each input and output.

        Raises:
            ValueError: the graph is not the one that was registered.
        """
        said = json.loads((folder / COLUMNS).read_text(encoding="utf-8"))
        content = (folder / said["graph"]).read_bytes()
        if hashlib.sha256(content).hexdigest() != said["sha256"]:
            raise ValueError(
                f"{folder / said['graph']} is not the graph that was registered (its sha256 "
                "differs); restore it, or register the model again"
            )
        self._inputs: dict[str, list[str]] = said["inputs"]
        self._outputs: dict[str, list[str]] = said["outputs"]
        quiet = onnxruntime.SessionOptions()
        quiet.log_severity_level = 3  # an input that may be left out is not worth a warning
        self._session = onnxruntime.InferenceSession(
            content, quiet, providers=["CPUExecutionProvider"]
        )

    def predict(self, frame: pd.DataFrame, params: dict[str, Any] | None = None) -> pd.DataFrame:
        """Answers, a row for each of the frame's, physical units; ``params`` has no meaning."""
        inputs = {
            name: np.ascontiguousarray(frame[columns], np.float32)
            for name, columns in self._inputs.items()
        }
        answers = self._session.run(list(self._outputs), inputs)
        columns = [column for names in self._outputs.values() for column in names]
        return pd.DataFrame(np.hstack(answers), columns=columns, index=frame.index)


def _load_pyfunc(path: str) -> OnnxFrames:
    """The entry point that MLflow looks for."""
    return OnnxFrames(Path(path))
