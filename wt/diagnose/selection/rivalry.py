"""Rivalry: a named effect against a nonparametric force of the same joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt.diagnose.residual.scoring import STRIDE, WINDOW
from wt.diagnose.residual.screen import Screen, leftover
from wt.diagnose.residual.signature import signature
from wt.diagnose.unknown.choice import freest
from wt.diagnose.unknown.fit import ForceData
from wt.diagnose.unknown.memory import recorded
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene
from wt.types import Location


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
        signature in forces (gear play, elasticity, sensors). Of what acts at times that were read
        off the recordings it is asked wherever it is: at the joint where it shows most.
    """
    planted, scene = hypothesis[index], screen.motion.scene
    joint = joint_of(scene, planted.at)
    if (joint is None and not planted.observed()) or signature(screen.motion, planted) is None:
        return None
    rest = leftover(screen, hypothesis)
    if joint is None:
        shown = np.mean(rest.parts[index] ** 2, axis=0) / screen.floor**2
        joint = scene.joints[int(np.argmax(shown))]
    dof = scene.dof(joint)
    rows = rest.keep[:, dof]
    data = ForceData(screen, joint, rest.without(index)[:, dof], rows, seed, step)
    fit, _ = freest(data)
    count, floor = len(data.force), float(screen.floor[dof]) ** 2
    named = max(float(np.mean(rest.left[rows, dof] ** 2)), floor)
    free = max(float(fit.error.sum()) / count, floor)
    total = max(float(np.mean(data.force**2)), floor)
    nats = 0.5 * count * STRIDE / WINDOW * float(np.log(named / free))
    return Rivalry(free / named, nats, 1.0 - named / total, recorded(fit.names))


def joint_of(scene: Scene, at: Location) -> str | None:
    """The one joint that a place acts on."""
    if at.kind == "joint":
        return at.name
    joints = {drive.joint for drive in scene.driven(at)}
    return joints.pop() if len(joints) == 1 else None
