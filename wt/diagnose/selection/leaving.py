"""Which of several weak effects leave at once."""

from __future__ import annotations

from collections.abc import Sequence

from wt.diagnose.likelihood.objective import Objective
from wt.physics.planted import Hypothesis


def weakest_of_each(objective: Objective, hypothesis: Hypothesis, weak: Sequence[int]) -> list[int]:
    """The first of some effects, and that of each other joint where drives hold a machine.

    What one joint lacks is not what another does there, so that what leaves one says nothing of
    what is at another. Elsewhere each has to be asked anew once another has left.

    Args:
        objective: whose machine.
        hypothesis: effects.
        weak: indices of some of them, weakest first.
    """
    if not objective.forgets:
        return list(weak[:1])
    of_joint: dict[int, int] = {}
    for i in weak:
        of_joint.setdefault(objective.scene.dof_at(hypothesis[i].at), i)
    return [i for dof, i in of_joint.items() if dof >= 0 or i == weak[0]]
