"""Online adaptation: Algorithm 1 goes on while the robot is in use, on what it does now.

New transitions of R come in without any of S beside them, which unpaired training does not need:
S's are the old ones. The paper names this as future work.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import torch
from torch import Tensor, nn

from wt.nets.simulator_use import use_of
from wt.nets.world_model import WorldModel
from wt.train import phases
from wt.train.batches import Held, StepBatch, StepBatches, in_frame
from wt.train.device import seeded
from wt.train.mean_field import samples, shift_loss
from wt.types import Transitions

BETAS = (0.5, 0.9)


class OnlineAdaptation:
    """A model that keeps learning from a stream of transitions of R.

    Attributes:
        model: as it is now, in evaluation mode; the model that was given is left alone.
    """

    def __init__(self, model: WorldModel, sim: Transitions, seed: int) -> None:
        """Start from a trained model.

        Args:
            model: a trained model; ``method.online`` says how much it adapts.
            sim: transitions of S, those of its training.
            seed: same seed and stream, same adaptation.
        """
        self.model = copy.deepcopy(model).eval()
        self._seed, self._seen = seed, 0
        # what S did stays as it was: framed once, with one row of it for where both are asked for
        self._row = sim.select(np.arange(1))
        self._sim, _ = in_frame(self.model.frame, sim, self._row)
        self._stream: list[Transitions] = []
        m, rate = self.model, model.method.online.learning_rate
        groups: list[list[nn.Module]] = [
            [m.encoder, m.decoder, m.classifier],
            [m.blind],
            [m.to_real, m.to_sim],
            [m.discriminator_real, m.discriminator_sim],
        ]
        parameters = [[p for net in group for p in net.parameters()] for group in groups]
        for group in parameters:
            for p in group:
                p.requires_grad_(True)
        self._optimizers = [
            torch.optim.Adam(group, lr=rate, betas=BETAS if i > 1 else (0.9, 0.999))
            for i, group in enumerate(parameters)
        ]
        self._shift = None
        # where S encodes what is hidden, δ stays: of a stream nothing is estimated
        self._encoded = use_of(model.method.mean).asks_simulator
        if m.frame.shift is not None and not self._encoded:
            m.frame.shift.requires_grad_(True)
            self._shift = torch.optim.Adam(m.frame.shift.parameters(), lr=rate)

    def learn(self, new: Transitions) -> None:
        """Take in what R just did, and train on it and on what is remembered of the stream.

        Args:
            new: transitions of R, in order.
        """
        online = self.model.method.online
        if not online.iterations:
            return
        # what is not estimated is read off R's outcome itself, as in use
        self._stream.append(replace(new, nominal=new.s_next) if self._encoded else new)
        while sum(map(len, self._stream)) - len(self._stream[0]) >= online.memory:
            self._stream.pop(0)
        self._seen += 1
        if self._shift is not None:
            self._follow_shift(self._shift)
        frame, method = self.model.frame, self.model.method
        _, real = in_frame(frame, self._row, _joined(self._stream))
        feeds = Held(self._sim), Held(real)
        batches = StepBatches(*feeds, method.train.batch, method.nets.latent, self._seed)
        for step in range(online.iterations):
            self._iterate(batches.at(self._seen * online.iterations + step))

    def _iterate(self, batch: StepBatch) -> None:
        """One iteration of Algorithm 1."""
        for optimizer, loss in zip(
            self._optimizers, phases.iteration(self.model, batch, {}), strict=True
        ):
            _update(optimizer, loss)

    def _follow_shift(self, optimizer: torch.optim.Optimizer) -> None:
        """Let δ follow: it carries what nothing hidden decides, wherever there is a mean field."""
        frame, mean, online = self.model.frame, self.model.method.mean, self.model.method.online
        seen = samples(frame, _joined(self._stream))
        reference = use_of(mean).reference(lambda x: frame.nominal_change(x).detach(), seen)
        target = seen.change - reference
        loss, generator = shift_loss(mean), seeded(self._seed + self._seen)
        for _ in range(online.iterations):
            rows = torch.randint(len(target), (mean.batch,), generator=generator)
            error = frame.shift_change(seen.x[rows], reference[rows]) - target[rows]
            _update(optimizer, loss(error, 0.0))


def _joined(parts: Sequence[Transitions]) -> Transitions:
    """The parts of a stream as one; which episode each is of does not matter here."""
    columns = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts])
        for f in fields(Transitions)
    }
    return Transitions(**columns)


def _update(optimizer: torch.optim.Optimizer, loss: Tensor) -> None:
    optimizer.zero_grad()
    loss.backward(inputs=optimizer.param_groups[0]["params"])
    optimizer.step()
