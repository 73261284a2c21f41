"""The second half of Algorithm 1 by itself, on observations or on features that are given.

On observations it is the ablation that the paper shows to collapse (section "Translation in Latent
Space"): generators map (o, a, o′) of one domain to o′ of the other, and discriminators see whole
transitions, so that what (o, a) gives away of the domain is theirs for free. On features, which
the discriminators see without (o, a), it is the paper's translation with a finished encoder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from wt.config import Method
from wt.nets.translator import Translator
from wt.train import phases
from wt.train.batches import DomainData, Held, StepBatches
from wt.train.regression import Progress


class OutcomeTranslator(Translator):
    """Generators and discriminators on whatever stands in the place of features."""

    def __init__(self, outcome: int, condition: int, method: Method) -> None:
        """Build the networks.

        Args:
            outcome: channels of what is translated.
            condition: channels of (o, a), which all networks see; 0 for none.
            method: sizes and weights.
        """
        super().__init__()
        settings = replace(method.translation, conditioned=condition > 0)
        self._translating(outcome, condition, replace(method, translation=settings))


@dataclass(frozen=True)
class Curves:
    """Losses while a translator trains, one value a row.

    Attributes:
        step: optimizer steps done.
        generator: adversarial loss of both generators.
        discriminator: loss of both discriminators.
        accuracy: share that the discriminators tell apart [-]; 0.5 is chance.
    """

    step: Sequence[int]
    generator: Sequence[float]
    discriminator: Sequence[float]
    accuracy: Sequence[float]


def train_translation(
    model: OutcomeTranslator,
    sim: DomainData,
    real: DomainData,
    seed: int,
    progress: Progress | None = None,
) -> Curves:
    """Train a translator in place, with the losses, rates and budget of its method.

    Args:
        model: an untrained translator.
        sim: transitions of S; ``y`` is what is translated.
        real: transitions of R.
        seed: of the batches.
        progress: called with (done, total) steps.
    """
    train = model.method.train
    generators, discriminators = (
        torch.optim.Adam(
            [p for net in nets for p in net.parameters()],
            lr=train.gan_learning_rate,
            betas=(0.5, 0.9),
        )
        for nets in (
            (model.to_real, model.to_sim),
            (model.discriminator_real, model.discriminator_sim),
        )
    )
    batches = StepBatches(Held(sim), Held(real), train.batch, model.method.nets.latent, seed)
    steps: list[int] = []
    losses: dict[str, list[float]] = {"generator": [], "discriminator": [], "accuracy": []}
    for step in range(train.steps):
        data = batches.at(step).gan
        y_sim, y_real = data[0].y, data[1].y
        loss, metrics, fakes = phases.generators(model, data, y_sim, y_real)
        _update(generators, loss)
        loss, more = phases.discriminators(model, data, y_sim, y_real, fakes)
        _update(discriminators, loss)
        if (step + 1) % train.log_every == 0:
            steps.append(step + 1)
            for name, values in losses.items():
                values.append(float((metrics | more)[f"gan/{name}"].detach()))
            if progress:
                progress(step + 1, train.steps)
    model.eval()
    return Curves(steps, **losses)


def _update(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    # the generators' loss reaches through the discriminators: only its own parameters may move
    loss.backward(inputs=optimizer.param_groups[0]["params"])
    optimizer.step()
