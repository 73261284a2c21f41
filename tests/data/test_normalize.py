from __future__ import annotations

import numpy as np
import pytest
import torch

from wt.data.normalize import Normalizer
from wt.errors import DataError


def test_known_sample() -> None:
    normalizer = Normalizer(2).fit(np.array([[0.0, 10.0], [2.0, 30.0], [4.0, 50.0]]))
    # by hand: means 2 and 30; population variances 8/3 and 800/3
    assert normalizer.mean.tolist() == [2.0, 30.0]
    expected = torch.tensor([[1.0, 1.0]]) * (4.0 - 2.0) / np.sqrt(8.0 / 3.0)
    torch.testing.assert_close(normalizer(torch.tensor([[4.0, 50.0]])), expected)


def test_fits_in_place_because_models_own_it() -> None:
    normalizer = Normalizer(3)
    assert normalizer.fit(torch.randn(50, 3) * 7.0) is normalizer
    assert (normalizer.std > 3.0).all()


def test_inverse_undoes_forward() -> None:
    generator = torch.Generator().manual_seed(0)
    sample = torch.randn(100, 4, generator=generator) * torch.tensor([1e-3, 1.0, 50.0, 1e3]) + 5.0
    normalizer = Normalizer(4).fit(sample)
    torch.testing.assert_close(normalizer.inverse(normalizer(sample)), sample)


@pytest.mark.parametrize("value", [0.0, 0.1, -1234.5])
def test_constant_channel_is_only_centred(value: float) -> None:
    sample = np.full((1000, 1), value, np.float32)
    normalizer = Normalizer(1).fit(sample)
    moved = normalizer(torch.tensor([[value + 0.25]]))
    torch.testing.assert_close(moved, torch.tensor([[0.25]]), atol=1e-4, rtol=0.0)


def test_small_channel_is_not_taken_for_a_constant_one() -> None:
    sample = np.random.default_rng(0).normal(size=(500, 1)) * 1e-5
    z = Normalizer(1).fit(sample)(torch.tensor(sample, dtype=torch.float32))
    assert float(z.std(correction=0)) == pytest.approx(1.0, rel=1e-3)


def test_state_travels_with_the_model() -> None:
    fitted = Normalizer(2).fit(np.array([[1.0, 2.0], [3.0, 8.0]]))
    fresh = Normalizer(2)
    fresh.load_state_dict(fitted.state_dict())
    x = torch.tensor([[0.5, -1.0]])
    assert torch.equal(fresh(x), fitted(x))
    assert not list(fitted.parameters())


@pytest.mark.parametrize("shape", [(0, 2), (5, 3), (2,)])
def test_unusable_sample_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(DataError, match="2 channels"):
        Normalizer(2).fit(np.zeros(shape))
