from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.baselines.toy import Trial
from wt.baselines.base import find
from wt.baselines.flow import Flow, coupled
from wt.config import Baselines, Method, Nets, Vae
from wt.nets.world_model import WorldModel


def test_partners_are_those_of_the_cheapest_transport() -> None:
    generator = torch.Generator().manual_seed(0)
    a = torch.randn(512, 3, generator=generator)
    shuffled = torch.cat([a[:256].flip(0), a[256:].roll(5, 0)])
    # by a shift alone the cheapest plan pairs each with itself, shifted
    here, there = coupled(a, shuffled + 2.0)
    assert torch.equal(here, a)
    torch.testing.assert_close(there, a + 2.0)


def test_a_flow_begins_as_no_motion_and_follows_its_velocity() -> None:
    flow = Flow(2, 8, 1)
    z = torch.randn(5, 2, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(flow(z, z), z)

    class Turning(torch.nn.Module):
        def forward(self, inputs: torch.Tensor) -> torch.Tensor:
            z, t = inputs[:, :2], inputs[:, 2:]
            return np.pi * t * torch.stack([-z[:, 1], z[:, 0]], dim=1)

    flow.net = Turning()
    # the angle is the integral of pi t over 0 to 1, a quarter turn
    quarter = torch.stack([-z[:, 1], z[:, 0]], dim=1)
    assert ((flow(z, z) - quarter).norm(dim=1) < 0.05 * z.norm(dim=1)).all()


def test_its_networks_and_prior_are_the_paper_s_of_the_task(
    fleeting: Trial, small: Baselines
) -> None:
    paper = Method(nets=Nets(width=48, depth=2), vae=Vae(beta=0.03))
    flow = find("FlowTranslation")(fleeting.toy.spec, small, 0, paper=paper)
    built, theirs = flow.build()["model"], WorldModel(fleeting.toy.spec, paper)
    assert built.method.nets == paper.nets and built.method.vae == paper.vae
    for part in ("encoder", "decoder", "blind", "classifier"):
        shapes, expected = (
            {name: value.shape for name, value in getattr(of, part).state_dict().items()}
            for of in (built, theirs)
        )
        assert shapes == expected


@pytest.mark.long
def test_translates(fleeting: Trial, small: Baselines) -> None:
    flow = fleeting.fitted("FlowTranslation", small)
    error = fleeting.error(flow.predict(fleeting.test))
    assert error < 0.5 * fleeting.error(fleeting.test.sim_next)
    # and it is the flow that does it
    torch.nn.init.zeros_(flow.nets["model"].to_real.net[-1].weight)
    torch.nn.init.zeros_(flow.nets["model"].to_real.net[-1].bias)
    assert error < 0.7 * fleeting.error(flow.predict(fleeting.test))


def test_the_best_look_is_kept(fleeting: Trial, small: Baselines) -> None:
    flow = find("FlowTranslation")(fleeting.toy.spec, replace(small, steps=40), 0)
    looks: list[dict[str, torch.Tensor]] = []

    def worse_and_worse() -> float:
        looks.append(copy.deepcopy(flow.nets.state_dict()))
        return float(len(looks))

    flow.score = lambda: worse_and_worse  # type: ignore[method-assign]
    flow.train(fleeting.sim, fleeting.real)
    kept = flow.nets.state_dict()
    assert len(looks) == 10
    assert all(torch.equal(kept[name], value) for name, value in looks[0].items())
    assert not all(torch.equal(kept[name], value) for name, value in looks[-1].items())
