"""Candidates: hypotheses worth a replay, by the screen or since only replays can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Hashable, Sequence
from dataclasses import replace

import numpy as np

from wt.diagnose.likelihood.bic import erring_joints, excess, improvable
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.residual.screen import Scored, Screen
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.acting import is_live
from wt.physics.effect import Shape, alternatives, effects, forms_of
from wt.physics.planted import Planted
from wt.types import Location

Start = tuple[Planted, Shape | None]
"""Parameters to start from, and the shape of the signature if there is one."""

WORST = 2
"""At so many joints, those whose replays err most, every effect of theirs is replayed."""
KEPT = 10
"""At most so many of the screen's hypotheses are replayed in a round."""
EACH = 2
"""… and so many at each joint: another joint may just be worse."""


def candidates(
    screen: Screen,
    ranked: Sequence[Scored],
    objective: Objective,
    now: Assessed,
) -> list[Start]:
    """Additions to the present hypothesis that a replay should judge.

    Args:
        screen: the force residual.
        ranked: its hypotheses, best first.
        objective: the replays.
        now: the present hypothesis, assessed.

    Returns:
        Effects with their starting parameters, and the shape of their signature if they have one.
    """
    strong = _strong(screen, ranked)
    if screen.motion.scene.free:  # all joints err where one does: the force residual knows which
        places = [dof_of(screen, s.planted.at) for s in strong]
        erring, worst = [], [d for d in dict.fromkeys(places) if d >= 0][:WORST]
    else:
        erring, worst = erring_joints(objective, now), _worst(objective, now)
        if len(erring) > 1:
            often = [s for s in ranked if s.planted.effect.common == "often" and s not in strong]
            strong += often[:1]
    chosen = _chosen(screen, ranked, strong, worst, erring)
    proposals: list[Start] = [(s.planted, s.shape) for s in chosen]
    for s in chosen:
        effect = s.planted.effect
        starts = effect.starts(screen.motion, s.planted.at)
        proposals += [(replace(s.planted, theta=theta), s.shape) for theta in starts]
        others = [form for form in forms_of(effect) if form is not effect]
        proposals += [(replace(s.planted, effect=form), s.shape) for form in others]
    proposals += [(p, None) for p in _replay_only(screen, worst)]
    somewhere = (-1, *improvable(objective, now))
    return [
        (p, shape)
        for p, shape in proposals
        if dof_of(screen, p.at) in somewhere and not any(excluded(p, q) for q in now.hypothesis)
    ]


def _worst(objective: Objective, now: Assessed) -> list[int]:
    """Joints whose replays err most: where forces show nothing, every effect gets its chance."""
    over = excess(objective, now)
    return [int(d) for d in np.argsort(-over)[:WORST] if over[d] > 2.0]


def _chosen(
    screen: Screen,
    ranked: Sequence[Scored],
    strong: Sequence[Scored],
    worst: Container[int],
    erring: Container[int],
) -> list[Scored]:
    """The strong ones, then their lookalikes, what is cheap at the worst joints, and the usual."""
    wanted = {pair for s in strong for pair in lookalikes(screen, s.planted)}
    chosen = {s.planted.key: s for s in strong}
    for s in ranked:
        effect, at = s.planted.effect, s.planted.at
        dof = dof_of(screen, at)
        cheap = not is_live(effect) and dof in worst
        usual = effect.common == "always" and dof in erring
        if (effect.id, at) in wanted or cheap or usual:
            chosen.setdefault(s.planted.key, s)
    return list(chosen.values())


def lookalikes(screen: Screen, planted: Planted) -> set[tuple[str, Location]]:
    """What an effect may be taken for: ids of alternatives, at its place and close to it."""
    places = near(screen, planted.at)
    return {(name, at) for name in alternatives(planted.effect.id) for at in places}


def _strong(screen: Screen, ranked: Sequence[Scored]) -> list[Scored]:
    """Hypotheses that gain much by the force residual, and the first at each joint and at several.

    What acts on several, as a load does, is spread over them, and behind what each has alone.
    """
    best = ranked[0].gain if ranked else 0.0
    floating = bool(screen.motion.scene.free)
    share, least = THRESHOLDS.replay_share, THRESHOLDS.replay_nats
    if floating:
        share = THRESHOLDS.replay_share_floating
        least = max(least, share * best)
    # what acts on one link of a floating base shows on all: not only the first effect counts
    first = _first_of_each(ranked, lambda s: s.planted.effect.id) if floating else ranked
    strong = [s for s in first[:KEPT] if s.gain >= share * best and s.gain > 0.0]
    others = [s for s in ranked if s not in strong and s.gain > least]
    if floating:
        others = [s for s in others if dof_of(screen, s.planted.at) >= 0]
    return strong + _first_of_each(others, lambda s: dof_of(screen, s.planted.at))


def _first_of_each(ranked: Sequence[Scored], label: Callable[[Scored], Hashable]) -> list[Scored]:
    """The first few with each label, in the order of a ranking."""
    count: Counter[Hashable] = Counter()
    firsts = []
    for s in ranked:
        count[label(s)] += 1
        if count[label(s)] <= EACH:
            firsts.append(s)
    return firsts


def near(screen: Screen, at: Location) -> list[Location]:
    """Places that may be at fault instead: a joint, its drives and link; a link and the next.

    For the world every link.
    """
    scene = screen.motion.scene
    m = scene.model
    if at.kind == "world":
        return [at, *(Location("body", name) for name in scene.moving)]
    if at.kind == "body" and at.name != "all":
        body = m.body(at.name).id
        ids = {name: m.body(name).id for name in scene.moving}
        close = [n for n, i in ids.items() if body in (i, m.body_parentid[i])]
        close += [n for n, i in ids.items() if i == m.body_parentid[body]]
        joints = [name for name in scene.joints if m.joint(name).bodyid[0] == body]
        return [Location("body", n) for n in close] + [Location("joint", n) for n in joints]
    dof = dof_of(screen, at)
    drives = [Location("actuator", d.name) for d in scene.drives if d.dof == dof]
    joints = [name for name in scene.joints if scene.dof(name) == dof]
    links = [Location("body", m.body(m.joint(n).bodyid[0]).name) for n in joints]
    every = [Location("sensor", "all"), Location("actuator", "all")]
    return [at, *drives, *(Location("joint", n) for n in joints), *links, *every]


def excluded(one: Planted, other: Planted) -> bool:
    """True if two effects cannot stand beside each other: they are the same, or say the same."""
    same = one.at == other.at
    return one.key == other.key or (
        same and (one.effect.id in other.effect.excludes or other.effect.id in one.effect.excludes)
    )


def _replay_only(screen: Screen, worst: Sequence[int]) -> list[Planted]:
    """Effects without a signature: at the joints whose replay is worst, and of contacts."""
    scene = screen.motion.scene
    proposals = []
    for effect in effects().values():
        for at in effect.places(scene):
            somewhere = at.kind in ("geom", "world") or dof_of(screen, at) in worst
            if somewhere and not effect.shapes(screen.motion, at):
                proposals += [
                    Planted(effect, at, start) for start in effect.starts(screen.motion, at)
                ]
    return proposals


def dof_of(screen: Screen, at: Location) -> int:
    """Degree of freedom that a place acts on alone; −1 if several."""
    return screen.motion.scene.dof_at(at)
