"""``check.html``: what an audit found, and each channel against the model's own replay."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from wt.check.files import Audited, merged
from wt.check.finding import AuditFinding
from wt.data.recording import coordinate
from wt.physics.activation import activated
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.physics.units import column_unit
from wt.show.charts import Axes, Series, chart
from wt.show.page import escaped, section, table, template
from wt.types import Recording

_MOST_S = 20.0
"""Seconds of a recording that are drawn."""
_RESTART_S = 0.5
"""Machines that servos do not hold are started anew from the recording so often."""


def page(model: Path | None, audited: Sequence[Audited]) -> str:
    """The page of an audit.

    Args:
        model: the model; None if recordings were audited alone.
        audited: what was found in each recording.
    """
    names = [p.name for p in (model, *(a.path for a in audited)) if p is not None]
    findings = merged(audited)
    scene = Scene(model) if model else None
    parts = [_opening(names, findings), _table(findings)]
    parts += [_channels(scene, each) for each in audited if each.given is not None]
    return template().substitute(
        title=html.escape(f"Check of {', '.join(names)}"), shades="", body="\n".join(parts)
    )


def _opening(names: Sequence[str], findings: Sequence[AuditFinding]) -> str:
    faults = [f for f in findings if f.sure]
    lead = [f"{f.evidence}." for f in faults] or ["Nothing is wrong with what was given."]
    css, word = ("part", f"{len(faults)} found") if faults else ("good", "clean")
    lines = "".join(f"<li>{escaped(line)}</li>" for line in lead[:1])
    lines += "".join(f'<li class="more">{escaped(line)}</li>' for line in lead[1:])
    return (
        f"<header><h1>Check of <strong>{escaped(', '.join(names))}</strong></h1>"
        f'<ul class="lead">{lines}</ul><p><span class="verdict {css}">{word}</span></p></header>'
    )


def _table(findings: Sequence[AuditFinding]) -> str:
    if not findings:
        return ""
    rows = [
        f"<tr><td><code>{escaped(f.kind)}</code>{'' if f.sure else '<br>note'}</td>"
        f"<td>{escaped(', '.join(f.columns or f.elements))}</td><td>{escaped(f.evidence)}</td>"
        f"<td>{escaped(f.fix)}</td></tr>"
        for f in findings
    ]
    return section("What was found", "", table(("kind", "where", "evidence", "fix"), rows))


def _channels(scene: Scene | None, each: Audited) -> str:
    """A chart of every position, with the replay of the corrected commands where there is one."""
    assert each.path is not None
    drawn = figures(scene, each)
    return section(each.path.name, "", grid(drawn)) if drawn else ""


def grid(drawn: Mapping[str, str]) -> str:
    """Figures beside each other, under their key."""
    keys = '<p><span class="key before">recorded</span><span class="key after">replay</span></p>'
    return f'{keys}<div class="grid">{"".join(drawn.values())}</div>'


def figures(scene: Scene | None, each: Audited, kinds: Sequence[str] = ("qpos",)) -> dict[str, str]:
    """A chart of every position with the replay of the corrected commands, by column.

    Args:
        scene: the model; without it there is no replay.
        each: a recording and its audit.
        kinds: of columns; velocities have a replay too, commands none.
    """
    assert each.given is not None and each.corrected is not None
    replayed = replay(scene, each.corrected) if scene is not None else {}
    shown = [n for n in each.given.columns if n.partition("/")[0] in kinds]
    names = [n for n in shown if coordinate(n) is None]
    drawn = {name: _channel(scene, name, each, replayed.get(name)) for name in names}
    return {name: figure for name, figure in drawn.items() if figure}


def _channel(
    scene: Scene | None, name: str, each: Audited, replayed: Float[np.ndarray, " sample"] | None
) -> str:
    """The chart of one column; "" where nothing is to be seen."""
    assert each.given is not None and each.corrected is not None
    shown = each.given if np.array_equal(each.given.t, each.corrected.t) else each.corrected
    series, said = [], [f"{name} as recorded"]
    if name in shown.columns:
        series.append(_series("before", shown, shown.columns[name]))
    if replayed is not None:
        series.append(_series("after", each.corrected, replayed))
        said.append("the model's replay of the commands")
    if not any(np.isfinite(s.y).any() for s in series):
        return ""
    wrong = [f.kind for f in each.findings if name in f.columns and f.sure]
    title = "; ".join([" and ".join(said), *(kind.replace("_", " ") for kind in wrong[:1])])
    return (
        f'<figure data-channel="{escaped(name)}">'
        f"{chart(series, Axes(x='time [s]', y=f'{name}{_unit(scene, name)}', alt=title))}"
        f"<figcaption>{escaped(title)}</figcaption></figure>"
    )


def _unit(scene: Scene | None, name: str) -> str:
    """Unit that a column should have, in brackets; either one where no model says what moves."""
    either = {"qpos": "rad or m", "qvel": "rad/s or m/s"}
    unit = column_unit(scene, name) if scene else either.get(name.partition("/")[0], "")
    return f" [{unit}]" if unit else ""


def _series(css: str, recording: Recording, y: Float[np.ndarray, " sample"]) -> Series:
    t = recording.t - recording.t[0]
    return Series(css, t[t <= _MOST_S], y[t <= _MOST_S])


def replay(scene: Scene, recording: Recording) -> dict[str, Float[np.ndarray, " sample"]]:
    """Positions and velocities that the model takes under a recording's commands, by column.

    A machine that is held by servos runs through; any other is started anew from the recording,
    or its errors would grow without end. NaN where a replay explodes, and after what is drawn.
    """
    m, columns = scene.model, recording.columns
    joints = [f"qpos/{j}" for j in scene.joints]
    actuators = [f"ctrl/{m.actuator(i).name}" for i in range(m.nactuator)]
    if scene.free or any(name not in columns for name in (*joints, *actuators)):
        return {}
    t = recording.t - recording.t[0]
    q = np.stack([_filled(t, columns[name]) for name in joints], axis=1)
    u = np.stack([columns[n] for n in actuators], axis=1) if actuators else np.zeros((len(t), 0))
    v, u = np.gradient(q, t, axis=0), np.nan_to_num(u)
    rows = int(np.searchsorted(t, _MOST_S))
    held = {d.joint for d in scene.drives if d.servo} >= set(scene.joints)
    pieces = [slice(0, rows)] if held else _pieces(t[:rows])
    acted = activated(m, t, u)
    stretches = [Stretch(0, t[p], u[p], q[p][0], v[p][0], acted[p][0]) for p in pieces]
    replays = Replayer(scene, stretches, m.opt.timestep).run([()])
    replayed: dict[str, np.ndarray] = {}
    for kind, part in (("qpos", replays.q[0]), ("qvel", replays.v[0])):
        out = np.full(q.shape, np.nan)
        out[:rows] = part
        replayed |= {f"{kind}/{joint}": out[:, i] for i, joint in enumerate(scene.joints)}
    return replayed


def _pieces(t: Float[np.ndarray, " sample"]) -> list[slice]:
    """Rows of one replay after another, of two samples at least."""
    starts = range(0, len(t) - 1, max(2, round(_RESTART_S / float(np.median(np.diff(t))))))
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(t)], strict=True)]


def _filled(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    ok = np.isfinite(x)
    return np.interp(t, t[ok], x[ok]) if ok.any() else np.zeros_like(t)
