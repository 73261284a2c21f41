"""The pipeline on models whose parts are linear maps that the test knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from tests.baselines.toy import Toy
from wt.config import Mean, Method, TranslationConfig
from wt.nets.world_model import WorldModel
from wt.translate import Exported, SimToReal, translate_state

SPEC = Toy(0.0).spec  # 6 observations, 2 actions, 4 states
RNG = np.random.default_rng(0)
MIX = RNG.normal(size=(4, 4)) + 2 * np.eye(4)
FROM_X = RNG.normal(size=(8, 4))
STEP = np.array([0.5, -1.0, 0.0, 2.0])
SCALE = np.array([0.1, 0.2, 0.5, 3.0])


def tensor(array: np.ndarray) -> Tensor:
    return torch.tensor(array, dtype=torch.float32)


class LinearEncoder(nn.Module):
    """z = (y − x B) A; as uncertain as can be, which deployment must not see."""

    def forward(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        z = (y - x @ tensor(FROM_X)) @ tensor(MIX)
        return z, torch.full_like(z, 4.0)


class LinearDecoder(nn.Module):
    """y = x B + z A⁻¹, the encoder's inverse."""

    def forward(self, x: Tensor, z: Tensor) -> Tensor:
        return x @ tensor(FROM_X) + z @ tensor(np.linalg.inv(MIX))


class Deaf(nn.Module):
    """A decoder that has lost z."""

    def forward(self, x: Tensor, z: Tensor) -> Tensor:
        return x @ tensor(FROM_X)


class Step(nn.Module):
    """ẑ = z + c."""

    def forward(self, z: Tensor, x: Tensor) -> Tensor:
        return z + tensor(STEP)


class Identity(nn.Module):
    """ẑ = z."""

    def forward(self, z: Tensor, x: Tensor) -> Tensor:
        return z


class Linear(nn.Module):
    """A regressor of the mean field, linear in the whole of its input."""

    def __init__(self, weight: np.ndarray) -> None:
        super().__init__()
        self.weight = tensor(weight)

    def forward(self, x: Tensor) -> Tensor:
        return x @ self.weight


def build(mean: Mean | None = None, anchored: bool = False) -> WorldModel:
    method = Method(mean=mean or Mean(), translation=TranslationConfig(anchored=anchored))
    model = WorldModel(SPEC, method)
    model.frame.change.std.copy_(tensor(SCALE))
    model.frame.condition.mean.copy_(torch.linspace(-1, 1, 8))
    model.frame.condition.std.copy_(torch.linspace(0.5, 2, 8))
    model.encoder, model.decoder, model.to_real = LinearEncoder(), LinearDecoder(), Step()
    return model


def batch(n: int = 5) -> tuple[Tensor, Tensor, Tensor]:
    torch.manual_seed(0)
    return torch.randn(n, 6), torch.randn(n, 2), torch.randn(n, 4)


def conditions(o: Tensor, a: Tensor) -> np.ndarray:
    """Normalised (o, a) with joint targets relative to the joints, written out."""
    pose = o[:, :2]
    raw = torch.cat([o[:, :4], o[:, 4:] - pose, a - pose], dim=1).numpy()
    return (raw - np.linspace(-1, 1, 8)) / np.linspace(0.5, 2, 8)


def check(found: Tensor, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("n", [1, 5])
def test_pipeline_encodes_translates_and_decodes(n: int) -> None:
    o, a, sim_next = batch(n)
    # D(x, E(x, y) + c) = y + c A⁻¹, and y = (o′ − o) / σ
    expected = sim_next.numpy() + SCALE * (STEP @ np.linalg.inv(MIX))
    check(translate_state(build(), o, a, sim_next), expected)


def test_far_from_all_that_was_seen_the_simulators_answer_stands() -> None:
    model = build()
    o, a, sim_next = batch()
    before = translate_state(model, o, a, sim_next)
    model.method = replace(model.method, translation=TranslationConfig(reach=20.0))
    o[1, 2], a[3, 0] = 60.0, -80.0
    found = translate_state(model, o, a, sim_next)
    check(found[[1, 3]], sim_next[[1, 3]].numpy())
    check(found[[0, 2, 4]], before[[0, 2, 4]].numpy())


def test_identity_generator_and_inverse_decoder_give_the_simulator_back() -> None:
    o, a, sim_next = batch()
    model = build()
    model.to_real = Identity()
    check(translate_state(model, o, a, sim_next), sim_next.numpy())


def test_papers_model_ignores_strength_and_decoder_errors_show() -> None:
    o, a, sim_next = batch()
    model = build()
    model.strength.data.fill_(0.0)
    expected = sim_next.numpy() + SCALE * (STEP @ np.linalg.inv(MIX))
    check(translate_state(model, o, a, sim_next), expected)
    x = conditions(o, a)
    model.decoder = Deaf()
    check(translate_state(model, o, a, sim_next), o[:, :4].numpy() + SCALE * (x @ FROM_X))


@pytest.mark.parametrize("strength", [0.0, 0.3, 1.0])
def test_anchored_adds_its_share_of_the_difference(strength: float) -> None:
    o, a, sim_next = batch()
    model = build(anchored=True)
    model.strength.data.fill_(strength)
    expected = sim_next.numpy() + strength * SCALE * (STEP @ np.linalg.inv(MIX))
    check(translate_state(model, o, a, sim_next), expected)
    # what the decoder loses is not lost in the answer
    model.decoder = Deaf()
    check(translate_state(model, o, a, sim_next), sim_next.numpy())


NOMINAL, SHIFT = RNG.normal(size=(8, 4)), RNG.normal(size=(12, 4))
TRANSPORT = np.array([[1.5, 0.6, 0, 0], [0.2, 0.5, 0, 0], [0, 0, 1, -0.1], [0, 0, -0.3, 2]])


@pytest.mark.parametrize("simulator", ["base", "read", "encoded", "ignored"])
def test_mean_field_transport_and_translation_add_up(simulator: str) -> None:
    o, a, sim_next = batch()
    mean = Mean(kind="average", simulator=simulator, width=4, depth=1)  # type: ignore[arg-type]
    model = build(mean, anchored=True)
    frame, x = model.frame, conditions(o, a)
    change = (sim_next - o[:, :4]).numpy() / SCALE
    reads = simulator in ("read", "encoded")
    frame.shift = Linear(SHIFT if reads else SHIFT[:8])
    shift = (np.hstack([x, change]) if reads else x) @ SHIFT[: 12 if reads else 8]
    nominal, transport = np.zeros_like(change), np.zeros((4, 4))
    if simulator == "encoded":  # S's outcome stands as it is
        transport = np.eye(4)
    elif simulator != "ignored":
        frame.nominal = Linear(NOMINAL)
        frame.transport.copy_(tensor(TRANSPORT))
        nominal, transport = x @ NOMINAL, TRANSPORT
    y = (change - nominal) @ transport.T
    moved = y + STEP @ np.linalg.inv(MIX)
    check(
        translate_state(model, o, a, sim_next),
        o[:, :4].numpy() + SCALE * (nominal + shift + moved),
    )
    # an identity generator leaves exactly nominal + shift + y
    model.method = replace(model.method, translation=TranslationConfig(anchored=True))
    model.to_real = Identity()
    exact = o[:, :4].numpy() + SCALE * (nominal + shift + y)
    check(translate_state(model, o, a, sim_next), exact)


def test_a_reader_of_the_simulator_has_its_share_of_each_channel() -> None:
    o, a, sim_next = batch()
    model = build(Mean(kind="average", simulator="blend", width=4, depth=1), anchored=True)
    frame, x = model.frame, conditions(o, a)
    frame.nominal, frame.shift = Linear(NOMINAL), Linear(SHIFT[:8])
    translated = translate_state(model, o, a, sim_next).detach().numpy()
    read = SHIFT[::-1].copy()
    frame.reader = Linear(read)
    change = (sim_next - o[:, :4]).numpy() / SCALE
    answer = sim_next.numpy() + SCALE * (np.hstack([x, change]) @ read)
    share = np.array([0.0, 0.25, 0.5, 1.0])
    frame.trusted.copy_(tensor(share))
    check(translate_state(model, o, a, sim_next), (1.0 - share) * translated + share * answer)


@pytest.mark.parametrize("n", [1, 5])
def test_sim_to_real_hands_the_other_channels_through(n: int) -> None:
    o, a, sim_next = batch(n)
    other = torch.randn(n, 2)
    out = SimToReal(build())(o, a, torch.cat([sim_next, other], dim=1))
    assert out.shape == (n, 6)
    assert torch.equal(out[:, 4:], other)
    check(out[:, :4], translate_state(build(), o, a, sim_next).numpy())


def test_features_are_those_of_training_and_of_translation() -> None:
    """Of R: E on what is beyond nominal simulator and shift; of S: G on what is transported."""
    o, a, after = batch()
    model = build(Mean(kind="average", width=4, depth=1))
    model.frame.shift, model.frame.nominal = Linear(SHIFT[:8]), Linear(NOMINAL)
    model.frame.transport.copy_(tensor(TRANSPORT))
    x, change = conditions(o, a), (after - o[:, :4]).numpy() / SCALE
    whole = torch.cat([after, torch.zeros(5, 2)], dim=1)
    answer, z, translated = Exported(model)(o, a, whole)
    check(answer[:, :4], translate_state(model, o, a, after).numpy())
    check(z, (change - x @ NOMINAL - x @ SHIFT[:8] - x @ FROM_X) @ MIX)
    check(translated, ((change - x @ NOMINAL) @ TRANSPORT.T - x @ FROM_X) @ MIX + STEP)
