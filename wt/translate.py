"""Simulation → reality on tensors: the one function that evaluation, export and deploy share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from wt.nets.world_model import WorldModel


def translate_state(
    model: WorldModel,
    o: Float[Tensor, "batch obs"],
    a: Float[Tensor, "batch action"],
    sim_next: Float[Tensor, "batch state"],
) -> Float[Tensor, "batch state"]:
    """Answer of R where S went to ``sim_next`` (equation "pipeline" of the paper).

    Encode the simulator's transition, translate its feature, decode it as R's outcome:

        z = E(o, a, o′_S),  ẑ = G(z),  o′_{S→R} = D(o, a, ẑ).

    With ``translation.anchored`` the simulator's own outcome is the starting point and only the
    difference that translation makes is added, D(o, a, ẑ) − D(o, a, z), so that what encoder
    and decoder lose is not lost in o′.

    With ``mean.simulator: blend`` a regressor that reads S's outcome has its share of each channel.

    With ``translation.reach`` the simulator's answer stands where (o, a) is so far from all that
    was seen, as where a robot falls.

    Args:
        model: a trained model.
        o: observations, physical units.
        a: actions, physical units.
        sim_next: S's state channels after the step, physical units.

    Returns:
        R's state channels after the step, physical units.
    """
    frame = model.frame
    x, sim_change, nominal, y, z = _encoded(model, o, a, sim_next)
    translated = model.decoder(x, model.to_real(z, x))
    if model.method.translation.anchored:
        y_real = y + model.strength * (translated - model.decoder(x, z))
    else:
        y_real = translated
    change = nominal + frame.shift_change(x, sim_change) + y_real
    if frame.reader is not None:
        change = change + frame.trusted * (frame.read_change(x, sim_change) - change)
    reach = model.method.translation.reach
    if reach:
        change = torch.where(frame.within(x, reach)[:, None], change, sim_change)
    return frame.next_states(o, change)


@torch.no_grad()
def translated(
    model: WorldModel,
    o: Float[np.ndarray, "batch obs"],
    a: Float[np.ndarray, "batch action"],
    sim_next: Float[np.ndarray, "batch state"],
) -> Float32[np.ndarray, "batch state"]:
    """:func:`translate_state` on arrays."""
    given = (torch.tensor(np.asarray(x, np.float32)) for x in (o, a, sim_next))
    out: np.ndarray = translate_state(model, *given).cpu().numpy()
    return out


def hidden_shift(
    model: WorldModel,
    o: Float[Tensor, "batch obs"],
    a: Float[Tensor, "batch action"],
    sim_next: Float[Tensor, "batch state"],
    hidden: Float[Tensor, "batch hidden"],
) -> Float[Tensor, "batch hidden"]:
    """What R's hidden variables are beyond S's after a step that both began with the same.

    Zero beyond ``translation.reach``, as where the simulator's answer stands, and for a model that
    says nothing of what is hidden.

    Args:
        model: a trained model.
        o: observations, physical units.
        a: actions, physical units.
        sim_next: S's state channels after the step, physical units.
        hidden: hidden variables before the step, physical units.
    """
    frame, reach = model.frame, model.method.translation.reach
    if frame.hidden is None:
        return torch.zeros_like(hidden)
    x = frame.conditions(o, a)
    shift: Tensor = frame.hidden(x, frame.changes(o, sim_next), hidden)
    return torch.where(frame.within(x, reach)[:, None], shift, 0.0) if reach else shift


@torch.no_grad()
def carried(
    model: WorldModel,
    o: Float[np.ndarray, "row obs"],
    a: Float[np.ndarray, "row action"],
    sim_next: Float[np.ndarray, "row state"],
    before: Float[np.ndarray, "row hidden"],
    after: Float[np.ndarray, "row hidden"],
) -> Float[np.ndarray, "row hidden"]:
    """Hidden variables after a step as R would have them, from S's: :func:`hidden_shift` on arrays.

    Args:
        model: a trained model.
        o: observations, physical units.
        a: actions.
        sim_next: S's state channels after the step.
        before: hidden variables before it.
        after: S's after it.
    """
    if not model.frame.carries:
        return after
    given = (torch.tensor(np.asarray(x, np.float32)) for x in (o, a, sim_next, before))
    return after + hidden_shift(model, *given).cpu().numpy()


def reconstruct_state(
    model: WorldModel,
    o: Float[Tensor, "batch obs"],
    a: Float[Tensor, "batch action"],
    s_next: Float[Tensor, "batch state"],
) -> Float[Tensor, "batch state"]:
    """D(o, a, E(o, a, o′_R)): what is left of R's own outcome when it is encoded and decoded.

    No translation can be nearer to R than this in the mean, unless it is anchored; arguments as
    :func:`feature_of_real`'s.
    """
    frame = model.frame
    x = frame.conditions(o, a)
    shift = frame.shift_of_real(x, frame.changes(o, s_next))
    feature = feature_of_real(model, o, a, s_next)
    change = frame.nominal_change(x) + shift + model.decoder(x, feature)
    return frame.next_states(o, change)


def feature_of_real(
    model: WorldModel,
    o: Float[Tensor, "batch obs"],
    a: Float[Tensor, "batch action"],
    s_next: Float[Tensor, "batch state"],
) -> Float[Tensor, "batch latent"]:
    """Feature z of a transition of R: the mean of E(o, a, o′_R), as in training.

    Args:
        model: a trained model.
        o: observations, physical units.
        a: actions, physical units.
        s_next: R's state channels after the step, physical units.
    """
    frame = model.frame
    x, change = frame.conditions(o, a), frame.changes(o, s_next)
    left = change - frame.nominal_change(x) - frame.shift_of_real(x, change)
    feature: Tensor = model.encoder(x, left)[0]
    return feature


def translated_feature(
    model: WorldModel,
    o: Float[Tensor, "batch obs"],
    a: Float[Tensor, "batch action"],
    sim_next: Float[Tensor, "batch state"],
) -> Float[Tensor, "batch latent"]:
    """Translated feature ẑ = G(z) of a transition of S, as R's should be; arguments as above."""
    x, _, _, _, z = _encoded(model, o, a, sim_next)
    feature: Tensor = model.to_real(z, x)
    return feature


class _Encoded(NamedTuple):
    """A transition of S, normalised.

    Attributes:
        x: (o, a).
        change: of S's state.
        nominal: the part of it that needs no translation, n(o, a).
        y: the rest, moved to where R's is.
        z: its feature.
    """

    x: Float[Tensor, "batch condition"]
    change: Float[Tensor, "batch state"]
    nominal: Float[Tensor, "batch state"]
    y: Float[Tensor, "batch state"]
    z: Float[Tensor, "batch latent"]


def _encoded(
    model: WorldModel,
    o: Float[Tensor, "batch obs"],
    a: Float[Tensor, "batch action"],
    sim_next: Float[Tensor, "batch state"],
) -> _Encoded:
    """Transitions with which translation begins; arguments as :func:`translate_state`'s."""
    frame = model.frame
    x, change = frame.conditions(o, a), frame.changes(o, sim_next)
    nominal = frame.nominal_change(x)
    y = (change - nominal) @ frame.transport.T
    return _Encoded(x, change, nominal, y, model.encoder(x, y)[0])


class SimToReal(nn.Module):
    """(o, a, o′ of S) → o′ of R as one module, for export.

    Channels of o′ beyond the state (the last action, …) do not depend on the domain and are
    handed through.
    """

    def __init__(self, model: WorldModel) -> None:
        """Wrap a trained model; its parameters are shared, not copied."""
        super().__init__()
        self.model = model

    def forward(
        self,
        o: Float[Tensor, "batch obs"],
        a: Float[Tensor, "batch action"],
        o_next_sim: Float[Tensor, "batch obs"],
    ) -> Float[Tensor, "batch obs"]:
        """The whole next observation of R, physical units."""
        n = self.model.spec.n_state
        state = translate_state(self.model, o, a, o_next_sim[:, :n])
        return torch.cat([state, o_next_sim[:, n:]], dim=-1)


class Exported(SimToReal):
    """The same with the features behind it, as further outputs of the exported graph.

    Given what is hidden before the step, it also says by how much R's is beyond S's after it.
    """

    def forward(  # type: ignore[override]
        self,
        o: Float[Tensor, "batch obs"],
        a: Float[Tensor, "batch action"],
        o_next_sim: Float[Tensor, "batch obs"],
        hidden: Float[Tensor, "batch hidden"] | None = None,
    ) -> tuple[Tensor, ...]:
        """o′ of R; z of the transition, where it is one of R; ẑ, where it is one of S.

        With ``hidden`` a fourth, :func:`hidden_shift`.
        """
        state = o_next_sim[:, : self.model.spec.n_state]
        answers = (
            super().forward(o, a, o_next_sim),
            feature_of_real(self.model, o, a, state),
            translated_feature(self.model, o, a, state),
        )
        if hidden is None:
            return answers
        return *answers, hidden_shift(self.model, o, a, state, hidden)
