"""``check.html``: what an audit found, and each channel against the model's own replay."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from wt.check.files import Audited, merged
from wt.check.finding import AuditFinding
from wt.physics.scene import Scene
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
    assert each.given is not None and each.corrected is not None and each.path is not None
    recording = each.given
    replayed = replay(scene, each.corrected) if scene is not None else {}
    t = each.corrected.t - each.corrected.t[0]
    figures = []
    for name, column in recording.columns.items():
        if not name.startswith("qpos/") or name.rpartition("/")[2].isdigit():
            continue
        wrong = [f for f in each.findings if name in f.columns and f.sure]
        corrected = each.corrected.columns.get(name)
        series = [Series("before", recording.t - recording.t[0], column)]
        if len(recording) != len(t) or not np.array_equal(recording.t, each.corrected.t):
            series = [Series("before", t, corrected)] if corrected is not None else []
        said = [f"{name} as recorded"]
        if name in replayed:
            series.append(Series("after", t, replayed[name]))
            said.append("the model's replay of the commands")
        shown = [Series(s.css, s.x[s.x <= _MOST_S], s.y[s.x <= _MOST_S]) for s in series]
        if not any(np.isfinite(s.y).any() for s in shown):
            continue
        title = " and ".join(said) + ("; " + wrong[0].kind.replace("_", " ") if wrong else "")
        figures.append(
            f"<figure>{chart(shown, Axes(x='time [s]', y=name, alt=title))}"
            f"<figcaption>{escaped(title)}</figcaption></figure>"
        )
    keys = '<p><span class="key before">recorded</span><span class="key after">replay</span></p>'
    body = f'{keys}<div class="grid">{"".join(figures)}</div>'
    return section(each.path.name, "", body) if figures else ""


def replay(scene: Scene, recording: Recording) -> dict[str, Float[np.ndarray, " sample"]]:
    """Positions that the model takes under a recording's commands, by column.

    A machine that is held by servos runs through; any other is started anew from the recording,
    or its errors would grow without end.
    """
    m = scene.model
    missing = [j for j in scene.joints if f"qpos/{j}" not in recording.columns]
    unsent = [
        i for i in range(m.nactuator) if f"ctrl/{m.actuator(i).name}" not in recording.columns
    ]
    if scene.free or missing or unsent:
        return {}
    t = recording.t - recording.t[0]
    last = int(np.searchsorted(t, _MOST_S))
    q = np.stack([_filled(t, recording.columns[f"qpos/{j}"]) for j in scene.joints], axis=1)
    names = [f"ctrl/{m.actuator(i).name}" for i in range(m.nactuator)]
    u = np.stack([recording.columns[n] for n in names], axis=1) if names else np.zeros((len(t), 0))
    v = np.gradient(q, t, axis=0)
    all_servos = {d.joint for d in scene.drives if d.servo} >= set(scene.joints)
    d = mujoco.MjData(m)
    out = np.full(q.shape, np.nan)
    start = 0.0
    for k in range(min(last, len(t))):
        if k == 0 or (not all_servos and t[k] - start >= _RESTART_S):
            mujoco.mj_resetData(m, d)
            d.qpos[:], d.qvel[:], start = q[k], v[k], t[k]
        out[k] = d.qpos
        d.ctrl[:] = np.nan_to_num(u[k])
        if k + 1 < len(t):
            for _ in range(min(round((t[k + 1] - t[k]) / m.opt.timestep), 1000)):
                mujoco.mj_step(m, d)
    return {f"qpos/{j}": out[:, i] for i, j in enumerate(scene.joints)}


def _filled(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    ok = np.isfinite(x)
    return np.interp(t, t[ok], x[ok]) if ok.any() else np.zeros_like(t)
