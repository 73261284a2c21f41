"""What R does differently from S in what no sensor tells and yet goes on, as a trunk's velocity."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wt.nets.mlp import mlp
from wt.types import TransitionSpec

FORCES = ("N", "N·m")
"""Units of hidden variables that may be others at every step: nothing of these goes on."""


class HiddenShift(nn.Module):
    """The difference between R's hidden variables after a step and S's, which began with the same.

    A prediction that overwrites what S's sensors tell leaves its hidden variables where S, not R,
    would have them, and the longer a rollout, the farther off (``wt.train.hidden_shift`` has what
    it learns from). Without fit it is zero.

    Attributes:
        center: mean of each hidden variable, (n_hidden,), physical units.
        spread: its standard deviation.
        unit: standard deviation of the difference; 0 where nothing is told of the variable.
        gain: share of the difference that is applied, as held-out recordings of R chose it,
            (n_hidden,).
    """

    center: Tensor
    spread: Tensor
    unit: Tensor
    gain: Tensor

    def __init__(self, n_condition: int, spec: TransitionSpec, width: int, depth: int) -> None:
        """Build it unfitted.

        Args:
            n_condition: channels of the frame's (o, a).
            spec: layout of the task's transitions.
            width: of the network.
            depth: likewise.
        """
        super().__init__()
        n = len(spec.hidden)
        self.net = mlp(n_condition + spec.n_state + n, n, width, depth)
        for name, value in {"center": 0.0, "spread": 1.0, "unit": 0.0, "gain": 0.0}.items():
            self.register_buffer(name, torch.full((n,), value))

    @property
    def applied(self) -> bool:
        """Whether any variable is moved at all."""
        return bool(self.gain.any())

    def inputs(
        self,
        x: Float[Tensor, "batch condition"],
        sim_change: Float[Tensor, "batch state"],
        hidden: Float[Tensor, "batch hidden"],
    ) -> Float[Tensor, "batch input"]:
        """What the network reads; of variables that nothing tells, nothing."""
        known = (hidden - self.center) / self.spread * (self.unit > 0)
        return torch.cat([x, sim_change, known], dim=-1)

    def forward(
        self,
        x: Float[Tensor, "batch condition"],
        sim_change: Float[Tensor, "batch state"],
        hidden: Float[Tensor, "batch hidden"],
    ) -> Float[Tensor, "batch hidden"]:
        """What is added to S's hidden variables after a step, physical units.

        Args:
            x: normalised (o, a).
            sim_change: S's normalised change of the state.
            hidden: hidden variables before the step, physical units.
        """
        out: Tensor = self.gain * self.unit * self.net(self.inputs(x, sim_change, hidden))
        return out


def goes_on(spec: TransitionSpec) -> bool:
    """Whether any hidden variable of a task is more than a force of the moment."""
    return any(channel.unit not in FORCES for channel in spec.hidden)
