"""What a machine is worth: steps and seconds of its replays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wt.physics.scene import Scene

STEP_S = 5e-4
"""Fine physics step of replays [s]; the model's own, if that is smaller."""


@dataclass(frozen=True)
class Effort:
    """Steps and seconds of replays.

    Attributes:
        step: fine physics step [s]; the model's own, if that is smaller.
        search_step: … and while hypotheses are compared.
        search_s: at most so many seconds of recordings are replayed while these are compared.
        doubt_s: … while each of what was found is compared with its lookalikes.
        most_s: … and to estimate.
        judge_s: … and to prove each effect, of those held out.
        proof_s: … and to measure how much better all of them together do.
    """

    step: float
    search_step: float
    search_s: float
    doubt_s: float
    most_s: float
    judge_s: float
    proof_s: float


FIXED = Effort(STEP_S, 1e-3, 16.0, 60.0, 60.0, 60.0, np.inf)
FLOATING = Effort(1e-3, 1e-3, 5.0, 8.0, 16.0, 16.0, 16.0)
"""Steps with contacts cost several times as much, and there are many more of them to choose."""


def effort_of(scene: Scene) -> Effort:
    """What a machine is worth, in steps that are no longer than the model's own."""
    effort = FLOATING if scene.free else FIXED
    own = float(scene.model.opt.timestep)
    return replace(effort, step=min(effort.step, own), search_step=min(effort.search_step, own))
