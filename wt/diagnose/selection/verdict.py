"""Verdict in one word, and the findings for people.

Where nothing was found and replays still err by much, that is reported without a law.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.stats import chi2

from wt.diagnose.likelihood.bic import erring
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.result import Confusable, Diagnosis, Finding, Located, Verdict
from wt.diagnose.selection.claims import Claims
from wt.diagnose.stop import stopped
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.force import Unknown
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

_UNPREDICTED = "nothing recorded predicts."
_SOMETIMES = "acts in {:.2g} s of what was recorded, far more than at other times."
_UNPROVEN = "Held-out replays prove no law of it."
_NOT_LOOKED_FOR = "the search had not named when it was ended."


def left_over(claims: Claims, objective: Objective) -> tuple[Finding, ...]:
    """What is left at joints that err although nothing was found: where, and on what it depends."""
    left, where = claims.estimated.assessed, claims.unexplained(objective)
    return unforeseen(left, objective, where, "", claims.suspected, claims.moments)


def unforeseen(
    assessed: Assessed,
    objective: Objective,
    where: Mapping[str, float],
    that: str = "",
    suspected: Sequence[Unknown] = (),
    moments: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Finding, ...]:
    """At joints that err: something unknown, without a law.

    Args:
        assessed: what was found.
        objective: replays of all fitted data.
        where: joint → share of the error. What one foot meets shows on all joints of a machine
            that nothing holds: there, the fewest are named that bear most of it.
        that: what is said of it; that nothing predicts it, or was yet found to, if left out.
        suspected: laws that predict it, none of them proven.
        moments: joint → seconds in which it acts, where it does not always.
    """
    by_law = {u.planted.at.name: u for u in suspected}
    that = that or (_NOT_LOOKED_FOR if stopped() else _UNPREDICTED)
    by_place: dict[Location, Finding] = {}
    for joint in bearing(where, THRESHOLDS.bearing_share) if objective.scene.free else where:
        dof, at = objective.scene.dof(joint), objective.scene.place(joint)
        excess = float(assessed.mse[dof] / objective.noise[dof] ** 2)
        count = float(objective.count[dof])
        # of noise alone being as large
        chance = float(chi2.sf(excess * count, count))
        when, law = moments.get(joint), by_law.get(joint)
        what = _SOMETIMES.format(when) if when and not stopped() else that
        depends_on = law.depends_on if law else ("t",) if when else ()
        by_place.setdefault(at, _nameless(at, what, chance, law, depends_on))
    return tuple(by_place.values())


def shown_by_holdout(
    diagnosis: Diagnosis,
    assessed: Assessed,
    replays: Objective,
    surely: Container[str] = (),
) -> Diagnosis:
    """A diagnosis that leaves nothing open, unless the held-out recordings do.

    What only they show was not searched, so that it has no name; but nothing is missing only where
    every replay says so, and all is explained only where it is in all of them.

    Args:
        diagnosis: of the fitted recordings.
        assessed: what was found, on the held-out ones.
        replays: replays of these.
        surely: joints of which any error beyond noise counts.
    """
    where = erring(assessed, replays, surely)
    if not where or diagnosis.verdict not in ("no_mismatch", "explained"):
        return diagnosis
    if diagnosis.verdict == "explained":
        names = " and ".join(where)
        note = f"The held-out recordings show more at {names} than what was found: fit those too."
        return replace(diagnosis, verdict="partly_explained", notes=(*diagnosis.notes, note))
    said = "only the held-out recordings show: fit those too."
    return replace(
        diagnosis,
        verdict="unexplained",
        findings=unforeseen(assessed, replays, where, said),
        locations=tuple(Located(replays.scene.place(j), share) for j, share in where.items()),
    )


def _nameless(
    at: Location, that: str, p_value: float, law: Unknown | None, depends_on: tuple[str, ...]
) -> Finding:
    """Something unknown at a place, without a proven law; ``that`` says more of it, or one does."""
    statement = f"{at.kind.capitalize()} {at.name} is moved by something unknown that {that}"
    return Finding(
        effect="unknown",
        at=at,
        parameters={},
        statement=f"{law.statement} {_UNPROVEN}" if law else statement,
        holdout_gain=0.0,
        p_value=p_value,
        depends_on=depends_on,
    )


def bearing(shares: Mapping[str, float], most: float) -> tuple[str, ...]:
    """The fewest names whose shares come to ``most`` of all, the largest first."""
    names = sorted(shares, key=lambda name: -shares[name])
    before = np.cumsum([0.0, *(shares[name] for name in names)])
    return tuple(name for name, sum_ in zip(names, before, strict=False) if sum_ < most)


def verdict(claims: Claims, objective: Objective, others: Sequence[Finding] = ()) -> Verdict:
    """In one word, by what the findings leave in replays, in units of noise.

    Args:
        claims: what stands.
        objective: replays of all fitted data.
        others: findings that replays do not show.
    """
    if claims.unknown:
        return "partly_explained" if claims.accepted or claims.events else "unexplained"
    if not (claims.accepted or claims.events):
        if claims.unexplained(objective):
            return "unexplained"
        return "explained" if others else "no_mismatch"
    return "partly_explained" if crowded_joints(claims, objective) else "explained"


def crowded_joints(claims: Claims, objective: Objective) -> list[int]:
    """Degrees of freedom whose replays err by more than so many effects may leave.

    One may leave ``thresholds.clean`` times the smallest error; of several that share a joint, the
    excess over ``thresholds.crowded`` is divided by their number.
    """
    scene, mse = objective.scene, claims.assessed(objective).mse
    count = np.zeros(len(mse))
    for planted in (*claims.estimated.hypothesis, *(e.planted for e in claims.events)):
        dof = scene.dof_at(planted.at)
        count[slice(None) if dof < 0 else dof] += 1.0
    most, least = THRESHOLDS.clean, THRESHOLDS.crowded
    allowed = least + (most - least) / np.maximum(count, 1.0)
    return [int(d) for d in np.flatnonzero(np.sqrt(mse) > allowed * objective.floor)]


def _not_told_apart(
    planted: Planted, rivals: Sequence[Planted], scene: Scene
) -> list[tuple[str, Location]]:
    """Ids and places of what no recording could tell from an effect, then of what these do not."""
    never = planted.effect.same_as(scene, planted.at)
    return list(dict.fromkeys([*never, *((r.effect.id, r.at) for r in rivals)]))


def findings(claims: Claims, scene: Scene, experiment: str = "") -> tuple[Finding, ...]:
    """For people, the most important first.

    Args:
        claims: what stands.
        scene: the machine.
        experiment: that tells them from their rivals; by default each effect's own.
    """
    listed = [
        Finding(
            effect=planted.effect.id,
            at=planted.at,
            parameters=values,
            statement=planted.statement(scene),
            holdout_gain=gain.share,
            p_value=gain.p_value,
            confusable_with=tuple(
                Confusable(effect, at, experiment or planted.separation(scene))
                for effect, at in _not_told_apart(planted, a.rivals, scene)
            ),
            reference=planted.effect.reference,
        )
        for a, planted, values, gain in zip(
            claims.accepted,
            claims.estimated.hypothesis,
            claims.estimated.estimates,
            claims.gains,
            strict=True,
        )
    ]
    listed += [
        Finding(
            effect="unknown",
            at=u.planted.at,
            parameters={},
            statement=u.statement,
            holdout_gain=u.gain.share,
            p_value=u.gain.p_value,
            depends_on=u.depends_on,
            # one that predicts nothing says nothing, however well its law does
            formula=u.formula if u.formula_gain > 0.0 else None,
            formula_gain=u.formula_gain if u.formula_gain > 0.0 else None,
        )
        for u in claims.unknown
    ]
    listed += [
        Finding(
            effect=e.planted.effect.id,
            at=e.planted.at,
            parameters=e.estimates,
            statement=e.planted.statement(scene),
            holdout_gain=e.gain.share,
            p_value=e.gain.p_value,
            reference=e.planted.effect.reference,
        )
        for e in claims.events
    ]
    return tuple(sorted(listed, key=lambda f: -f.holdout_gain))


def suggestions(listed: Sequence[Finding]) -> tuple[str, ...]:
    """Experiments to record next, so that what was confused can be told apart."""
    experiments = [c.separating_experiment for f in listed for c in f.confusable_with]
    return tuple(dict.fromkeys(experiments))


DOUBTFUL = 0.6
"""Below this :attr:`Rivalry.ratio` a name is given up; the module's test holds how it was set."""
