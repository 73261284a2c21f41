"""Parity of an ONNX graph with the model that it came from, and integrity of a model's folder.

Differences are |ONNX - eager| / max(1, |eager|): absolute for small values, relative for large
ones, since outputs are physical (rad, rad/s, …) and float32 carries seven digits of either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime
from jaxtyping import Float, Shaped

from registry.card import CARD_FILE, MODEL_FILE, Card, sha256
from wt.errors import ModelError, RegistryError

TOLERANCE = 1e-5
BATCHES = (1, 7, 256)

Model = Callable[..., np.ndarray]
"""Arrays of a question's inputs, one row a sample → its output, float32."""


class Question(NamedTuple):
    """One thing that a graph is asked.

    Attributes:
        inputs: their names.
        output: its name.
    """

    inputs: tuple[str, ...]
    output: str


TRANSLATION = Question(("o", "a", "o_next_sim"), "o_next_real")
"""o (N, n_obs), a (N, n_action), o′ of S (N, n_obs) → o′ of R (N, n_obs)."""
SHIFT = Question((*TRANSLATION.inputs, "hidden"), "hidden_shift")
"""The same and what is hidden in S before the step (N, n_hidden) → what is added to it after."""


def session(path: Path, threads: int = 0) -> onnxruntime.InferenceSession:
    """An onnxruntime session on the CPU.

    Args:
        path: the graph.
        threads: of inference; 0 for one per core.

    Raises:
        ModelError: the file is missing, truncated or no ONNX graph.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3  # an input that may be left out is not worth a warning
    try:
        # From bytes, so that a graph cannot pull in other files as external data.
        return onnxruntime.InferenceSession(
            path.read_bytes(), options, providers=["CPUExecutionProvider"]
        )
    except FileNotFoundError:
        raise ModelError(f"{path} does not exist; export or pull the model first") from None
    except Exception as error:  # onnxruntime's errors share no base but Exception
        raise ModelError(
            f"{path} is no whole ONNX model ({str(error).splitlines()[0]}); export or pull it again"
        ) from error


def load(path: Path, question: Question = TRANSLATION) -> Model:
    """The ONNX graph as a function of arrays, run by onnxruntime on the CPU.

    Args:
        path: the graph.
        question: what it is asked.

    Raises:
        ModelError: as :func:`session`.
    """
    graph = session(path)

    def call(*arrays: Float[np.ndarray, "row _"]) -> Float[np.ndarray, " ..."]:
        pairs = zip(question.inputs, arrays, strict=True)
        feed = {name: np.asarray(x, np.float32) for name, x in pairs}
        try:
            return np.asarray(graph.run([question.output], feed)[0])
        except Exception as error:  # as above
            raise ModelError(
                f"{path} does not map {', '.join(question.inputs)} to {question.output} "
                f"({str(error).splitlines()[0]}); export it with wt.export.onnx"
            ) from error

    return call


def check(
    onnx_path: Path,
    model: Model,
    inputs: Sequence[Float[np.ndarray, "_ _"]],
    *,
    question: Question = TRANSLATION,
    tolerance: float = TOLERANCE,
    batches: Sequence[int] = BATCHES,
) -> float:
    """Compare the graph with the eager model, at several batch sizes.

    Args:
        onnx_path: the exported graph.
        model: the eager model as a function of arrays (``wt.export.onnx.eager``).
        inputs: examples of the question's inputs, at least one row each; repeated to fill a batch.
        question: what both are asked.
        tolerance: largest difference that passes.
        batches: batch sizes to try.

    Returns:
        The largest difference found.

    Raises:
        ModelError: a difference is above tolerance or not finite, or the file cannot be run.
    """
    graph = load(onnx_path, question)
    worst = 0.0
    for batch in batches:
        rows = [np.resize(x, (batch, x.shape[1])).astype(np.float32) for x in inputs]
        worst = max(worst, _difference(graph(*rows), model(*rows), onnx_path, tolerance))
    return worst


def verify(folder: Path) -> Card:
    """Check that ``model.onnx`` is the file its card names and still gives the golden answers.

    Raises:
        RegistryError: a file is missing, or bytes or answers are not those of the card.
    """
    card = Card.load(folder)
    path = folder / MODEL_FILE
    if not path.is_file():
        raise RegistryError(f"{folder} has {CARD_FILE} but no {MODEL_FILE}; pull the model again")
    actual = sha256(path)
    if actual != card.sha256:
        raise RegistryError(
            f"{path} has sha256 {actual[:12]}…, its card says {card.sha256[:12]}…: the bytes were "
            "changed; do not run it, pull the model again or export it anew"
        )
    *inputs, o_next_real = card.golden.arrays()
    try:
        _difference(load(path)(*inputs), o_next_real, path, TOLERANCE)
        if card.carried is not None:
            hidden, shift = card.carried.arrays()
            _difference(load(path, SHIFT)(*inputs, hidden), shift, path, TOLERANCE)
    except ModelError as error:
        raise RegistryError(f"the golden pairs of {card.name} do not replay: {error}") from error
    return card


def _difference(
    got: Shaped[np.ndarray, " ..."],
    expected: Shaped[np.ndarray, " ..."],
    path: Path,
    tolerance: float,
) -> float:
    if got.shape != expected.shape:
        raise ModelError(f"{path} answers with shape {got.shape}, the model with {expected.shape}")
    difference = np.abs(got - expected) / np.maximum(1.0, np.abs(expected))
    worst = float(difference.max())
    if not worst <= tolerance:  # also when it is NaN
        row, channel = np.unravel_index(int(difference.argmax()), difference.shape)
        raise ModelError(
            f"{path} differs from the model by {worst:.1e} in output channel {channel} at row "
            f"{row} of {len(got)}; at most {tolerance:.0e} is allowed: export it again in float32"
        )
    return worst
