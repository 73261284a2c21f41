"""Parity against a model known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from registry import parity
from registry.card import Card
from wt.errors import ModelError, RegistryError

Model = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


def test_equal_models_pass_at_every_batch_size(
    make_folder: Callable[..., Path], truth: Model, rows: Rows
) -> None:
    sizes = []

    def counted(o: np.ndarray, a: np.ndarray, o_next_sim: np.ndarray) -> np.ndarray:
        sizes.append(len(o))
        return truth(o, a, o_next_sim)

    assert parity.check(make_folder() / "model.onnx", counted, rows) <= 1e-6
    assert sizes == [1, 7, 256]


@pytest.mark.parametrize("error", [3e-5, -3e-5, float("nan")])
def test_a_small_error_in_one_value_is_found_and_placed(
    make_folder: Callable[..., Path], truth: Model, rows: Rows, error: float
) -> None:
    def wrong(o: np.ndarray, a: np.ndarray, o_next_sim: np.ndarray) -> np.ndarray:
        answer = truth(o, a, o_next_sim)
        if len(answer) > 7:
            answer[200, 1] = 0.5 + error if np.isnan(error) else answer[200, 1] * (1 + 9 * error)
        return answer

    with pytest.raises(ModelError, match="channel 1 at row 200 of 256"):
        parity.check(make_folder() / "model.onnx", wrong, rows)


def test_large_values_are_compared_relatively(
    make_folder: Callable[..., Path], truth: Model, rows: Rows
) -> None:
    path = make_folder() / "model.onnx"
    large = tuple(1e4 * x for x in rows)
    shifted = parity.check(path, lambda *x: truth(*x) * np.float32(1 + 5e-6), large)
    assert shifted == pytest.approx(5e-6, rel=0.1)
    with pytest.raises(ModelError):
        parity.check(path, lambda *x: truth(*x) * np.float32(1 + 5e-5), large)


def test_another_shape_is_refused(
    make_folder: Callable[..., Path], truth: Model, rows: Rows
) -> None:
    path = make_folder() / "model.onnx"
    with pytest.raises(ModelError, match=r"\(1, 3\).*\(1, 2\)"):
        parity.check(path, lambda *x: truth(*x)[:, :2], rows)
    with pytest.raises(ModelError, match="does not map"):
        parity.check(path, truth, (rows[0], rows[0], rows[2]))


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b"junk"])
def test_a_truncated_graph_is_no_model(
    make_folder: Callable[..., Path], damage: Callable[[bytes], bytes]
) -> None:
    path = make_folder() / "model.onnx"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ModelError, match="no whole ONNX model") as caught:
        parity.load(path)
    assert "\n" not in str(caught.value)


def test_runs_on_the_cpu_only_and_says_when_the_file_is_missing(
    make_folder: Callable[..., Path], tmp_path: Path
) -> None:
    assert parity.session(make_folder() / "model.onnx").get_providers() == ["CPUExecutionProvider"]
    with pytest.raises(ModelError, match="does not exist"):
        parity.session(tmp_path / "none.onnx")


def test_verify_finds_every_changed_byte(make_folder: Callable[..., Path]) -> None:
    folder = make_folder()
    assert parity.verify(folder) == Card.load(folder)
    path = folder / "model.onnx"
    whole = path.read_bytes()
    for at in range(0, len(whole), 37):
        changed = bytearray(whole)
        changed[at] ^= 1
        path.write_bytes(changed)
        with pytest.raises(RegistryError, match="bytes were changed"):
            parity.verify(folder)
    path.unlink()
    with pytest.raises(RegistryError, match=r"no model\.onnx"):
        parity.verify(folder)


def test_verify_replays_the_golden_pairs(make_folder: Callable[..., Path]) -> None:
    folder = make_folder()
    path = folder / "card.json"
    text = path.read_text()
    value = repr(Card.load(folder).golden.o_next_real[2][1])
    assert value in text
    path.write_text(text.replace(value, repr(float(value) + 0.01)))
    with pytest.raises(RegistryError, match=r"golden pairs of wt-toy.*channel 1 at row 2 of 5"):
        parity.verify(folder)
