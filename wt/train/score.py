"""A model's single-step predictions and their errors, on pairs and on what is held out."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from wt.nets.world_model import WorldModel
from wt.train.phases import ACTIVE
from wt.train.selection import Selection
from wt.translate import feature_of_real, reconstruct_state, translate_state
from wt.types import Pairs

CHUNK = 16384


class PairTensors(NamedTuple):
    """Pairs as tensors, with the scales that errors are measured in.

    Attributes:
        o: observations, (N, n_obs).
        a: actions, (N, n_action).
        sim_next: S's next state, (N, n_state).
        real_next: R's next state, (N, n_state).
        state_std: standard deviation of R's next state in the training data, (n_state,).
        change_std: standard deviation of R's one-step change there, (n_state,).
    """

    o: Tensor
    a: Tensor
    sim_next: Tensor
    real_next: Tensor
    state_std: Tensor
    change_std: Tensor

    @classmethod
    def of(cls, pairs: Pairs, state_std: Tensor, change_std: Tensor) -> PairTensors:
        """Tensors of numpy pairs."""
        real = pairs.real
        o, a, sim_next, real_next = (
            torch.tensor(x) for x in (real.o, real.a, pairs.sim_next, real.s_next)
        )
        return cls(o, a, sim_next, real_next, state_std, change_std)


@torch.no_grad()
def predictions(model: WorldModel, pairs: PairTensors) -> Tensor:
    """R's next state as the model translates it from S's, (N, n_state)."""
    chunks = zip(
        pairs.o.split(CHUNK), pairs.a.split(CHUNK), pairs.sim_next.split(CHUNK), strict=True
    )
    return torch.cat([translate_state(model, *chunk) for chunk in chunks])


@torch.no_grad()
def reconstructions(model: WorldModel, pairs: PairTensors) -> Tensor:
    """R's next state encoded and decoded, (N, n_state)."""
    chunks = zip(
        pairs.o.split(CHUNK), pairs.a.split(CHUNK), pairs.real_next.split(CHUNK), strict=True
    )
    return torch.cat([reconstruct_state(model, *chunk) for chunk in chunks])


@torch.no_grad()
def active_latents(model: WorldModel, pairs: PairTensors) -> int:
    """Latents whose means vary among R's transitions (:data:`wt.train.phases.ACTIVE`)."""
    chunks = zip(
        pairs.o.split(CHUNK), pairs.a.split(CHUNK), pairs.real_next.split(CHUNK), strict=True
    )
    z = torch.cat([feature_of_real(model, *chunk) for chunk in chunks])
    return int((z.var(dim=0) > ACTIVE).sum())


def score(model: WorldModel, selection: Selection) -> float:
    """Error of a model's translation on the data that choose."""
    std, change_std = model.frame.state.std, model.frame.change.std
    tensors = PairTensors.of(selection.translated, std, change_std)
    return selection.error(predictions(model, tensors))


def errors(model: WorldModel, pairs: PairTensors) -> tuple[float, float]:
    """Mean squared error on normalised o′ and on the normalised change."""
    error = predictions(model, pairs) - pairs.real_next
    mse = ((error / pairs.state_std) ** 2).mean()
    return float(mse), float(((error / pairs.change_std) ** 2).mean())
