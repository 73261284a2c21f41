from __future__ import annotations

import pytest
import torch

from wt.nets.translator import Discriminator, Generator


@pytest.mark.parametrize("condition", [0, 3])
def test_generator_starts_as_the_identity(condition: int) -> None:
    torch.manual_seed(0)
    z, x = torch.randn(6, 4), torch.randn(6, 3)
    assert torch.equal(Generator(4, condition, 8, 2)(z, x), z)


def stirred(net: torch.nn.Module) -> torch.nn.Module:
    """The network with random weights everywhere, also where it starts at zero."""
    torch.manual_seed(0)
    for parameter in net.parameters():
        torch.nn.init.normal_(parameter)
    return net


@pytest.mark.parametrize("kind", [Generator, Discriminator])
def test_conditioning_conditions_and_its_absence_does_not(
    kind: type[Generator] | type[Discriminator],
) -> None:
    z, x, other = torch.randn(6, 4), torch.randn(6, 3), torch.randn(6, 3)
    conditioned, plain = stirred(kind(4, 3, 8, 2)), stirred(kind(4, 0, 8, 2))
    assert not torch.allclose(conditioned(z, x), conditioned(z, other))
    assert torch.equal(plain(z, x), plain(z, other))


def test_generator_adds_to_what_it_is_given() -> None:
    net = stirred(Generator(4, 0, 8, 2))
    z, x = torch.randn(6, 4), torch.randn(6, 3)
    torch.testing.assert_close(net(z, x), z + net.net(z))


def test_discriminator_gives_one_logit_a_row() -> None:
    assert Discriminator(4, 3, 8, 2)(torch.randn(1, 4), torch.randn(1, 3)).shape == (1,)
