"""Features that a trained model makes of both domains' transitions, before and after translation.

Probes (tables I and II), the latent-space picture and the errors of table III all look at these.
Features are posterior means, as they are when a model is deployed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from wt.losses.gan import distance
from wt.nets.mlp import CHUNK
from wt.nets.world_model import WorldModel
from wt.train.batches import DomainData, in_frame
from wt.types import Domain, Transitions


@dataclass(frozen=True)
class Features:
    """One domain's transitions as a model sees them.

    Attributes:
        domain: where they come from, S or R.
        condition: normalised (o, a).
        outcome: normalised change of the state.
        z: dynamics features.
        across: translated to the other domain.
        back: and back again.
        kept: G of the *own* domain applied to z, which should change nothing.
        hidden: the hidden variable, physical units.
        episode: episode of each transition.
    """

    domain: Domain
    condition: Float[np.ndarray, "row condition"]
    outcome: Float[np.ndarray, "row state"]
    z: Float[np.ndarray, "row latent"]
    across: Float[np.ndarray, "row latent"]
    back: Float[np.ndarray, "row latent"]
    kept: Float[np.ndarray, "row latent"]
    hidden: Float[np.ndarray, "row hidden"]
    episode: Int[np.ndarray, " row"]

    @property
    def cycle_error(self) -> float:
        """‖z − G(G(z))‖₁ per channel: what the way there and back loses (table III)."""
        return float(distance(torch.tensor(self.z), torch.tensor(self.back)))

    @property
    def identity_error(self) -> float:
        """‖z − G(z)‖₁ per channel, G into the own domain: needless change (table III)."""
        return float(distance(torch.tensor(self.z), torch.tensor(self.kept)))


@torch.no_grad()
def features(model: WorldModel, sim: Transitions, real: Transitions) -> tuple[Features, Features]:
    """Features of transitions of S and of R.

    Args:
        model: a trained model.
        sim: transitions of S.
        real: transitions of R, unpaired with the others.
    """
    data = in_frame(model.frame, sim, real)
    return _features(model, "sim", data[0], sim), _features(model, "real", data[1], real)


def _features(model: WorldModel, domain: Domain, data: DomainData, raw: Transitions) -> Features:
    there, back = model.to_real, model.to_sim
    if domain == "real":
        there, back = back, there
    parts = []
    for x, y in zip(data.x.split(CHUNK), data.y.split(CHUNK), strict=True):
        z, _ = model.encoder(x, y)
        across = there(z, x)
        parts.append((z, across, back(across, x), back(z, x)))
    z, across, again, kept = (_joined(column) for column in zip(*parts, strict=True))
    # the outcome as it was, not what a mean field leaves of it
    outcome = (raw.s_next - raw.o[:, : model.spec.n_state]) / model.frame.change.std.numpy()
    return Features(
        domain, data.x.numpy(), outcome, z, across, again, kept, raw.hidden, raw.episode
    )


def _joined(parts: tuple[Tensor, ...]) -> Float[np.ndarray, "row latent"]:
    return torch.cat(parts).numpy()


def whole_episodes(data: Transitions, count: int) -> Transitions:
    """At most ``count`` transitions, in whole episodes from the first on."""
    if len(data) <= count:
        return data
    last = data.episode[count]
    rows = np.flatnonzero(data.episode < last)
    return data.select(rows if len(rows) else np.arange(count))
