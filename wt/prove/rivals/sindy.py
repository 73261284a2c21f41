"""Sparse regression on the residual of inverse dynamics (S. Brunton et al., SINDy, PNAS 2016).

Joint by joint, the force that the model lacks is regressed on a library of terms with pysindy's
sequentially thresholded least squares. The threshold is the largest whose error on the last
quarter of the data is within a few per cent of the best. Terms that are physics of the vocabulary
are said as such, others as an unknown force with its formula.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float

from wt.errors import WorkError
from wt.physics.motion import Motion
from wt.prove.rivals.base import Claim, RivalTask
from wt.types import Location

_THRESHOLDS = np.geomspace(0.003, 0.5, 12)
"""Of coefficients, the residual and the terms being scaled to unit size."""
_RIDGE = 1e-3
"""For terms that resemble each other."""
_AS_GOOD = 1.02
_WORTH = 0.05
"""Share of a joint's residual that a formula must explain to be said."""
_SMOOTH = 0.02
"""Speed over which a sign is rounded [rad/s]."""

EFFECTS = {
    "-tanh(v)": "joint.friction_coulomb",
    "-v": "joint.friction_viscous",
    "-v|v|": "joint.friction_quadratic",
    "-a": "joint.armature",
}
"""Terms that are an effect by themselves; the spring and the bias need more than a name."""


def claims(task: RivalTask) -> list[Claim]:
    """Claims of all joints, those first that explain most of their joint's residual."""
    try:
        import pysindy
    except ImportError as error:
        raise WorkError("pysindy is not installed; install it: pip install '.[rivals]'") from error
    ranked: list[tuple[float, Claim]] = []
    for dof, joint in enumerate(task.scene.joints):
        names, terms = library(task.motion, dof)
        force = task.motion.residual[:, dof]
        size, scale = np.sqrt((terms**2).mean(axis=0)) + 1e-12, float(force.std()) + 1e-12
        coefficients = _sparse(pysindy, terms / size, force / scale) * scale / size
        ranked += _said(task, joint, names, terms, force, coefficients)
    return [claim for _, claim in sorted(ranked, key=lambda pair: -pair[0])]


def library(motion: Motion, dof: int) -> tuple[list[str], Float[np.ndarray, "sample term"]]:
    """Names and values of the terms at a joint.

    The drive's force is not among them: with it and what the bodies demand, the residual would be
    explained by its own definition.
    """
    q, v, a = motion.q[:, dof], motion.v[:, dof], motion.a[:, dof]
    terms = {
        "1": np.ones_like(q), "q": -q, "-v": -v, "-v|v|": -v * np.abs(v), "-a": -a,
        "-tanh(v)": -np.tanh(v / _SMOOTH), "q²": q * q, "q³": q**3, "qv": q * v,
    }  # fmt: skip
    return list(terms), np.stack(list(terms.values()), axis=1)


def _sparse(
    pysindy: object, terms: Float[np.ndarray, "sample term"], force: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " term"]:
    """Coefficients of the terms."""
    cut = int(0.75 * len(force))
    fits = []
    for threshold in _THRESHOLDS:
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=_RIDGE)  # type: ignore[attr-defined]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns of every threshold that leaves nothing
            optimizer.fit(terms[:cut], force[:cut, None])
        coefficients = np.ravel(optimizer.coef_)
        error = float(np.mean((force[cut:] - terms[cut:] @ coefficients) ** 2))
        fits.append((error, coefficients))
    best = min(error for error, _ in fits)
    return next(c for error, c in reversed(fits) if error <= _AS_GOOD * best)


def _said(
    task: RivalTask,
    joint: str,
    names: list[str],
    terms: Float[np.ndarray, "sample term"],
    force: Float[np.ndarray, " sample"],
    coefficients: Float[np.ndarray, " term"],
) -> Iterator[tuple[float, Claim]]:
    """Each active term as a claim, with the share of the residual that it explains."""
    active = np.flatnonzero(coefficients)
    if not active.size:
        return
    sigma = _deviations(terms, force, coefficients)
    weight = {names[i]: float(coefficients[i]) for i in active}
    error = {names[i]: float(s) for i, s in zip(active, sigma, strict=True)}
    total = float(np.mean(force**2)) + 1e-30
    worth = {names[i]: float(np.mean((coefficients[i] * terms[:, i]) ** 2)) / total for i in active}
    at, other = Location("joint", joint), {}
    drive = next((d.name for d in task.scene.drives if d.joint == joint), "")
    for name, value in weight.items():
        if worth[name] < _WORTH:
            continue
        claim = _named(name, weight, np.array([error[name]]), at, drive)
        if claim is not None:
            yield worth[name], claim
        elif name != "1" or not drive:
            other[name] = value
    if other:
        formula = " + ".join(f"{value:.3g}·{name}" for name, value in other.items())
        nothing = np.zeros(0)
        share = max(worth[name] for name in other)
        yield share, Claim("unknown", at, nothing, nothing, formula)


def _named(
    name: str,
    weight: Mapping[str, float],
    sigma: Float[np.ndarray, " 1"],
    at: Location,
    drive: str,
) -> Claim | None:
    """A term as an effect of the vocabulary; None if it is none, or belongs to the spring's."""
    value = weight[name]
    if name in EFFECTS and value > 0.0:
        return Claim(EFFECTS[name], at, np.array([value]), sigma)
    if name == "q" and value > 0.0:
        theta = np.array([value, weight.get("1", 0.0) / value])
        return Claim("joint.stiffness", at, theta, np.append(sigma, 0.05))
    if name == "1" and drive and "q" not in weight:
        return Claim("actuator.bias", Location("actuator", drive), np.array([value]), sigma)
    return None


def _deviations(
    terms: Float[np.ndarray, "sample term"],
    force: Float[np.ndarray, " sample"],
    coefficients: Float[np.ndarray, " term"],
) -> Float[np.ndarray, " active"]:
    """Standard deviations of the coefficients that are not zero."""
    left = force - terms @ coefficients
    chosen = terms[:, np.flatnonzero(coefficients)]
    inverse = np.linalg.pinv(chosen.T @ chosen)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 0.0)) * float(left.std()))
