"""Before a name is claimed: does a force without a name explain the same joint much better?

The best library law always fits something. Whether it is the law is seen by comparing it with a
regression on positions, velocities and time that may take any shape, or have a hidden state, and
must predict blocks of time it has not seen: where the law is right, it cannot be beaten by much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt.diagnose.assessed import Hypothesis
from wt.diagnose.leftover import leftover
from wt.diagnose.memory import recorded
from wt.diagnose.remainder_choice import freest
from wt.diagnose.remainder_fit import Data
from wt.diagnose.scoring import STRIDE, WINDOW
from wt.diagnose.screen import Screen
from wt.diagnose.signature import signature
from wt.physics.scene import Scene
from wt.types import Location

Array = np.ndarray

DOUBTFUL = 0.6
"""Below this :attr:`Rivalry.ratio` a name is given up; the module's test holds how it was set."""


@dataclass(frozen=True)
class Rivalry:
    """A named effect against a nonparametric force of the same joint.

    Attributes:
        ratio: mean square of what the nonparametric force leaves when it predicts blocks it has
            not seen, over what the named effect leaves; both at least the noise floor's. 1 if the
            named effect leaves only noise.
        nats: log-likelihood by which the nonparametric force is ahead.
        r2: share of the joint's force that the named effect explains.
        depends_on: columns of the nonparametric force.
    """

    ratio: float
    nats: float
    r2: float
    depends_on: tuple[str, ...]


def rivals_nonparametric(
    screen: Screen, hypothesis: Hypothesis, index: int, *, seed: int = 0, step: float = 1e-3
) -> Rivalry | None:
    """Compare one effect of a hypothesis with a force of any shape at its joint.

    Args:
        screen: the fitted recordings.
        hypothesis: the accepted effects.
        index: which of them.
        seed: of the folds.
        step: coarsest physics step of replays [s].

    Returns:
        None where the comparison says nothing: the effect is not at one joint, or has no
        signature in forces (gear play, elasticity, sensors).
    """
    planted = hypothesis[index]
    joint = _joint(screen.motion.scene, planted.at)
    if joint is None or signature(screen.motion, planted) is None:
        return None
    dof = screen.motion.scene.dof(joint)
    rest = leftover(screen, hypothesis)
    rows = rest.keep[:, dof]
    data = Data(screen, joint, rest.without(index)[:, dof], rows, seed, step)
    fit, _ = freest(data)
    count, floor = len(data.force), float(screen.floor[dof]) ** 2
    named = max(float(np.mean(rest.left[rows, dof] ** 2)), floor)
    free = max(float(fit.error.sum()) / count, floor)
    total = max(float(np.mean(data.force**2)), floor)
    nats = 0.5 * count * STRIDE / WINDOW * float(np.log(named / free))
    return Rivalry(free / named, nats, 1.0 - named / total, recorded(fit.names))


def _joint(scene: Scene, at: Location) -> str | None:
    """The one joint that a place acts on."""
    if at.kind == "joint":
        return at.name
    if at.kind == "actuator":
        return scene.drive(at.name).joint
    return None
