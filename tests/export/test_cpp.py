"""The C++ example of the documentation, compiled and run on an exported graph."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch

from wt.export.onnx import export
from wt.types import Channel, TransitionSpec

PAGE = Path(__file__).parents[2] / "docs" / "models.md"
INCLUDE = "ONNXRUNTIME_INCLUDE"
HEADER = "onnxruntime_cxx_api.h"
SPEC = TransitionSpec(
    task="toy_arm",
    rate_hz=50.0,
    joints=("j1", "j2"),
    observation=tuple(Channel(f"c{i}", "rad") for i in range(5)),
    n_state=4,
    action=tuple(Channel(f"a{i}", "rad") for i in range(2)),
)


class Shifted(torch.nn.Module):
    """R is S, moved by a constant that differs from channel to channel."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("by", torch.tensor([-0.375, 1.0, 2.0, 3.0, 4.0]))

    def forward(self, o: torch.Tensor, a: torch.Tensor, o_next_sim: torch.Tensor) -> torch.Tensor:
        return o_next_sim + self.by + 0.5 * o + a.sum(dim=1, keepdim=True)


@pytest.fixture
def compiler() -> str:
    found = next(filter(None, map(shutil.which, ("c++", "g++", "clang++"))), None)
    if found is None:
        pytest.skip("there is no C++ compiler")
    return found


@pytest.fixture
def headers() -> Path:
    """ONNX Runtime's, which Python's package does not bring."""
    folder = Path(os.environ.get(INCLUDE, ""))
    if INCLUDE not in os.environ:
        pytest.skip(f"no headers of ONNX Runtime: name the folder of {HEADER} in {INCLUDE}")
    assert (folder / HEADER).is_file(), f"{INCLUDE} is {folder}, which has no {HEADER}"
    return folder


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A folder with the library of Python's package under the names that a linker looks for."""
    (found,) = (Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*")
    folder = tmp_path / "lib"
    folder.mkdir()
    for name in ("libonnxruntime.so", "libonnxruntime.so.1"):
        (folder / name).symlink_to(found)
    return folder


def test_the_example_of_the_page_compiles_and_says_what_the_graph_does(
    compiler: str, headers: Path, library: Path, tmp_path: Path
) -> None:
    blocks = re.findall(r"^```cpp\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    (tmp_path / "main.cpp").write_text("\n".join(blocks))
    built = subprocess.run(
        [compiler, "-std=c++17", "-Wall", "-Wextra", "-Werror", "main.cpp", "-o", "main",
         f"-isystem{headers}", f"-L{library}", f"-Wl,-rpath,{library}", "-lonnxruntime"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    example = tuple(np.zeros((1, n), np.float32) for n in (5, 2, 5))
    export(Shifted(), SPEC, tmp_path / "model.onnx", example=example)
    done = subprocess.run(
        [tmp_path / "main"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    task, first = done.stdout.splitlines()
    assert task == "toy_arm" and float(first) == -0.375
