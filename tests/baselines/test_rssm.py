from __future__ import annotations

import pytest
import torch
from torch.distributions import Independent, Normal, kl_divergence

from tests.baselines.toy import Trial
from wt.baselines.rssm import _kl
from wt.config import Baselines


def fitted_error(trial: Trial, settings: Baselines) -> float:
    return trial.error(trial.fitted("RSSM", settings).predict(trial.test))


def test_infers_a_force_that_stays(persistent: Trial, small: Baselines) -> None:
    error = fitted_error(persistent, small)
    assert error < 0.6 * persistent.toy.error_without_history()
    assert error > 0.9 * persistent.toy.error_with_history()


def test_cannot_foresee_a_fleeting_force(fleeting: Trial, small: Baselines) -> None:
    assert fitted_error(fleeting, small) == pytest.approx(
        fleeting.toy.error_without_history(), rel=0.2
    )


def test_is_no_worse_than_a_regression_where_the_past_tells_nothing(
    fleeting: Trial, small: Baselines
) -> None:
    direct, rssm = (
        fleeting.error(fleeting.fitted(name, small).predict(fleeting.test))
        for name in ("DirectPred", "RSSM")
    )
    assert rssm < 1.02 * direct


def test_divergence_is_that_of_torch() -> None:
    generator = torch.Generator().manual_seed(0)
    mean_q, mean_p, std_q, std_p = torch.rand(4, 5, 3, generator=generator) + 0.1
    expected = kl_divergence(
        Independent(Normal(mean_q, std_q), 1), Independent(Normal(mean_p, std_p), 1)
    )
    torch.testing.assert_close(_kl((mean_q, std_q), (mean_p, std_p)), expected)
