"""``mujoco.sysid`` as an engineer uses it who does not know what is missing."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.physics.effect import effects
from wt.prove.rivals.base import SURE, Claim, RivalTask
from wt.prove.sysid_rival import Fitted, Free, Rival, every_parameter
from wt.types import Location

THREADS = 1
"""Of each fit, as each of our diagnoses in a trial has one: cases run side by side."""
_AT_ONCE = 0.25
"""Share of the parameters that are dropped in one round of BIC, the weakest."""


def every(task: RivalTask) -> list[Claim]:
    """All parameters are fitted; claimed are those whose 95 % interval leaves the nominal out."""
    rival = Rival(task.model, task.fit, THREADS)
    fitted = rival.fit(every_parameter(rival.scene), seconds=task.left)
    claims = sorted(_claims(fitted), key=lambda pair: -pair[0])
    return [claim for strength, claim in claims if strength > SURE]


def bic(task: RivalTask) -> list[Claim]:
    """The same, and parameters are dropped, weakest first, as long as BIC falls and time lasts."""
    rival = Rival(task.model, task.fit, THREADS)
    best = rival.fit(every_parameter(rival.scene), seconds=task.left)
    many = True
    while best.theta and task.left > best.seconds:
        order = sorted(_claims(best), key=lambda pair: pair[0])
        drop = max(1, int(_AT_ONCE * len(order))) if many else 1
        kept: list[Free] = [(claim.effect, claim.at.name) for _, claim in order[drop:]]
        if not kept:
            break
        fewer = rival.fit(kept, seconds=task.left)
        if fewer.bic < best.bic:
            best = fewer
        elif drop == 1:
            break
        else:
            many = False
    return [claim for _, claim in sorted(_claims(best), key=lambda pair: -pair[0])]


def _claims(fitted: Fitted) -> list[tuple[float, Claim]]:
    """Each parameter, and how many standard deviations it is from the nominal."""
    sigma = _deviations(fitted)
    claims: list[tuple[float, Claim]] = []
    known = effects()
    for (name, place), theta in fitted.theta.items():
        nominal = 1.0 if name == "actuator.gain" else 0.0
        s = sigma[len(claims)]
        claim = Claim(name, Location(known[name].kind, place), theta, np.array([s]))
        claims.append((abs(float(theta[0]) - nominal) / s, claim))
    return claims


def _deviations(fitted: Fitted) -> Float[np.ndarray, " parameter"]:
    """Standard deviations of the parameters: errors independent, one variance for each joint."""
    variance = fitted.squares / np.maximum(fitted.count, 1)
    weight = np.tile(1.0 / np.maximum(variance, 1e-30), len(fitted.jacobian) // variance.size)
    information = (fitted.jacobian * weight[:, None]).T @ fitted.jacobian
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    inverse = np.linalg.pinv(information / np.outer(scale, scale))
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 1e-30)) / scale)
