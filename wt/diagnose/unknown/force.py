"""A force that no known effect explains: what it depends on, its law, and whether it is real.

Where replays stay worse than noise allows although the accepted effects are in, the unexplained
force of a joint is regressed on what was recorded (:mod:`wt.diagnose.unknown.fit`). It becomes a
finding only if replays of recordings that it was not fitted to improve.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.stats import combine_pvalues, ttest_1samp, wilcoxon

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.steps import COARSE
from wt.diagnose.residual.screen import Screen, leftover
from wt.diagnose.selection.holdout import Gain, Holdout, errors, gain
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.choice import choose, remembers
from wt.diagnose.unknown.fit import ForceData, LawFit, crossval, solve
from wt.diagnose.unknown.formula import reduced, sparse
from wt.diagnose.unknown.law import Law
from wt.diagnose.unknown.lines import column_lines
from wt.diagnose.unknown.live import live
from wt.diagnose.unknown.memory import along, memory_of, recorded
from wt.diagnose.unknown.onnx import to_onnx
from wt.physics.effect import Parameter, Shape
from wt.physics.hooks import OnSteps
from wt.physics.live import Live
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis, Planted
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units, unit_at
from wt.types import Location

MOST_JOINTS = 3
_ROUNDS = 2
_WORSE = 0.1
_BEYOND = 0.5  # of the range seen, by which a formula is trusted beyond it, but for positions
_PEAK = 2.5


class UnknownForce(OnSteps):
    """amplitude · force(columns): a learned law that acts on one joint.

    Not registered: a search cannot try it before it is learned.

    Attributes:
        law: the force.
        sentence: its statement.
        output: its name in ``residual.onnx``.
    """

    id = "unknown"
    kind = "joint"
    parameters = (Parameter("amplitude", "-", 0.0, 2.0, 0.02),)
    reference = "learned from the recordings"
    native = False

    def __init__(self, law: Law, sentence: str, output: str = "force") -> None:
        """Wrap a law."""
        self.law, self.sentence, self.output = law, sentence, output

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """The law along a motion."""
        m = motion
        return m.on(m.scene.dof(at.name), self.law.force(along(m, self.law.columns)))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficient is the amplitude."""
        return coefficients

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Adds the force at every step."""
        return live(self.law, scene, at, theta, h)

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """The law by ``residual.onnx``, whose inputs are its columns."""
        lines, helpers = column_lines(self.law.columns)
        inside = [f"    {json.dumps(name)}: x{i}," for i, name in enumerate(self.law.columns)]
        force = (
            *lines,
            "columns = {",
            *inside,
            "}",
            f'_, _, dof = self._joint("{at.name}", qpos, qvel)',
            f'f[:, dof] += {number(theta[0])} * self._residual("{self.output}", columns)',
        )
        return Script(force=force, helpers=("joint", "residual", *helpers))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return self.sentence

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        others = ", ".join(recorded(self.law.columns))
        return f"slow and fast sweeps of {at.name} over its whole range that vary {others} alone"


@dataclass(frozen=True, eq=False)
class Unknown:
    """Something that no known effect explains.

    Attributes:
        planted: acts in replays like any other effect; its parameter is a factor, 1 as learned.
        depends_on: columns in the recording format's names.
        formula: the force in them [N·m], of few terms.
        onnx: the force that acts, as an ONNX graph; inputs are the columns of its law, float32
            (batch, 1): ``depends_on``, or what remembers them (:mod:`wt.diagnose.unknown.memory`).
        r2: share of the joint's unexplained force that is predicted in blocks of time not seen.
        statement: one sentence.
        gain: its worth on held-out recordings.
        formula_gain: share of the held-out squared error that the printed formula removes; the
            same as the law's where it is what acts.
        blank: p-value of predicting blocks of time not seen no better than by no force at all; all
            columns that were tried are paid for.
    """

    planted: Planted
    depends_on: tuple[str, ...]
    formula: str
    onnx: bytes
    r2: float
    statement: str
    gain: Gain
    formula_gain: float
    blank: float = 1.0

    @property
    def proven(self) -> bool:
        """True if held-out replays improve by it, significantly and materially."""
        significant = self.gain.p_value <= THRESHOLDS.significant
        return significant and self.gain.share >= THRESHOLDS.unknown_share

    @property
    def suspected(self) -> bool:
        """True if what moves the joint is surely no noise, whether or not this law is proven."""
        return self.blank <= THRESHOLDS.significant


def find(
    screen: Screen,
    objective: Objective,
    assessed: Assessed,
    holdout: Holdout,
    *,
    step: float,
    seed: int = 0,
) -> list[Unknown]:
    """Look for unknown forces where the accepted effects leave more than noise.

    Args:
        screen: the fitted recordings.
        objective: replays of them.
        assessed: the accepted effects.
        holdout: recordings that nothing is fitted to; they decide.
        step: physics step of replays [s].
        seed: of the folds.

    Returns:
        The best law of each joint, proven or not, the most useful first.
    """
    excess = np.sqrt(assessed.mse) / objective.floor
    rest = leftover(screen, assessed.hypothesis)
    force = np.sqrt((rest.keep * rest.left**2).sum(axis=0) / rest.keep.sum(axis=0)) / screen.floor
    force = np.where(excess > THRESHOLDS.clean, force, 0.0)
    scene = screen.motion.scene
    force[[scene.dof(j) for j in scene.joints if j not in scene.own_joints]] = 0.0
    unknowns: list[Unknown] = []
    for dof in np.argsort(-force)[:MOST_JOINTS]:
        if force[dof] < THRESHOLDS.unknown_force:
            continue
        joint = scene.joints[int(dof)]
        rows = np.ones(len(screen.rows), bool)
        data = ForceData(screen, joint, rest.left[:, dof], rows, seed, COARSE * step)
        unknown = _learn(data, assessed, holdout, step)
        if unknown:
            unknowns.append(unknown)
    return sorted(unknowns, key=lambda u: -u.gain.share)


def of_law(
    screen: Screen,
    law: Law,
    joint: str,
    rest: Hypothesis,
    holdout: Holdout,
    *,
    step: float,
    seed: int = 0,
) -> Unknown:
    """A law of recorded columns that is known already, as something unknown beside other effects.

    Args:
        screen: the fitted recordings.
        law: the force.
        joint: where it acts.
        rest: the other effects.
        holdout: recordings that nothing is fitted to.
        step: physics step of replays [s].
        seed: of the folds.
    """
    dof = screen.motion.scene.dof(joint)
    rows = np.ones(len(screen.rows), bool)
    left = leftover(screen, rest).left[:, dof]
    data = ForceData(screen, joint, left, rows, seed, COARSE * step)
    r2 = crossval(data, law.columns, law.terms, penalise=False).r2
    said = statement(data, law)
    planted = Planted(UnknownForce(law, said), Location("joint", joint), np.ones(1))
    worth = gain(holdout, (*rest, planted), rest, step)
    graph = to_onnx({"force": law})
    return Unknown(planted, law.columns, law.text(), graph, r2, said, worth, worth.share)


def graphed(hypothesis: Hypothesis) -> tuple[Hypothesis, bytes | None]:
    """A hypothesis whose learned laws have outputs of their own, and ``residual.onnx`` of them."""
    named, laws = [], dict[str, Law]()
    for p in hypothesis:
        if isinstance(p.effect, UnknownForce):
            output = f"force_{len(laws) + 1}" if laws else "force"
            laws[output] = p.effect.law
            p = replace(p, effect=UnknownForce(p.effect.law, p.effect.sentence, output))
        named.append(p)
    return tuple(named), to_onnx(laws) if laws else None


def _learn(data: ForceData, assessed: Assessed, holdout: Holdout, step: float) -> Unknown | None:
    """The best law of one joint's force, judged on held-out replays."""
    fit, tried = choose(data)
    if fit.r2 < THRESHOLDS.unknown_r2:
        return None
    formula = fit if remembers(fit) else _formula(data, fit, assessed)
    plain = formula.r2 >= THRESHOLDS.formula_share * fit.r2
    used = formula if plain else fit
    blank = float(min(1.0, tried * _chance(data, used)))
    at = Location("joint", data.joint)
    for _ in range(_ROUNDS):
        law = solve(data, used, _BEYOND * plain)
        planted = Planted(UnknownForce(law, statement(data, law)), at, np.ones(1))
        # the accepted effects and tolerances had to bear what now has a law of its own
        hypothesis = (*assessed.hypothesis, planted)
        data.force = leftover(data.screen, hypothesis).without(-1)[data.rows, data.dof]
    share, chance = _gain(holdout, hypothesis, data.dof, step)
    printed = law if plain else solve(data, formula, _BEYOND)
    said = share
    if not plain:
        spoken = Planted(UnknownForce(printed, ""), at, np.ones(1))
        said, _ = _gain(holdout, (*hypothesis[:-1], spoken), data.dof, step)
    # forces of blocks not seen and replays of recordings not seen: two proofs on other data
    sure = share > 0.0 and chance < THRESHOLDS.unknown_chance
    p_value = float(combine_pvalues([blank, chance]).pvalue) if sure else 1.0
    return Unknown(
        planted,
        recorded(used.names),
        printed.text(),
        to_onnx({"force": law}),
        used.r2,
        planted.statement(data.screen.motion.scene),
        Gain(share, p_value),
        said,
        blank,
    )


def _formula(data: ForceData, fit: LawFit, assessed: Assessed) -> LawFit:
    """The formula of the force with the tolerances' share put back, unless that fits much worse.

    The model tolerances can hide a part of the force, and a remnant has no simple formula.
    """
    taken = data.force
    rest = leftover(data.screen, assessed.hypothesis)
    options = []
    for force in ((rest.left + rest.adapted)[data.rows, data.dof], taken):
        data.force = force
        options.append(reduced(sparse(data, fit.names)))
    data.force = taken
    return options[options[1].r2 > options[0].r2 + _WORSE]


def _gain(holdout: Holdout, hypothesis: Hypothesis, dof: int, step: float) -> tuple[float, float]:
    """Share of all joints' held-out squared error that the last effect removes, and its p-value.

    The test reads the joint alone: others may have errors of their own that drown the change.
    """
    misses = errors(holdout, [hypothesis[:-1], hypothesis], step) / holdout.smoothed.noise
    if not np.isfinite(misses[1]).any() or np.isinf(np.nanmax(np.abs(misses[1]))):
        return 0.0, 1.0
    before, after = np.nansum(misses**2, axis=(1, 2))
    own = [np.sqrt(np.bincount(holdout.block, np.nan_to_num(e[:, dof]) ** 2)) for e in misses]
    return float(1.0 - after / before), _improves(own[0], own[1])


def _chance(data: ForceData, fit: LawFit) -> float:
    """p-value of predicting moments of blocks not seen no better than by no force at all."""
    sums = [np.sqrt(np.bincount(data.moment, x**2)) for x in (data.force, fit.left)]
    return _improves(sums[0], sums[1])


def _improves(before: Float[np.ndarray, " block"], after: Float[np.ndarray, " block"]) -> float:
    """p-value of blocks' errors being no smaller after than before.

    Student's test sees a few large gains, Wilcoxon's many small ones; their lesser counts twice.
    """
    tests = (
        wilcoxon(before - after, alternative="greater"),
        ttest_1samp(before - after, 0.0, alternative="greater"),
    )
    return min(1.0, 2.0 * float(np.nanmin([1.0, *(test.pvalue for test in tests)])))


def statement(data: ForceData, law: Law) -> str:
    """One sentence on a force, from how it acts along the motion."""
    m = data.screen.motion
    force = law.force(along(m, law.columns))
    power = force * m.v[:, m.scene.dof(data.joint)]
    verb = "held back" if power.sum() < -0.5 * np.abs(power).sum() else "pushed"
    words = list(dict.fromkeys(_words(name, data.joint) for name in law.columns))
    depends = words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
    sentence = f"Joint {data.joint} is {verb} by something unknown that depends on {depends}"
    near = _peak(data, law, force)
    return f"{sentence}, strongest near {near}." if near else f"{sentence}."


def _words(name: str, joint: str) -> str:
    memory = memory_of(name)
    if memory is not None:
        return (
            "how it moved before" if memory.joint == joint else f"how {memory.joint} moved before"
        )
    kind, _, place = name.partition("/")
    if kind in ("qpos", "qvel"):
        noun = "position" if kind == "qpos" else "speed"
        return f"its {noun}" if place == joint else f"the {noun} of {place}"
    return {"ctrl": "its command", "force": "its drive's force"}.get(kind, "time")


def _peak(data: ForceData, law: Law, force: Float[np.ndarray, " sample"]) -> str:
    """Position of the joint at which its force is strongest; "" where none stands out."""
    name = f"qpos/{data.joint}"
    if name not in law.columns:
        return ""
    q = data.column(name)
    low, high = np.quantile(q, [0.005, 0.995])
    edges = np.linspace(low, high, 21)
    index = np.clip(np.searchsorted(edges, q) - 1, 0, 19)
    count = np.bincount(index, minlength=20)
    size = np.bincount(index, np.abs(force), minlength=20) / np.maximum(count, 1)
    size = np.where(count >= 0.005 * len(q), size, 0.0)
    best = int(np.argmax(size))
    if size[best] < _PEAK * np.median(size):
        return ""
    # the middle of what is at least half as strong: a detent pulls on both of its sides
    near = size >= 0.5 * size[best]
    middle = 0.5 * (edges[:-1] + edges[1:])
    unit = unit_at(data.screen.motion.scene, Location("joint", data.joint), "rad")
    return f"{float(np.sum(middle * near * size) / np.sum(size * near)):.2g} {unit}"
