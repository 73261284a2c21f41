"""The closed forms that the other tests compare with, checked against plain least squares."""

from __future__ import annotations

import numpy as np
import pytest

from tests.baselines.toy import REAL, Toy


@pytest.mark.parametrize("rho", [0.0, 0.95])
def test_error_without_history(rho: float) -> None:
    toy = Toy(rho)
    data = toy.collect(REAL, 600, 0)
    x, y = np.hstack([data.o, data.a]).astype(float), data.s_next[:, 2:].astype(float)
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    assert np.mean(left**2) == pytest.approx(toy.error_without_history(), rel=0.05)


def test_history_tells_the_force() -> None:
    toy = Toy(0.95)
    assert toy.error_with_history() < 0.5 * toy.error_without_history()
    assert Toy(0.0).error_with_history() == pytest.approx(Toy(0.0).error_without_history())
