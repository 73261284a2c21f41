"""Laws whose further parameters nobody needs give way to the simpler law that they contain.

The search compares laws by how well they fit, and the larger one may fit better for a reason that
is not its own: it moves through standstill in another way, say. What it was estimated to be tells:
where the simpler law lies inside its intervals, that one is said.
"""

from __future__ import annotations

from wt.diagnose.addition import Accepted
from wt.diagnose.estimate import Estimated, estimate
from wt.diagnose.objective import Objective
from wt.diagnose.worth import erring_joints
from wt.physics.effect import effects
from wt.physics.planted import Planted


def simplified(
    objective: Objective, accepted: tuple[Accepted, ...], estimated: Estimated
) -> tuple[tuple[Accepted, ...], Estimated]:
    """The same effects by the simplest laws that leave no more to explain.

    Args:
        objective: replays of the fitted recordings.
        accepted: effects.
        estimated: their parameters.
    """
    for i, planted in enumerate(estimated.hypothesis):
        intervals = {name: e.ci95 for name, e in estimated.estimates[i].items()}
        found = planted.simpler(objective.motion, intervals)
        if found is None:
            continue
        law = Planted(effects()[found[0]], planted.at, found[1])
        others = tuple(law if k == i else p for k, p in enumerate(estimated.hypothesis))
        again = estimate(objective, others)
        before, after = (erring_joints(objective, e.assessed) for e in (estimated, again))
        if set(after) <= set(before):
            now = _by(law, accepted[i], objective)
            accepted = (*accepted[:i], now, *accepted[i + 1 :])
            estimated = again
    return accepted, estimated


def _by(law: Planted, before: Accepted, objective: Objective) -> Accepted:
    """An effect by another law, which is no rival of itself."""
    return Accepted(
        planted=law,
        shape=next(iter(law.effect.shapes(objective.motion, law.at)), None),
        rivals=tuple(r for r in before.rivals if r.key != law.key),
    )
