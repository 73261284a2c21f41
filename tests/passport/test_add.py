"""Recordings become a passport: the friction that each machine has, appended and never rewritten.

The search for effects has tests of its own; here it is told what to find, and all else is real.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.cli.main import main
from wt.data import recording as recordings
from wt.diagnose import again
from wt.diagnose.again import Recorded
from wt.errors import UserError
from wt.passport.add import add
from wt.passport.card import card
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location, Recording

RIG = """<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/>
<worldbody><body name="arm"><joint name="hinge" axis="0 1 0" damping=".1"{friction}/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="20" kv="1"/></actuator></mujoco>"""
RATE = 100
FRICTION = {"A17": 0.2, "B04": 0.5}  # N·m


def record(
    path: Path,
    friction: float,
    seed: int,
    labels: Mapping[str, str],
    seconds: int = 8,
    armature: float = 0.0,
) -> Path:
    """Some seconds of a rig with dry friction and a rotor, in plain MuJoCo."""
    rng = np.random.default_rng(seed)
    hidden = f' frictionloss="{friction}" armature="{armature}"'
    m = mujoco.MjModel.from_xml_string(RIG.format(friction=hidden))
    d = mujoco.MjData(m)
    t = np.arange(seconds * RATE) / RATE
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    u = sum(0.3 * np.sin(w * t + p) for w, p in zip((2.0, 5.3, 9.1), phases, strict=True))
    q, v = np.empty_like(t), np.empty_like(t)
    for k, command in enumerate(np.asarray(u)):
        q[k], v[k] = d.qpos[0], d.qvel[0]
        d.ctrl[:] = command
        mujoco.mj_step(m, d, round(1 / (RATE * m.opt.timestep)))
    columns = {
        "ctrl/servo": np.asarray(u),
        "qpos/hinge": q + rng.normal(0.0, 1e-4, q.shape),
        "qvel/hinge": v + rng.normal(0.0, 2e-3, v.shape),
    }
    recordings.write(Recording(t, columns, dict(labels)), path)
    return path


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A model, and two sessions of two units; where the search looks, it finds dry friction."""

    def told(of: Recorded, seed: int = 0, progress: object = None) -> Hypothesis:
        return (
            Planted(
                effects()["joint.friction_coulomb"], Location("joint", "hinge"), np.array([0.3])
            ),
        )

    monkeypatch.setattr(again, "named", told)
    (tmp_path / "rig.xml").write_text(RIG.format(friction=""))
    for i, (unit, friction) in enumerate(FRICTION.items()):
        for day in (1, 9):
            labels = {"unit": unit, "session": f"2026-11-0{day}"}
            record(tmp_path / f"{unit}-{day}.parquet", friction, 10 * i + day, labels)
    return tmp_path


def test_each_group_is_estimated_and_later_ones_are_appended(bench: Path) -> None:
    model, out = bench / "rig.xml", bench / "robot"
    first = add(model, [bench / "A17-1.parquet", bench / "B04-1.parquet"], out)
    assert len(first.groups) == 2
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    later = [bench / f"{name}.parquet" for name in ("A17-9", "B04-9", "A17-1")]
    second = add(model, later, out)
    assert second.known == (bench / "A17-1.parquet",)
    assert {name: (out / name).read_bytes() for name in before} == before
    assert len(list(out.iterdir())) == 4
    assert list(map(str, second.passport.parts)) == [
        "joint hinge", "actuator servo", "encoder of hinge",
    ]  # fmt: skip
    rows = second.passport.rows
    assert len(rows) == 4
    for row in rows:
        assert abs(row.value - FRICTION[row.labels.unit]) < 4.0 * row.error
        assert row.error < 0.02
    of = card(rows)
    (placed,) = of.levels.values()
    assert placed.level == "unit"
    assert of.alarms == []
    again_nothing = add(model, later, out)
    assert again_nothing.files == ()
    assert len(list(out.iterdir())) == 4


@pytest.mark.long
def test_sessions_are_added_one_after_the_other(bench: Path) -> None:
    """As they would have been on their days, whatever the order in which they are given."""
    model, paths = bench / "rig.xml", sorted(bench.glob("*-?.parquet"))
    day_by_day = bench / "by hand"
    for day in (1, 9):
        last = add(model, [p for p in paths if p.stem.endswith(str(day))], day_by_day)
    added = add(model, paths[::-1], bench / "robot", each_session=True)
    assert len(added.files) == 4
    assert [len(a.sources) for a in added.passport.additions] == [2, 2]
    assert set(added.passport.rows) == set(last.passport.rows)
    assert added.passport.additions[0].decided == last.passport.additions[0].decided
    again_nothing = add(model, paths, bench / "robot", each_session=True)
    assert again_nothing.files == () and len(again_nothing.known) == 4


@pytest.mark.long
def test_only_a_units_first_session_is_searched(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[int] = []
    tell = again.named

    def told(*given: object) -> Hypothesis:
        searched.append(1)
        return tell(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(again, "named", told)
    paths = sorted(bench.glob("*-?.parquet"))
    add(bench / "rig.xml", paths, bench / "robot", every_group=False, each_session=True)
    assert len(searched) == 2


@pytest.mark.long
def test_a_new_effect_is_estimated_in_earlier_groups_too(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, out = bench / "rig.xml", bench / "robot"
    add(model, [bench / "A17-1.parquet", bench / "B04-1.parquet"], out)
    (bench / "B04-1.parquet").unlink()
    rotor = Planted(effects()["joint.armature"], Location("joint", "hinge"), np.array([0.04]))
    monkeypatch.setattr(again, "named", lambda *_: (rotor,))
    labels = {"unit": "A17", "session": "2026-11-09"}
    record(bench / "A17-9.parquet", FRICTION["A17"], 9, labels, armature=0.04)
    added = add(model, [bench / "A17-9.parquet"], out)
    found = {(r.labels.unit, r.labels.session, r.quantity.effect) for r in added.passport.rows}
    both = {"joint.friction_coulomb", "joint.armature"}
    assert found == {("A17", f"2026-11-0{d}", e) for d in (1, 9) for e in both} | {
        ("B04", "2026-11-01", "joint.friction_coulomb")
    }
    (note,) = added.passport.additions[-1].notes
    assert note.startswith("B04 on 2026-11-01 has no estimates of what was found since")


def test_the_command_says_what_it_did(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = [str(bench / name) for name in ("rig.xml", "A17-1.parquet", "A17-9.parquet")]
    assert main(["passport", "add", *given, "--out", str(bench / "robot")]) == 0
    out = capsys.readouterr().out
    assert "Estimated: A17 on 2026-11-01, A17 on 2026-11-09." in out
    assert "the model" in out
    assert main(["passport", "add", *given, "--out", str(bench / "robot")]) == 0
    assert "A17-9.parquet is in" in " ".join(capsys.readouterr().out.split())


def test_what_cannot_be_placed_is_refused_before_any_work(
    bench: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = record(bench / "bare.parquet", 0.2, 1, {})
    out = bench / "robot"
    assert main(["passport", "add", str(bench / "rig.xml"), str(bare), "--out", str(out)]) == 2
    err = capsys.readouterr().err
    assert "names no unit and no session; add them: wt import" in err
    assert err.count("\n") == 1
    assert not out.exists()


def test_a_passport_is_of_one_model(bench: Path) -> None:
    out = bench / "robot"
    add(bench / "rig.xml", [bench / "A17-1.parquet"], out)
    other = bench / "other.xml"
    other.write_text(RIG.format(friction=' frictionloss="0.1"'))
    with pytest.raises(UserError, match="is another model: give that one, or name another folder"):
        add(other, [bench / "A17-9.parquet"], out)


@pytest.mark.long
def test_a_group_is_all_its_recordings(bench: Path) -> None:
    """A second recording of the same session narrows its estimate."""
    model, out = bench / "rig.xml", bench / "robot"
    labels = {"unit": "A17", "session": "2026-11-01"}
    first = add(model, [bench / "A17-1.parquet"], out)
    more = record(bench / "more.parquet", FRICTION["A17"], 77, labels)
    second = add(model, [more], out)
    (one,), (both,) = first.passport.rows, second.passport.rows
    assert one.labels == both.labels
    assert both.error <= one.error * 1.05
    assert both.value != one.value
