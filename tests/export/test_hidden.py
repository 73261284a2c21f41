"""What is hidden in the exported graph: an input that may be left out, and what is added to it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from registry import parity
from registry.card import Card
from tests.toy_models import carrying, exported
from wt.errors import ModelError, RegistryError
from wt.nets.world_model import WorldModel
from wt.registered import Registered
from wt.translate import carried, hidden_shift, translated
from wt.types import Channel, TransitionSpec

SPEC = TransitionSpec(
    task="toy",
    rate_hz=50.0,
    joints=("j1", "j2"),
    observation=tuple(Channel(f"c{i}", "rad") for i in range(6)),
    n_state=4,
    action=tuple(Channel(f"a{i}", "rad") for i in range(2)),
    hidden=(Channel("velocity/x", "m/s"), Channel("velocity/y", "m/s"), Channel("height", "m")),
)
Array = np.ndarray


@pytest.fixture(scope="module")
def model() -> WorldModel:
    model = carrying(SPEC)
    model.frame.hidden.center.copy_(torch.tensor([0.5, -0.25, 2.0]))
    return model


@pytest.fixture(scope="module")
def folder(model: WorldModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory.mktemp("hidden") / "model", model)


def rows(count: int) -> tuple[Array, Array, Array, Array]:
    """o, a, S's state after the step and what was hidden before it."""
    rng = np.random.default_rng(count)
    return tuple(rng.normal(size=(count, n)).astype(np.float32) for n in (6, 2, 4, 3))


@pytest.mark.parametrize("count", [1, 7, 256])
def test_the_graph_says_of_what_is_hidden_what_torch_says(
    folder: Path, model: WorldModel, count: int
) -> None:
    o, a, sim_next, hidden = rows(count)
    registered = Registered(folder / "model.onnx", Card.load(folder), SPEC)
    state, shift = registered.step_of(o, a, sim_next, hidden)
    with torch.no_grad():
        expected = hidden_shift(model, *map(torch.tensor, (o, a, sim_next, hidden))).numpy()
    np.testing.assert_allclose(shift, expected, rtol=1e-5, atol=1e-6)
    assert np.ptp(expected[:, 1:], axis=0).min() > 1e-3 or count == 1
    np.testing.assert_allclose(
        hidden + shift, carried(model, o, a, sim_next, hidden, hidden), rtol=1e-5, atol=1e-6
    )
    np.testing.assert_array_equal(state, registered.predict(o, a, sim_next))
    np.testing.assert_allclose(state, translated(model, o, a, sim_next), rtol=1e-5, atol=1e-6)


def test_who_only_translates_need_not_say_what_is_hidden(folder: Path, model: WorldModel) -> None:
    session = parity.session(folder / "model.onnx")
    assert [port.name for port in session.get_inputs()] == ["o", "a", "o_next_sim"]
    (optional,) = session.get_overridable_initializers()
    assert (optional.name, optional.shape) == ("hidden", ["batch", 3])
    o, a, sim_next, _ = rows(5)
    feed = {"o": o, "a": a, "o_next_sim": np.hstack([sim_next, o[:, 4:]])}
    o_next, *_, shift = session.run(None, feed)
    np.testing.assert_allclose(o_next[:, :4], translated(model, o, a, sim_next), atol=1e-6)
    usual = np.tile(np.float32([0.5, -0.25, 2.0]), (5, 1))
    np.testing.assert_array_equal(
        shift, session.run(["hidden_shift"], {**feed, "hidden": usual})[0]
    )


def test_the_graph_names_what_is_hidden(folder: Path) -> None:
    proto = onnx.load(folder / "model.onnx")
    said = {entry.key: entry.value for entry in proto.metadata_props}
    assert said["hidden_names"] == "velocity/x,velocity/y,height"
    assert said["hidden_units"] == "m/s,m/s,m"
    names = [port.name for port in proto.graph.output]
    assert names == ["o_next_real", "z", "z_translated", "hidden_shift"]
    card = Card.load(folder)
    assert [port.name for port in card.outputs] == names[:-1]
    assert card.carried.hidden.channels == SPEC.hidden


def test_golden_rows_of_what_is_hidden_are_replayed(folder: Path, tmp_path: Path) -> None:
    assert parity.verify(folder).carried is not None
    card = json.loads((folder / "card.json").read_text())
    card["carried"]["golden_shift"][1][2] += 1e-3
    (tmp_path / "card.json").write_text(json.dumps(card))
    (tmp_path / "model.onnx").write_bytes((folder / "model.onnx").read_bytes())
    with pytest.raises(RegistryError, match="golden pairs of wt-toy do not replay"):
        parity.verify(tmp_path)
    del card["carried"]["golden_shift"][1]
    (tmp_path / "card.json").write_text(json.dumps(card))
    with pytest.raises(RegistryError, match="golden rows of what is hidden are not 3"):
        parity.verify(tmp_path)


def test_a_model_of_other_hidden_variables_is_refused(folder: Path) -> None:
    other = TransitionSpec(**{**vars(SPEC), "hidden": SPEC.hidden[::-1]})
    with pytest.raises(ModelError, match=r"its hidden is velocity/x at number 0.*height"):
        Registered(folder / "model.onnx", Card.load(folder), other)


def test_beyond_the_reach_of_translation_what_is_hidden_goes_on_as_s_s() -> None:
    model = carrying(SPEC)
    model.method.translation.reach = 3.0
    o, a, sim_next, hidden = (np.clip(x, -1, 1) for x in rows(4))
    o[2, 1] = 50.0
    moved = carried(model, o, a, sim_next, hidden, hidden) - hidden
    assert (moved[2] == 0).all()
    assert (np.abs(moved[[0, 1, 3], 1:]) > 0).all()
