from __future__ import annotations

import numpy as np
import pytest
import torch

from wt.losses import gan

REAL = np.array([2.0, -0.5, 0.3, 4.0])
FAKE = np.array([-1.0, 0.7, 0.9, -3.0])
T_REAL, T_FAKE = torch.tensor(REAL), torch.tensor(FAKE)


def sigmoid(x: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-x))


def test_cross_entropy_is_the_papers() -> None:
    discriminator = -np.log(sigmoid(REAL)).mean() - np.log(1 - sigmoid(FAKE)).mean()
    assert float(gan.discriminator("bce", T_REAL, T_FAKE)) == pytest.approx(discriminator)
    generator = -np.log(sigmoid(FAKE)).mean()
    assert float(gan.generator("bce", T_FAKE)) == pytest.approx(generator)


def test_least_squares() -> None:
    discriminator = np.mean((REAL - 1) ** 2) / 2 + np.mean(FAKE**2) / 2
    assert float(gan.discriminator("lsgan", T_REAL, T_FAKE)) == pytest.approx(discriminator)
    generator = np.mean((FAKE - 1) ** 2) / 2
    assert float(gan.generator("lsgan", T_FAKE)) == pytest.approx(generator)


def test_cross_entropy_survives_certain_discriminators() -> None:
    sure = torch.tensor([1e4])
    assert float(gan.discriminator("bce", sure, -sure)) == 0.0
    assert float(gan.discriminator("bce", -sure, sure)) == pytest.approx(2e4)
    assert float(gan.generator("bce", -sure)) == pytest.approx(1e4)


def test_accuracy_counts_each_side_by_its_own_threshold() -> None:
    # bce: 3 of 4 real above 0, 2 of 4 fake below; lsgan: 2 of 4 above 0.5, 2 of 4 below
    assert float(gan.accuracy("bce", T_REAL, T_FAKE)) == pytest.approx((3 / 4 + 2 / 4) / 2)
    assert float(gan.accuracy("lsgan", T_REAL, T_FAKE)) == pytest.approx((2 / 4 + 2 / 4) / 2)


def test_distance_is_the_mean_absolute_difference() -> None:
    a, b = np.array([[1.0, -2.0], [0.0, 3.0]]), np.array([[0.5, 2.0], [0.0, 1.0]])
    expected = np.abs(a - b).mean()
    assert float(gan.distance(torch.tensor(a), torch.tensor(b))) == pytest.approx(expected)
