"""The price of an effect: log-likelihood, and a share of some joint's error, that it must earn."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis


def erring_joints(objective: Objective, assessed: Assessed) -> list[int]:
    """Degrees of freedom whose replays err by more than noise and imperfect laws."""
    return [
        int(d) for d in np.flatnonzero(np.sqrt(assessed.mse) > THRESHOLDS.clean * objective.floor)
    ]


def erring(
    assessed: Assessed, objective: Objective, surely: Container[str] = ()
) -> dict[str, float]:
    """Joints whose replays err by much, with their shares of it.

    Args:
        assessed: a hypothesis.
        objective: replays.
        surely: joints of which any error beyond noise counts, however small beside their motion.
    """
    # a very quiet sensor sees the model's tolerances: these alone are no mismatch
    left, moved = np.sqrt(assessed.mse), np.nanstd(objective.measured, axis=0)
    names = objective.scene.joints
    share = np.array([0.0 if name in surely else THRESHOLDS.mismatch for name in names])
    large = (left > THRESHOLDS.clean * objective.floor) & (left > share * moved)
    size = np.where(large, (left / objective.noise) ** 2, 0.0)
    return {names[j]: float(size[j] / size.sum()) for j in np.flatnonzero(large)}


def room(objective: Objective, now: Assessed) -> float:
    """Nats by which a hypothesis that leaves the smallest error would be ahead."""
    return -float(objective.count @ np.log(objective.floor)) - now.loglik


def excess(objective: Objective, now: Assessed) -> Float[np.ndarray, " dof"]:
    """Mean square error of each degree of freedom over that of its noise."""
    return np.asarray(now.mse / objective.floor**2)


def improvable(objective: Objective, now: Assessed) -> list[int]:
    """Degrees of freedom of whose error an addition could remove the share that it must."""
    drop = 1.0 - objective.floor**2 / now.mse
    return [int(d) for d in np.flatnonzero(drop > THRESHOLDS.min_drop)]


def exhausted(objective: Objective, now: Assessed) -> bool:
    """Tell whether no addition could earn its place: even one that leaves the smallest error."""
    return room(objective, now) < THRESHOLDS.min_nats or not improvable(objective, now)


def simplest(objective: Objective, fits: Sequence[Assessed], now: Assessed) -> Assessed:
    """The best fit, or one as good as it with fewer parameters.

    A law that contains another (load-dependent friction and Coulomb's) always fits a little
    better; it has to earn its further parameters as any effect has.
    """
    top = worth(objective, fits[0], now)
    close = [f for f in fits if worth(objective, f, now) > top - THRESHOLDS.min_nats]
    # none is close where even the best exploded
    return min(close, key=lambda fit: size(fit.hypothesis)) if close else fits[0]


def size(hypothesis: Hypothesis) -> int:
    """Number of figures that were chosen for it."""
    return sum(p.effect.n_free for p in hypothesis)


def price(objective: Objective, hypothesis: Hypothesis) -> float:
    """Half a log of the sample count for each parameter (Schwarz, 1978), and prior odds."""
    return odds_against(hypothesis) + 0.5 * size(hypothesis) * float(
        np.log(max(objective.count.sum(), 2.0))
    )


def odds_against(hypothesis: Hypothesis) -> float:
    """Log odds against its effects beside more common ones [nats]: of no recording's saying."""
    return sum((p.effect.odds_against for p in hypothesis), 0.0)


def worth(objective: Objective, fit: Assessed, now: Assessed) -> float:
    """Nats gained by a hypothesis over the present one, after the price of its parameters.

    None are, if recordings contradict an effect of it. One that they contradict in the present one,
    too, stands on both sides and tells nothing of the others.
    """
    contradicted = {p.key for p in fit.hypothesis if not p.possible(objective.motion)}
    if contradicted - {p.key for p in now.hypothesis if not p.possible(objective.motion)}:
        return -np.inf
    added = price(objective, fit.hypothesis) - price(objective, now.hypothesis)
    return fit.loglik - now.loglik - added


def earns(objective: Objective, fit: Assessed, now: Assessed) -> bool:
    """Tell whether a hypothesis earns its place in place of the present one."""
    drop = 1.0 - fit.mse / now.mse
    return worth(objective, fit, now) > THRESHOLDS.min_nats and bool(
        (drop > THRESHOLDS.min_drop).any()
    )


def merit(objective: Objective, fit: Assessed) -> float:
    """Log-likelihood of a hypothesis less all that its effects must earn [nats].

    That is the price of their parameters and the least gain of each: adding an effect that earns
    its place raises it, and so does leaving one out that does not.
    """
    due = THRESHOLDS.min_nats * len(fit.hypothesis)
    return fit.loglik - price(objective, fit.hypothesis) - due
