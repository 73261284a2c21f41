"""The frame that networks see the world in: normalised conditions and outcomes.

Everything that depends on the data's scale lives here, inside the model, so that an exported
graph takes and returns physical units.

The outcome that the networks encode and decode is the normalised change of the state,

    y = (o′ − o) / σ − m(o, a),

with a mean field m that the paper does not have (m = 0). With it, m is what each domain does
when nothing is hidden: n(o, a) in S and n(o, a) + δ in R, where n is a regressor of the nominal
simulator and δ the domains' difference. What is left of S may then be moved by one linear map,
the closed-form optimal transport between the two Gaussians (``transport``), before translation.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from wt.config import Mean
from wt.data.normalize import Normalizer
from wt.nets.hidden_shift import HiddenShift, goes_on
from wt.nets.mlp import Ensemble, mlp
from wt.nets.simulator_use import use_of
from wt.types import TransitionSpec


class Frame(nn.Module):
    """Normalisation, mean field and transport of one task.

    Attributes:
        spec: layout of the task's transitions.
        condition: normaliser of (o, a), the action as an offset from the joint position.
        change: normaliser of the state's change; its standard deviation is the frame's unit.
        state: normaliser of the next state in R, in which errors are reported.
        free: 1 for channels that have to be predicted, 0 for those that follow, (n_state,).
        transport: linear map of S's remaining outcome, (n_state, n_state); identity unless fit.
        nominal: regressor of the nominal simulator's change n(o, a), or None.
        shift: regressors of the domains' difference δ, or None.
        reader: regressors of what R does differently from S's answer, which they read, or None.
        hidden: difference of what is hidden after a step, where S encodes what is hidden, or None.
        imitates_nominal: n imitates the answer with nothing hidden, and not S's average one.
        trusted: share of the reader's answer in each channel of the prediction, (n_state,).
    """

    transport: Tensor
    free: Tensor
    trusted: Tensor
    _pose: Tensor
    _positions: Tensor
    _velocities: Tensor

    def __init__(self, spec: TransitionSpec, mean: Mean) -> None:
        """Build an unfitted frame; ``wt.train.mean_field`` and ``Normalizer.fit`` fill it."""
        super().__init__()
        self.spec = spec
        use = use_of(mean)
        self.reads_simulator = use.shift_reads_simulator
        self.imitates_nominal = use.imitates_nominal
        self.n_condition = spec.n_obs + spec.n_action
        self._targets = _acts_on_positions(spec)
        self.condition = Normalizer(self.n_condition)
        self.change = Normalizer(spec.n_state)
        self.state = Normalizer(spec.n_state)
        self.register_buffer("transport", torch.eye(spec.n_state))
        free = torch.ones(spec.n_state)
        free[[position for position, _ in spec.integrated]] = 0.0
        self.register_buffer("free", free)
        self.register_buffer("trusted", torch.zeros(spec.n_state))
        # indices where the networks are: a list would be copied there at every use
        integrated = zip(*spec.integrated, strict=True) if spec.integrated else ((), ())
        for name, columns in zip(
            ("_pose", "_positions", "_velocities"), (spec.pose, *integrated), strict=True
        ):
            index = torch.tensor(columns, dtype=torch.int64)
            self.register_buffer(name, index, persistent=False)
        self.nominal: nn.Module | None = None
        self.shift: Ensemble | None = None
        self.reader: Ensemble | None = None
        self.hidden: HiddenShift | None = None
        if not use.has_shift:
            return

        def regressors(reads: bool) -> Ensemble:
            inputs = self.n_condition + spec.n_state * reads
            size = (inputs, spec.n_state, mean.width, mean.depth)
            return Ensemble([mlp(*size) for _ in range(mean.members)])

        self.shift = regressors(self.reads_simulator)
        if use.has_reader:
            self.reader = regressors(True)
        if use.has_nominal:
            self.nominal = mlp(self.n_condition, spec.n_state, mean.width, mean.depth)
        if use.asks_simulator and goes_on(spec):
            self.hidden = HiddenShift(self.n_condition, spec, mean.width, mean.depth)
        if not use.keeps_outcome:
            self.transport.zero_()

    @property
    def carries(self) -> bool:
        """Whether it says how R's hidden variables go on beyond S's."""
        return self.hidden is not None and self.hidden.applied

    def raw_condition(
        self, o: Float[Tensor, "batch obs"], a: Float[Tensor, "batch action"]
    ) -> Float[Tensor, "batch condition"]:
        """(o, a) in physical units, joint targets as offsets from the joint positions.

        Where actions are joint targets, so are the last action and delayed samples behind the
        state: all of them are given relative to where the joints are now.
        """
        if not self._targets:
            return torch.cat([o, a], dim=-1)
        pose, n = o[:, self._pose], self.spec.n_state
        known = (self.spec.n_obs - n) // self.spec.n_action
        return torch.cat([o[:, :n], o[:, n:] - pose.repeat(1, known), a - pose], dim=-1)

    def conditions(
        self, o: Float[Tensor, "batch obs"], a: Float[Tensor, "batch action"]
    ) -> Float[Tensor, "batch condition"]:
        """Normalised (o, a)."""
        return self.condition(self.raw_condition(o, a))

    def within(self, x: Float[Tensor, "batch condition"], reach: float) -> Bool[Tensor, " batch"]:
        """True where normalised (o, a) deviate by at most ``reach`` in all channels; 0: everywhere.

        Farther from all that was seen, as where a robot falls, networks make anything of it.
        """
        return x.abs().amax(dim=1) <= (reach or torch.inf)

    def changes(
        self, o: Float[Tensor, "batch obs"], s_next: Float[Tensor, "batch state"]
    ) -> Float[Tensor, "batch state"]:
        """Change of the state in units of its standard deviation; zero stays zero.

        Channels that follow from others (``spec.integrated``) are zero: nothing is to be learned.
        """
        return (s_next - o[:, : self.spec.n_state]) / self.change.std * self.free

    def next_states(
        self, o: Float[Tensor, "batch obs"], change: Float[Tensor, "batch state"]
    ) -> Float[Tensor, "batch state"]:
        """The next state for a normalised change; inverse of :meth:`changes`."""
        state = o[:, : self.spec.n_state] + change * self.change.std
        if not self.spec.integrated:
            return state
        # q′ = q + q̇′ / rate
        moved = o[:, self._positions] + state[:, self._velocities] / self.spec.rate_hz
        return state.index_copy(1, self._positions, moved)

    def nominal_change(self, x: Float[Tensor, "batch condition"]) -> Float[Tensor, "batch state"]:
        """n(o, a): the nominal simulator's normalised change; zero without a mean field."""
        if self.nominal is None:
            # shape, not len: an exported graph keeps its batch size open
            return x.new_zeros(x.shape[0], self.spec.n_state)
        return self.nominal(x)

    def shift_change(
        self, x: Float[Tensor, "batch condition"], sim_change: Float[Tensor, "batch state"]
    ) -> Float[Tensor, "batch state"]:
        """δ: what R does differently from S when nothing is hidden; zero without a mean field.

        With the simulator ignored, the whole of what R does.

        Args:
            x: normalised (o, a).
            sim_change: the simulator's normalised change, read only if ``reads_simulator``.
        """
        if self.shift is None:
            return torch.zeros_like(sim_change)
        return self.shift(torch.cat([x, sim_change], dim=-1) if self.reads_simulator else x)

    def shift_of_real(
        self, x: Float[Tensor, "batch condition"], change: Float[Tensor, "batch state"]
    ) -> Float[Tensor, "batch state"]:
        """δ of a transition of R, of which S's answer is not known.

        Args:
            x: normalised (o, a).
            change: R's normalised change, read in the place of S's where there is no n.
        """
        return self.shift_change(x, change if self.nominal is None else self.nominal_change(x))

    def read_change(
        self, x: Float[Tensor, "batch condition"], sim_change: Float[Tensor, "batch state"]
    ) -> Float[Tensor, "batch state"]:
        """R's normalised change as the reader has it from S's, ``sim_change`` without a reader."""
        if self.reader is None:
            return sim_change
        return sim_change + self.reader(torch.cat([x, sim_change], dim=-1))


def _acts_on_positions(spec: TransitionSpec) -> bool:
    """True if actions, and all channels behind the state, are targets or samples of the pose."""
    if not spec.pose or len(spec.pose) != spec.n_action:
        return False
    units = [spec.observation[i].unit for i in spec.pose]
    known = [c.unit for c in spec.observation[spec.n_state :]]
    repeats, rest = divmod(len(known), len(units))
    return rest == 0 and [c.unit for c in spec.action] == units and known == repeats * units
