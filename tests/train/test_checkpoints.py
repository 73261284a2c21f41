"""Which checkpoint of a training is kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from unittest.mock import Mock

import lightning
import pytest
import torch

from wt.train.checkpoints import LatestOfTheBest


def kept(best: LatestOfTheBest, errors: Sequence[float], standard_error: float) -> int:
    """Index of the checkpoint that is kept after these."""
    last = -1
    for k, error in enumerate(errors):
        trainer = Mock(
            spec=lightning.Trainer, callback_metrics={"se": torch.tensor(standard_error)}
        )
        trainer.strategy = Mock()
        trainer.strategy.reduce_boolean_decision = lambda decision: decision
        if best.check_monitor_top_k(trainer, torch.tensor(error)):
            last = k
    return last


@pytest.mark.parametrize(
    ("errors", "standard_error", "wanted"),
    [
        ([3.0, 1.0, 2.0], 0.0, 1),
        ([3.0, 1.0, 1.2], 0.0, 1),
        ([3.0, 1.0, 1.2], 0.3, 2),
        ([3.0, 1.0, 1.2, 1.4], 0.3, 2),
        # the limit is the lowest one's: errors do not creep up
        ([1.0, 1.2, 1.4, 1.6], 0.3, 1),
        ([1.0, 1.2, 0.8, 1.05], 0.3, 3),
        ([1.0, 1.2, 0.8, 1.15], 0.3, 2),
    ],
)
def test_the_latest_within_the_lowest_ones_error_is_kept(
    tmp_path: Path, errors: list[float], standard_error: float, wanted: int
) -> None:
    best = LatestOfTheBest(tmp_path, "error", "se")
    assert kept(best, errors, standard_error) == wanted


def test_a_continued_training_compares_with_what_the_interrupted_one_saw(tmp_path: Path) -> None:
    before, after = (LatestOfTheBest(tmp_path, "error", "se") for _ in range(2))
    assert kept(before, [1.0, 1.2], 0.3) == 1
    after.load_state_dict(before.state_dict())
    assert kept(after, [1.4], 0.3) == -1
    assert kept(after, [1.1], 0.3) == 0
