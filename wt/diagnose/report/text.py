"""A diagnosis in sentences and figures, the same on the terminal and in the report."""

from __future__ import annotations

import html
import math
import textwrap
from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from wt.diagnose.evidence import Interval, MeasuredForce
from wt.diagnose.result import Decision, Diagnosis, Error, Estimate, Finding
from wt.errors import UserError
from wt.show.text import NBSP, tied

if TYPE_CHECKING:
    from rich.console import Console

    from wt.check.finding import AuditFinding
    from wt.diagnose.report.verify import Verified

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TINY_P = 1e-12
_NO_END = 1e6  # in any unit, and a thousand times the value: where an interval has no upper end
_NOUNS = ("friction", "payload", "force")  # that an effect's id has before what qualifies them
_PROPER = ("coulomb", "stribeck")
_MOST_SPANS = 6
PLURAL = {"rad": "hinges", "m": "slides"}


def sentences(diagnosis: Diagnosis) -> tuple[str, ...]:
    """The findings, one plain sentence each; also if there are none, or none is understood."""
    audit = [audited(f) for f in diagnosis.audit]
    if any(f.voids_commands for f in diagnosis.audit):
        return (*audit, "What the model leaves out cannot be told without the commands.")
    words = [f.statement for f in diagnosis.findings]
    if diagnosis.verdict == "no_mismatch":
        words.append(
            f"Nothing {'else ' if audit else ''}is missing: these recordings show no physics that "
            "the model leaves out."
        )
    elif not words:
        words.append(
            f"Something is missing{_where(diagnosis)}, and what it is could not be told: no known "
            "effect explains it on data that it was not fitted to."
        )
    elif diagnosis.verdict == "unexplained":
        depends = " and what it depends on" if any(f.depends_on for f in diagnosis.findings) else ""
        words.append(f"The cause is not known: this names where it acts{depends}.")
    elif diagnosis.verdict == "partly_explained":
        words.append("That is not all: a part of the mismatch is left over.")
    return (*audit, *words)


def audited(finding: AuditFinding) -> str:
    """An audit's finding in one sentence, with what was done about it."""
    what = "what follows is of the corrected data" if finding.mended else f"to do: {finding.fix}"
    return f"{finding.evidence}; {what}."


_TOLERATED = (
    " The rest is no more than what any model is off by: a few per cent of masses, damping, rotors "
    "and drives, and steps of time."
)


def fit(diagnosis: Diagnosis) -> str:
    """The held-out fit in one sentence or two."""
    said, noises = [], []
    stays = percent(diagnosis.proof.holdout.ratio) == percent(1.0)
    for h, of in overall(diagnosis):
        factor, unit = scaled(max(h.before, h.after), of)
        left = f" to {error(h.after * factor, h.noise_floor * factor)}"
        falls = diagnosis.findings and not stays
        change = f"{number(h.before * factor)}{left if falls else ''} {unit}"
        whose = f" ({PLURAL[of]})" if len(diagnosis.compared) > 1 else ""
        said.append(change + whose)
        noises.append(f"{number(h.noise_floor * factor, 2)} {unit}")
    noise = f"measurement noise alone would give {' and '.join(noises)}"
    if not diagnosis.findings:
        beyond = any(h.before > 2.0 * h.noise_floor for h, _ in overall(diagnosis))
        rest = _TOLERATED if beyond and diagnosis.verdict == "no_mismatch" else ""
        return f"The replay's error on held-out data is {' and '.join(said)}; {noise}.{rest}"
    if stays:
        return (
            f"The replay's error on held-out data stays at {' and '.join(said)}, since what was "
            f"found does not show in it; {noise}."
        )
    moved = "fell" if diagnosis.proof.holdout.ratio < 1.0 else "rose"
    return (
        f"The replay's error on held-out data {moved} from {' and from '.join(said)}, to "
        f"{ratio(diagnosis.proof.holdout)}; {noise}.{by_files(diagnosis)}"
    )


def files(diagnosis: Diagnosis) -> str:
    """What a user has to load."""
    return "model.xml and physics.py" if diagnosis.physics_py else "model.xml"


def by_files(diagnosis: Diagnosis) -> str:
    """What each of the files leaves; "" if ``model.xml`` is all there is."""
    alone, both = diagnosis.proof.model_only, diagnosis.proof.holdout
    if diagnosis.physics_py is None or alone is None:
        return ""
    return (
        f" Of that error model.xml alone leaves {percent(alone.ratio)} %, with physics.py "
        f"{percent(both.ratio)} %."
    )


def overall(diagnosis: Diagnosis) -> list[tuple[Error, str]]:
    """The held-out error and its unit; one of each unit where hinges and slides mix."""
    holdout, joints = diagnosis.proof.holdout, diagnosis.proof.joints
    if len(diagnosis.compared) < 2:
        return [(holdout, diagnosis.unit)]
    by_unit = []
    for unit in diagnosis.compared:
        mine = [e for j, e in joints.items() if diagnosis.unit_of(j) == unit]
        before, after, noise = (
            float(np.sqrt(np.mean(np.square(x))))
            for x in zip(*((e.before, e.after, e.noise_floor) for e in mine), strict=True)
        )
        left = after / max(before, 1e-12)
        by_unit.append((Error(before, after, noise, left, (left, left)), unit))
    return by_unit


def name_of(effect: str) -> str:
    """An effect's id as people say it: ``joint.friction_viscous`` is viscous friction."""
    words = (effect.partition(".")[2] or effect).split("_")
    words = [word.capitalize() if word in _PROPER else word for word in words]
    if words[0] in _NOUNS:
        words = [*words[1:], words[0]]
    return " ".join(words)


def short_name(diagnosis: Diagnosis, path: str) -> str:
    """A recording's file name, with as many folders as tell it from the other recordings."""
    own, others = PurePath(path).parts, {r.path for r in diagnosis.recordings} - {path}
    for length in range(1, len(own)):
        if all(PurePath(other).parts[-length:] != own[-length:] for other in others):
            return str(PurePath(*own[-length:]))
    return path


def times(diagnosis: Diagnosis, intervals: Sequence[Interval]) -> list[str]:
    """Intervals in words, one line a recording; without its name where there is only one."""
    lengths = {r.path: r.seconds for r in diagnosis.recordings if r.role == "fit"}
    lines = []
    for path in dict.fromkeys(i.recording for i in intervals):
        mine = [i for i in intervals if i.recording == path]
        digits = 1 if all(i.end - i.start >= 0.5 for i in mine) else 2
        spans = [f"{i.start:.{digits}f} to {i.end:.{digits}f} s".replace(" ", NBSP) for i in mine]
        if len(spans) > _MOST_SPANS:
            spans[_MOST_SPANS:] = [f"{len(spans) - _MOST_SPANS} more"]
        if sum(i.end - i.start for i in mine) > 0.95 * lengths.get(path, math.inf):
            spans = ["throughout"]
        name = f"{short_name(diagnosis, path)}: " if len(lengths) > 1 else ""
        lines.append(name + ", ".join(spans))
    return lines


def gained(finding: Finding) -> str:
    """A sentence on what a finding is worth on held-out data."""
    p = p_value(finding.p_value)
    chance = f"p {p if p.startswith('<') else f'= {p}'}".replace(" ", NBSP)
    if finding.lawless:
        return (
            f"The {finding.at} errs by more than noise and what any model is off by ({chance}, if "
            "these were all). No law of it is proven, and none is written."
        )
    name = name_of(finding.effect)
    return (
        f"{name[:1].upper()}{name[1:]} at {finding.at} removes {percent(finding.holdout_gain)} % "
        f"of the squared error on held-out data ({chance})."
    )


def borne_out(diagnosis: Diagnosis, finding: Finding) -> str:
    """A sentence on measured forces that speak for or against a finding; "" where none does."""
    group = finding.effect.partition(".")[0]
    # play, elasticity and the rotor lie on either side of a force, as it is measured
    if finding.effect in ("joint.backlash", "joint.elasticity", "joint.armature"):
        return ""
    near = [f for f in diagnosis.measured.forces if _near(f, group, finding.at.name)]
    expected, other = ("drive", "behind") if group == "actuator" else ("behind", "drive")
    agreeing = [f.actuator for f in near if f.side in (expected, "both")]
    opposing = [f.actuator for f in near if f.side == other]
    if bool(agreeing) == bool(opposing):
        return ""
    names = ", ".join(agreeing or opposing)
    verb = "bears this out" if agreeing else "speaks against this"
    return f"The measured force of {names} {verb}."


def _near(force: MeasuredForce, group: str, place: str) -> bool:
    """Tell whether a measured force passes through a place of a group of effects."""
    places = {"actuator": (force.actuator,), "joint": (force.joint,), "body": force.moves}
    return place in places.get(group, ())


def ratio(error: Error) -> str:
    """After over before with its interval, e.g. ``"6 % (95 % interval 5 to 8 %)"``."""
    low, high = error.ratio_ci95
    return f"{percent(error.ratio)} % (95 % interval {percent(low)} to {percent(high)} %)"


def _where(diagnosis: Diagnosis) -> str:
    return f" at {diagnosis.locations[0].at}" if diagnosis.locations else ""


VERDICTS = {
    "no_mismatch": "no mismatch",
    "explained": "explained",
    "partly_explained": "partly explained",
    "unexplained": "unexplained",
}


def number(value: float, digits: int = 3) -> str:
    """A number to some significant digits, with a true minus and powers of ten as people write."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = int(exponent)
    if -4 < power < 6:
        rounded = f"{round(value, digits - 1 - power):.{max(digits - 1 - power, 0)}f}"
        return rounded.replace("-", "−")
    return f"{mantissa}·10{str(power).translate(_SUPERSCRIPT)}".replace("-", "−")


def error(rms: float, noise: float) -> str:
    """An error; what is near the noise is not told to the last digit."""
    return number(rms, 2 if rms < 2.0 * noise else 3)


def percent(share: float) -> str:
    """A share in per cent, without the sign; what is less or more than all does not read as 100."""
    return number(100 * share, 3 if share >= 0.99 else 2)


def p_value(value: float) -> str:
    """A p-value, which is not believed below 10⁻¹²."""
    return "< 10⁻¹²" if value < _TINY_P else number(value, 2)


def scaled(largest: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which errors of positions up to ``largest`` [rad or m] read well."""
    if unit not in ("rad", "m") or not math.isfinite(largest) or largest >= 0.1:
        return 1.0, unit
    return (1e3, f"m{unit}") if largest >= 1e-4 else (1e6, f"µ{unit}")


def values_and_intervals(estimate: Estimate) -> list[tuple[str, str]]:
    """An estimate's components and their intervals, to the digits that the intervals allow."""
    values = np.atleast_1d(np.asarray(estimate.value, float))
    low, high = (np.atleast_1d(np.asarray(end, float)) for end in estimate.ci95)
    rows = [_to_precision(*x) for x in zip(values, low, high, strict=True)]
    return [(value, f"{least} … {most}") for value, least, most in rows]


def _to_precision(value: float, low: float, high: float) -> tuple[str, str, str]:
    largest = max(abs(value), abs(low), abs(high))
    width = high - low
    if largest == 0 or not all(map(math.isfinite, (value, low, high))):
        return number(value), number(low), number(high)
    if high > max(_NO_END, 1e3 * abs(value)) and value != 0.0:
        return *_to_precision(value, low, value)[:2], "∞"
    power = math.floor(math.log10(largest))
    digits = 3 if width <= 0 else power - math.floor(math.log10(width)) + 2
    digits = min(max(digits, 3), 6)
    if not -4 < power < 6:
        return number(value, digits), number(low, digits), number(high, digits)
    decimals = max(digits - 1 - power, 0)
    low_text, value_text, high_text = (
        f"{x:.{decimals}f}".replace("-", "−") for x in (low, value, high)
    )
    return value_text, low_text, high_text


def parameter_rows(findings: Sequence[Finding]) -> list[tuple[str, str, str, str, str, str, str]]:
    """(effect, place, parameter, value, unit, interval, warning), one row a component.

    What has no interval, as the times of pushes, stands in the finding's sentence alone.
    """
    rows = []
    for finding in findings:
        given = finding.parameters
        estimated = {n: e for n, e in given.items() if not np.array_equal(*e.ci95)} or given
        for name, estimate in estimated.items():
            unit = "" if estimate.unit == "-" else estimate.unit
            components = values_and_intervals(estimate)
            axes = "xyz" if len(components) == 3 else range(1, len(components) + 1)
            warning = estimate.note
            for axis, (value, interval) in zip(axes, components, strict=True):
                label = name if len(components) == 1 else f"{name} {axis}"
                seen = (value, unit, interval)
                if axis in estimate.unshown:
                    seen = ("–", "", "not shown")
                row = (finding.effect, str(finding.at), label, *seen, warning)
                rows.append(row)
                warning = ""  # said once
    return rows


def formula_said(finding: Finding) -> str:
    """How well the formula does as it is printed, beside the law that acts; "" without one."""
    if finding.formula is None or finding.formula_gain is None:
        return ""
    return (
        f"As printed it removes {percent(finding.formula_gain)} % of the squared error on held-out "
        f"data, the law of residual.onnx {percent(finding.holdout_gain)} %."
    )


def print_summary(diagnosis: Diagnosis, console: Console) -> None:
    """Print the sentences, the fit, a table of the parameters, and the notes."""

    def say(sentence: str, style: str = "") -> None:
        # rich would break lines at no-break spaces
        lines = textwrap.wrap(tied(sentence), console.width, break_long_words=False)
        text = Text("\n".join(lines).replace(NBSP, " "), style=style)
        console.print(text, soft_wrap=True)

    for sentence in sentences(diagnosis):
        say(sentence, "bold")
    say(f"{VERDICTS[diagnosis.verdict].capitalize()}. {fit(diagnosis)}")
    rows = parameter_rows(diagnosis.findings)
    if rows:
        left = 1 if console.width > 90 else 0
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, left), pad_edge=False)
        for head in ("effect", "at", "parameter"):
            table.add_column(head, overflow="fold")
        for head in ("value", "95 % interval"):
            table.add_column(head, justify="right", no_wrap=True)
        before = ("", "")
        for effect, at, name, value, unit, interval, _ in rows:
            whose = ("", "") if (effect, at) == before else (effect, at)
            table.add_row(*(Text(x) for x in (*whose, name, f"{value} {unit}", interval)))
            before = effect, at
        console.print(table)
    notes = []
    for finding in diagnosis.findings:
        known = finding.parameters.items()
        notes += [f"{finding.at}, {name}: {e.note}" for name, e in known if e.note]
        if said := formula_said(finding):
            notes.append(f"{finding.at}: {finding.formula}. {said}")
        notes += [
            f"not told apart from {c.effect} at {c.at}; would tell: {c.separating_experiment}"
            for c in finding.confusable_with
        ]
    for line in [*notes, *diagnosis.proof.left_over, *diagnosis.notes]:
        say(f"note: {line}", "dim")


def why(decisions: Sequence[Decision], place: str) -> Table:
    """Table of every decision at a place, in order of time: why this name, and not that one.

    Raises:
        UserError: nothing was considered at such a place.
    """
    places = sorted({str(d.at) for d in decisions})
    wanted = [d for d in decisions if place in (d.at.name, str(d.at))]
    if not wanted:
        known = ", ".join(places) or "none, since nothing errs"
        raise UserError(f"--why {place}: nothing was considered there; places: {known}")
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for head in ("effect", "at", "stage", "outcome"):
        table.add_column(head, overflow="fold")
    for head in ("statistic", "threshold"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("why", overflow="fold", ratio=1)
    for d in wanted:
        figure = "–" if d.statistic is None else number(d.statistic)
        outcome = "stays" if d.kept else "goes"
        cells = (d.effect, str(d.at), d.stage, outcome, figure, number(d.threshold), d.reason)
        table.add_row(*(Text(cell) for cell in cells), style="bold" if d.kept else "")
    return table


def to_html(diagnosis: Diagnosis) -> str:
    """A short summary for a notebook."""
    items = "".join(f"<li><b>{_e(s)}</b></li>" for s in sentences(diagnosis))
    rows = "".join(
        "<tr>" + "".join(f"<td>{_e(cell)}</td>" for cell in row) + "</tr>"
        for row in parameter_rows(diagnosis.findings)
    )
    names = ("effect", "at", "parameter", "value", "unit", "95 % interval", "")
    head = "".join(f"<th>{_e(name)}</th>" for name in names)
    table = f"<table><tr>{head}</tr>{rows}</table>" if rows else ""
    return f"<ul>{items}</ul><p>{_e(fit(diagnosis))}</p>{table}"


def _e(text: str) -> str:
    return html.escape(tied(text))


def verified(verification: Verified) -> str:
    """What a folder's files leave, in two or three lines."""
    factor, unit = scaled(max(verification.before, verification.model), verification.unit)

    def line(name: str, value: float, stated: float) -> str:
        share = percent(value / max(verification.before, 1e-12))
        said = f"{number(stated * factor)} {unit}"
        return f"{name}: {number(value * factor)} {unit}, {share} % (diagnosis.json: {said})"

    lines = [
        f"{verification.windows} replays of held-out recordings, {number(verification.seconds)} s "
        f"in all; the model as given errs by {number(verification.before * factor)} {unit}",
        line("model.xml alone", verification.model, verification.stated_model),
    ]
    if verification.has_physics:
        lines.append(line("with physics.py", verification.physics, verification.stated_physics))
    return "\n".join(lines)
