"""The force that findings leave is that of the world without what they name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import chain, on_joint, record
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.report.traces import traces
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

Array = np.ndarray

# rotors that weigh: a drive follows its command smoothly
XML = chain(2).replace('damping=".3"', 'damping=".3" armature=".05"')
SECONDS = 6.0


def late() -> Recording:
    """The drive of j2 acts on commands 20 ms after they were sent."""
    plain = record(XML, None, SECONDS, 0)
    sent = np.roll(plain.columns["ctrl/a2"], -4)
    return Recording(plain.t, {**plain.columns, "ctrl/a2": sent})


def rippling() -> Recording:
    """11 periods a turn."""
    law = on_joint(1, lambda q, v: 0.6 * float(np.sin(11.0 * q + 1.0)))
    return record(XML, law, SECONDS, 0)


def sticking() -> Recording:
    """Friction that falls from 1 to 0.3 N·m with speed."""

    def law(q: float, v: float) -> float:
        return -(0.3 + 0.7 * float(np.exp(-((v / 0.25) ** 2)))) * float(np.tanh(v / 0.01))

    return record(XML, on_joint(1, law), SECONDS, 0)


def loaded() -> Recording:
    """Half a kilogram far out on the second link."""
    load = '<geom type="sphere" size=".02" pos=".1 .05 -.3" mass=".5"/></body></body></worldbody>'
    xml = XML.replace("</body></body></worldbody>", load)
    assert xml != XML
    return record(xml, None, SECONDS, 0)


@pytest.fixture(scope="module")
def nothing(tmp_path_factory: pytest.TempPathFactory) -> float:
    """What is left where nothing is hidden."""
    return left(tmp_path_factory.mktemp("nothing"), record(XML, None, SECONDS, 0), None)


def left(folder: Path, recording: Recording, planted: Planted | None) -> float:
    """Force at joint j2 that a finding leaves, rms [N·m]."""
    path = folder / "arm.xml"
    path.write_text(XML, encoding="utf-8")
    scene = Scene(path)
    prepared = prepare(scene, [recording], [])
    smoothed = [smooth(scene, parts) for parts in (prepared.fit, prepared.held)]
    hypothesis = () if planted is None else (planted,)
    trace = traces(prepared, smoothed, hypothesis, 5e-4)[0]
    moving = np.abs(trace.velocity[:, 1]) > 0.05
    return float(np.sqrt(np.mean(trace.force_after[moving, 1][50:-50] ** 2)))


@pytest.mark.parametrize(
    ("world", "effect", "at", "theta", "share"),
    [
        (late, "actuator.delay", Location("actuator", "a2"), [0.02], 0.0),
        (rippling, "actuator.ripple", Location("actuator", "a2"), [0.6, 11.0, 1.0], 0.0),
        (loaded, "body.payload_fixed", Location("body", "link2"), [0.5, 0.1, 0.05, -0.3], 0.0),
        (sticking, "joint.friction_stribeck", Location("joint", "j2"), [0.3, 1.0, 0.25], 0.25),
    ],
)
def test_what_a_finding_takes_away_is_the_whole_of_it(
    tmp_path: Path,
    nothing: float,
    world: object,
    effect: str,
    at: Location,
    theta: list[float],
    share: float,
) -> None:
    recording = world()  # type: ignore[operator]
    found = left(tmp_path, recording, Planted(effects()[effect], at, np.array(theta)))
    before = left(tmp_path, recording, None)
    assert before > 6.0 * nothing
    # a smooth motion rounds off what friction does abruptly
    assert found < max(2.0 * nothing, share * before)


def test_a_finding_takes_no_more_than_it_says(tmp_path: Path) -> None:
    """Fitted anew to a recording, half of a law would take all of the force."""
    recording = record(XML, on_joint(1, lambda q, v: -0.8 * v), SECONDS, 0)
    half = Planted(effects()["joint.friction_viscous"], Location("joint", "j2"), np.array([0.4]))
    before = left(tmp_path, recording, None)
    assert left(tmp_path, recording, half) == pytest.approx(0.5 * before, rel=0.05)
