from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar

from wt.losses.robust import cauchy


def test_value_is_that_of_the_formula() -> None:
    error = np.random.default_rng(0).normal(size=(8, 3))
    expected = np.log(1 + np.mean(error**2, axis=1) / 0.2**2).mean()
    assert float(cauchy(torch.tensor(error), 0.2)) == pytest.approx(expected)


def test_settles_on_the_atom_where_least_squares_takes_the_average() -> None:
    # 65 % of the answers are exactly 1, the rest are spread widely to one side of it
    rng = np.random.default_rng(0)
    wide = 3.0 + 2.0 * rng.normal(size=7_000)
    answers = torch.tensor(np.concatenate([np.ones(13_000), wide]))[:, None]

    def best(loss: Callable[[torch.Tensor], torch.Tensor]) -> float:
        return float(minimize_scalar(lambda at: float(loss(answers - at)), (0.0, 2.0)).x)

    average = float(answers.mean())
    assert average > 1.6
    assert best(lambda e: (e**2).mean()) == pytest.approx(average, abs=1e-4)
    for width in (0.02, 0.05, 0.1):
        assert best(lambda e, w=width: cauchy(e, w)) == pytest.approx(1.0, abs=0.02)


def test_pull_of_a_far_answer_falls_with_its_distance() -> None:
    far = torch.tensor([[10.0], [100.0]], requires_grad=True)
    (pull,) = torch.autograd.grad(cauchy(far, 0.05) * len(far), far)
    # d/dr log(1 + r²/w²) → 2 / r
    np.testing.assert_allclose(pull[:, 0], [0.2, 0.02], rtol=1e-4)
