"""The documentation's few lines for a Trainer of one's own do what they say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.end_to_end.conftest import Place
from wt.train.score import PairTensors, predictions


def test_a_trainer_of_ones_own_trains_and_tests(
    place: Place, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks = re.findall(r"```python\n(.*?)```", (root / "docs/fit.md").read_text(), re.DOTALL)
    (block,) = (block for block in blocks if "module_and_data" in block)
    small = {
        '"conf/r5.yaml", ["paper.train.steps=1000"]': f"{place.words[1]!r}, {place.words[2:]!r}",
        "max_steps=1000": "max_steps=40",
        "val_check_interval=500": "val_check_interval=20",
    }
    for words, others in small.items():
        assert words in block
        block = block.replace(words, others)
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(block, found)
    trainer, module, study = found["trainer"], found["module"], found["study"]
    assert trainer.fit_loop.epoch_loop.global_step == 40
    frame, test = module.model.frame, study.data.test
    pairs = PairTensors.of(test, frame.state.std, frame.change.std)
    states = predictions(module.deployed(), pairs).numpy()
    error = (((states - test.real.s_next) / frame.state.std.numpy()) ** 2).mean()
    assert float(trainer.callback_metrics["test/mse"]) == pytest.approx(float(error), rel=1e-5)
    assert np.isfinite(error)
