"""What S would have answered to R, on ground of which a recording tells next to nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.baselines.toy import REAL, SIM, Field, Toy
from wt.config import Mean
from wt.nets.frame import Frame
from wt.nets.mlp import mlp
from wt.train.answers import Answers
from wt.train.mean_field import fit_normalizers
from wt.train.regression import Regression
from wt.types import Transitions, TransitionSpec


def answers(toy: Toy, spec: TransitionSpec, sim: Transitions, real: Transitions) -> Answers:
    frame = Frame(spec, Mean())
    fit_normalizers(frame, sim, real)
    made = Answers(frame, lambda n, m: mlp(n, m, 64, 2), Regression(500, 256, 4e-3), toy)
    made.fit(sim, replace(real, hidden=np.full_like(real.hidden, np.nan)))
    return made


def test_every_other_answer_has_what_r_did_beyond_its_average() -> None:
    field = Field(0.0)
    real = field.collect(REAL, 100, 2)
    made = answers(field, field.spec, field.collect(SIM, 100, 1), real)
    would = made.of(real).nominal[:, 2:].astype(float)
    start, a = np.float64(real.o[:, :4]), np.float64(real.a)
    still = (plant.step(start, a, 0.0 * start[:, :2])[:, 2:] for plant in (SIM, REAL))
    of_sim, of_real = (x.astype(float) for x in still)
    pushed = real.s_next[:, 2:] - of_real
    for share, rows in ((0.0, slice(0, None, 2)), (1.0, slice(1, None, 2))):
        # S's plain answer, and of what pushed R all or nothing
        off = would[rows] - of_sim[rows] - share * pushed[rows]
        assert np.mean(off**2) < 0.1 * np.mean(pushed**2)


def test_where_nothing_is_hidden_s_answers_for_itself() -> None:
    toy = Toy(0.0)
    still = replace(toy.spec, hidden=())
    sim, real = (
        replace(data, hidden=np.empty((len(data), 0)))
        for data in (toy.collect(SIM, 5, 1), toy.collect(REAL, 5, 2))
    )
    made = answers(toy, still, sim, real)
    assert made.regressions == 0
    np.testing.assert_allclose(made.of(real).nominal, real.nominal, atol=1e-6)
