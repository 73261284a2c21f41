from __future__ import annotations

import numpy as np
import torch

from wt.nets.film_decoder import ConcatDecoder, FiLMDecoder
from wt.nets.mlp import mlp


def decoder_without_modulation() -> FiLMDecoder:
    torch.manual_seed(0)
    decoder = FiLMDecoder(3, 2, 4, 8, 2)
    torch.nn.init.zeros_(decoder.modulation.weight)
    torch.nn.init.zeros_(decoder.modulation.bias)
    return decoder


def test_no_modulation_is_the_plain_mlp_of_the_same_weights() -> None:
    decoder, plain = decoder_without_modulation(), mlp(3, 2, 8, 2)
    for ours, theirs in zip([*decoder.layers, decoder.out], plain[::2], strict=True):
        theirs.load_state_dict(ours.state_dict())
    x = torch.randn(5, 3)
    torch.testing.assert_close(decoder(x, torch.randn(5, 4)), plain(x))


def test_modulation_scales_and_shifts_each_layers_features() -> None:
    decoder, x = decoder_without_modulation(), torch.randn(5, 3)
    gamma, beta = np.linspace(0.5, 2, 16).reshape(2, 8), np.linspace(-1, 1, 16).reshape(2, 8)
    with torch.no_grad():
        parts = [gamma[0] - 1, beta[0], gamma[1] - 1, beta[1]]
        decoder.modulation.bias.copy_(torch.tensor(np.concatenate(parts)))
    h = x.numpy()
    for i, layer in enumerate(decoder.layers):
        f = h @ layer.weight.detach().numpy().T + layer.bias.detach().numpy()
        h = gamma[i] * f + beta[i]  # FiLM: γ(z) ⊙ f(o, a) + β(z)
        h = h / (1 + np.exp(-h))
    expected = h @ decoder.out.weight.detach().numpy().T + decoder.out.bias.detach().numpy()
    actual = decoder(x, torch.zeros(5, 4)).detach().numpy()
    np.testing.assert_allclose(actual, expected, atol=1e-5)


def test_both_decoders_listen_to_condition_and_feature() -> None:
    for kind in (FiLMDecoder, ConcatDecoder):
        torch.manual_seed(0)
        x, z = torch.randn(5, 3, requires_grad=True), torch.randn(5, 4, requires_grad=True)
        gradients = torch.autograd.grad(kind(3, 2, 4, 8, 2)(x, z).sum(), (x, z))
        assert all((g.abs().sum(0) > 0).all() for g in gradients), kind.__name__
