"""How much samples count: in one part as ever, in several each by its own error."""

from __future__ import annotations

import numpy as np
import pytest

from wt.diagnose.likelihood.weights import Channels

SAMPLES = 40
QUIET, ROUGH = slice(0, 20), slice(20, 40)


def channels(*parts: slice) -> Channels:
    valid = np.ones((SAMPLES, 2), dtype=bool)
    valid[:5, 1] = False
    count = 0.1 * valid.sum(axis=0)
    return Channels(valid, parts, count, np.full((len(parts), 2), 0.5))


def error() -> np.ndarray:
    found = np.ones((SAMPLES, 2))
    found[ROUGH] = 8.0
    found[:5, 1] = 0.0
    return found


def test_one_part_has_the_mean_square_of_each_joint() -> None:
    one = channels(slice(None))
    variance = one.variance(one.sums(error() ** 2))
    assert variance == pytest.approx(np.array([[32.5, (15 + 20 * 64) / 35]]))
    assert one.rms(error()) ** 2 == pytest.approx(variance[0])
    assert one.precision(variance) == pytest.approx(np.tile(1.0 / variance, (SAMPLES, 1)))


def test_a_quiet_part_is_not_drowned_by_a_rough_one() -> None:
    two = channels(QUIET, ROUGH)
    variance = two.variance(two.sums(error() ** 2))
    assert variance == pytest.approx(np.array([[1.0, 1.0], [64.0, 64.0]]))
    weights = two.weights(variance).reshape(2, 2)
    assert weights[0] == pytest.approx(64.0 * weights[1])
    better = error()
    better[QUIET] /= 2.0
    one = channels(slice(None))
    gains = [
        some.nats(some.variance(some.sums(better**2)))
        - some.nats(some.variance(some.sums(error() ** 2)))
        for some in (one, two)
    ]
    assert gains[1] > 20.0 * gains[0] > 0.0


def test_no_error_is_smaller_than_what_like_replays_are_apart() -> None:
    apart = np.zeros((SAMPLES, 2))
    apart[ROUGH] = 3.0
    two = channels(QUIET, ROUGH).rougher([apart, -apart])
    assert two.floors[0] == pytest.approx([0.5, 0.5])
    assert two.floors[1] == pytest.approx(np.hypot(0.5, 3.0) * np.ones(2))
    assert two.variance(np.zeros(4)) == pytest.approx(two.floors**2)
    assert two.floor == pytest.approx(np.sqrt(two.floors[0] * two.floors[1]))


def test_fewer_samples_count_less() -> None:
    two = channels(QUIET, ROUGH)
    some = two.only(np.arange(SAMPLES) < 20)
    assert some.share == pytest.approx(two.share)
    assert some.count == pytest.approx([2.0, 1.5])
    assert two.count == pytest.approx([4.0, 3.5])
