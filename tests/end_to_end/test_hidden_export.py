"""What ``wt fit`` leaves of a model that carries hidden variables on: graph, card and parity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from registry import parity
from registry.card import Card
from wt.config import load
from wt.evaluate.results import OURS
from wt.nets.world_model import WorldModel
from wt.registered import Registered
from wt.run.publish import _export
from wt.run.study import Study
from wt.translate import carried

CONF = Path(__file__).resolve().parents[2] / "conf"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A small walking Go2, of which nothing is trained."""
    home = tmp_path_factory.mktemp("hidden")
    words = [
        f"data.dir={home}/data", "data.transitions=1200", "data.test_pairs=50", "world.robots=24",
        "world.episode_steps=50", "world.threads=1", "plus.mean.width=16", "plus.nets.width=16",
        "plus.mean.members=1",
    ]  # fmt: skip
    return Study.open(load(CONF / "go2_payload.yaml", words), home)


def kept(study: Study, gain: float) -> WorldModel:
    """A model that applies so much of what it says of hidden variables."""
    torch.manual_seed(0)
    model = WorldModel(study.world.spec, study.config.plus)
    model.frame.hidden.unit.fill_(0.1)
    model.frame.hidden.center.fill_(0.2)
    model.frame.hidden.gain.fill_(gain)
    study.keep_model(0, OURS, model)
    return model.eval()


def test_the_graph_carries_on_what_the_model_does(study: Study) -> None:
    model = kept(study, 1.0)
    _export(study, 0, {}, 0.5)
    card = parity.verify(study.folder)
    assert card.carried is not None
    assert card.carried.hidden.channels == study.world.spec.hidden
    rows = study.data.test.real
    registered = Registered(study.folder / "model.onnx", card, study.world.spec)
    given = rows.o, rows.a, study.data.test.sim_next
    _, shift = registered.step_of(*given, rows.hidden)
    expected = carried(model, *given, rows.hidden, np.zeros_like(rows.hidden))
    np.testing.assert_allclose(shift, expected, rtol=1e-5, atol=1e-6)
    assert np.abs(shift).max() > 1e-3


def test_of_a_model_that_leaves_it_to_s_graph_and_card_say_nothing_of_it(study: Study) -> None:
    kept(study, 0.0)
    _export(study, 0, {}, 0.5)
    assert Card.load(study.folder).carried is None
    session = parity.session(study.folder / "model.onnx")
    assert not session.get_overridable_initializers()
    assert [port.name for port in session.get_outputs()] == ["o_next_real", "z", "z_translated"]
