from __future__ import annotations

import torch
from torch import nn

from tests.baselines.toy import Toy
from wt.config import Method, Nets, TranslationConfig
from wt.nets.film_decoder import ConcatDecoder, FiLMDecoder
from wt.nets.world_model import WorldModel

SPEC = Toy(0.0).spec


def test_the_papers_and_ours_are_the_same_classes() -> None:
    paper, ours = (
        WorldModel(SPEC, Method(translation=TranslationConfig(conditioned=c)))
        for c in (False, True)
    )
    assert [type(m) for m in paper.children()] == [type(m) for m in ours.children()]
    for name in ("to_real", "to_sim", "discriminator_real", "discriminator_sim"):
        inputs = [getattr(m, name).net[0].in_features for m in (paper, ours)]
        assert inputs == [16, 16 + SPEC.n_obs + SPEC.n_action], name


def test_decoder_variant() -> None:
    assert isinstance(WorldModel(SPEC, Method()).decoder, FiLMDecoder)
    plain = Method(nets=Nets(film=False))
    assert isinstance(WorldModel(SPEC, plain).decoder, ConcatDecoder)


def test_strength_is_saved_but_not_trained() -> None:
    model = WorldModel(SPEC, Method())
    assert float(model.strength) == 1.0
    assert not model.strength.requires_grad
    model.strength.data.fill_(0.3)
    twin = WorldModel(SPEC, Method())
    twin.load_state_dict(model.state_dict())
    assert float(twin.strength) == torch.tensor(0.3)


def test_checkpoints_of_earlier_versions_are_read() -> None:
    """They call discriminators judges, and lie inside a training module."""
    model, twin = (nn.ModuleDict({"model": WorldModel(SPEC, Method())}) for _ in range(2))
    earlier = {k.replace("discriminator_", "judge_"): v for k, v in model.state_dict().items()}
    assert any(".judge_" in key for key in earlier)
    twin.load_state_dict(earlier)
    for name, value in model.state_dict().items():
        torch.testing.assert_close(twin.state_dict()[name], value)
