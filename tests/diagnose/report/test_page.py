"""The report: one file that says, draws and compares what the diagnosis found."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose import synthetic
from wt.diagnose.evidence import (
    ChannelLeft,
    Distance,
    Interval,
    Measured,
    MeasuredForce,
    SensorError,
    Translated,
)
from wt.diagnose.report import charts
from wt.diagnose.report.drawing import draw, joint_of
from wt.diagnose.report.page import report, text
from wt.diagnose.report.report import Report
from wt.diagnose.result import Decision, Diagnosis, Error, Estimate, Finding, Located, Used
from wt.show.page import table
from wt.types import Location

VOID = {"meta", "br", "link", "img", "input"}


class Page(HTMLParser):
    """Text, tags and the links to elsewhere of a page; complains about tags left open."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(source)
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("style", "script"):
            self.text.append(data)

    @property
    def words(self) -> str:
        return " ".join(" ".join(self.text).split())


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return synthetic.diagnosis(str(synthetic.write_model(tmp_path_factory.mktemp("model"))))


@pytest.fixture(scope="module")
def source(diagnosis: Diagnosis) -> str:
    return report(diagnosis)


def test_the_page_is_whole_small_and_reaches_nowhere(source: str) -> None:
    page = Page(source)
    assert len(source.encode()) < 3e6
    for tag, attributes in page.tags:
        assert not {"src", "href", "srcset", "data"} & set(attributes), tag
    assert not re.search(r"https?://|@import|url\(|fetch\(|XMLHttp", source)


def test_it_says_what_was_found(source: str) -> None:
    said = Page(source).words
    for part in (
        "Joint j2 loses 0.81 N·m to dry friction that the model leaves out.",
        "explained",
        "0.795 … 0.829",
        "joint.friction_stribeck",
        "slow reversals of j2 below 0.05 rad/s",
        "at speeds below 0.1 rad/s 2.1 to 2.6 s, 5.4 to 6.0 s",
        "was refined to 0.5 ms",
        "Coulomb, Théorie des machines simples",
        'frictionloss="0.8"',
        "4 decisions at 2 places",
        "held.parquet, held out",
        "over the velocity of j2",
    ):
        assert part in said, part
    assert said.index("Joint j2 loses") < said.index("explained")


def test_the_given_error_is_that_of_the_replays(diagnosis: Diagnosis, source: str) -> None:
    held = diagnosis.traces[0]
    rms = 1e3 * float(np.sqrt(np.nanmean((held.before - held.recorded)[:, 1] ** 2)))
    assert f"Joint j2: error RMS {rms:.1f} mrad with the model as given" in Page(source).words


def test_every_picture_has_words_and_every_figure_a_caption(source: str) -> None:
    page = Page(source)
    pictures = [a for tag, a in page.tags if tag == "svg"]
    captions = [tag for tag, _ in page.tags if tag == "figcaption"]
    assert len(pictures) == len(captions) == 7  # robot, 2 joints × 2 recordings, force, horizon
    assert all(a["role"] == "img" and a["aria-label"] for a in pictures)
    assert "marked: joint j2" in str(pictures[0]["aria-label"])


def test_nothing_missing_accuses_nobody(tmp_path: Path) -> None:
    said = Page(report(synthetic.nothing(str(synthetic.write_model(tmp_path))))).words
    assert "Nothing is missing" in said
    assert "patched model" not in said
    assert "Parameters" not in said
    assert "error on held-out data is 0.210 mrad" in said


def test_an_unknown_cause_is_said_with_its_formula(tmp_path: Path) -> None:
    page = Page(report(synthetic.unexplained(str(synthetic.write_model(tmp_path)))))
    assert "The cause is not known" in page.words
    assert "-0.8*tanh(qvel/j2 / 0.02) < 1" in page.words  # escaped in the source, whole on screen
    assert "qvel/j2 & qpos/j1" in page.words
    assert "As printed it removes 42 %" in page.words


def test_something_missing_without_a_name_is_not_called_nothing(tmp_path: Path) -> None:
    full = synthetic.nothing(str(synthetic.write_model(tmp_path)))
    at = (Located(Location("body", "fore"), 1.0),)
    odd = dataclasses.replace(full, verdict="unexplained", locations=at)
    page = Page(report(odd))
    assert "Something is missing at body fore" in page.words
    assert "Nothing is missing" not in page.words
    assert "marked: body fore" in str(next(a for t, a in page.tags if t == "svg")["aria-label"])


def test_names_cannot_break_the_page(diagnosis: Diagnosis) -> None:
    evil = "<script>alert(1)</script>&"
    odd = dataclasses.replace(
        diagnosis, model_path=evil, notes=(evil,), decisions=(
            Decision(evil, synthetic.J2, "replayed", False, 1.0, 2.0, evil),
        ),
    )  # fmt: skip
    source = report(odd)
    assert "<script>alert" not in source
    assert Page(source).words.count(evil) >= 4


def test_gaps_and_replays_that_ran_away_are_survived(tmp_path: Path) -> None:
    full = synthetic.diagnosis(str(synthetic.write_model(tmp_path)))
    trace = full.traces[0]
    gone = np.array(trace.before)
    gone[200:] = np.nan
    empty = np.full_like(gone, np.nan)
    error = Error(np.nan, 1e-3, 2e-4, np.nan, (np.nan, np.nan))
    odd = dataclasses.replace(
        full,
        traces=(
            dataclasses.replace(trace, before=gone),
            dataclasses.replace(trace, recorded=empty, before=empty),
        ),
        proof=dataclasses.replace(full.proof, holdout=error, joints={"j1": error}),
    )
    page = Page(report(odd))
    assert "nan" not in re.sub(r"[^a-z ]", " ", page.words.lower()).split()
    assert not re.search(r'd="[^"]*(nan|inf)', report(odd))


def test_without_the_model_file_it_is_drawn_from_the_text() -> None:
    page = Page(report(synthetic.diagnosis("no/such/arm.xml")))
    assert [a for tag, a in page.tags if tag == "svg" and a["class"] == "robot"]


@pytest.mark.parametrize(
    ("value", "said"),
    [(0.0, "0"), (1.288, "1.29"), (-0.0123, "−0.0123"), (28.0, "28.0"), (12345.6, "12300"),
     (3.2e-5, "3.20·10⁻⁵"), (-3.2e-5, "−3.20·10⁻⁵"), (float("nan"), "–"), (9.999, "10.0")],
)  # fmt: skip
def test_numbers_are_written_for_people(value: float, said: str) -> None:
    assert text.number(value) == said


def test_a_value_has_the_digits_that_its_interval_allows() -> None:
    coarse = text.values_and_intervals(Estimate(1.28934, "N·m", (1.1, 1.5)))
    fine = text.values_and_intervals(Estimate(1.28934, "N·m", (1.2890, 1.2897)))
    vector = text.values_and_intervals(Estimate((0.1, -0.2), "m", ((0.08, -0.3), (0.12, -0.1))))
    assert coarse == [("1.29", "1.10 … 1.50")]
    assert fine == [("1.28934", "1.28900 … 1.28970")]
    assert vector == [("0.100", "0.080 … 0.120"), ("−0.200", "−0.300 … −0.100")]
    tiny = text.values_and_intervals(Estimate((1e-17, -0.2), "m", ((-1e-16, -0.3), (2e-5, -0.1))))
    assert tiny[0] == ("1.00·10⁻¹⁷", "−1.00·10⁻¹⁶ … 2.00·10⁻⁵")
    assert text.values_and_intervals(Estimate(0.31, "N·m", (0.15, 1e8))) == [("0.310", "0.150 … ∞")]


def test_a_vector_has_a_row_a_component_and_one_warning(diagnosis: Diagnosis) -> None:
    shift = Estimate((0.1, 0.2, 0.3), "m", ((0.0, 0.1, 0.2), (0.2, 0.3, 0.4)), "at the bound")
    finding = dataclasses.replace(diagnosis.findings[0], parameters={"shift": shift})
    rows = text.parameter_rows([finding])
    assert [row[2] for row in rows] == ["shift x", "shift y", "shift z"]
    assert [row[6] for row in rows] == ["at the bound", "", ""]


def test_an_axis_that_no_recording_shows_has_no_figure(diagnosis: Diagnosis) -> None:
    ends = ((0.0, -5.0, 0.2), (0.2, 5.0, 0.4))
    position = Estimate((0.1, 0.0, 0.3), "m", ends, unshown=("y",))
    finding = dataclasses.replace(diagnosis.findings[0], parameters={"position": position})
    x, y, z = text.parameter_rows([finding])
    assert y[3:6] == ("–", "", "not shown")
    assert x[5] != "not shown" != z[5]


def test_places_lead_to_their_joint() -> None:
    model = mujoco.MjModel.from_xml_string(synthetic.ARM)
    for kind, name, joint in (
        ("joint", "j1", "j1"), ("actuator", "a2", "j2"), ("body", "fore", "j2"),
        ("geom", "hand", "j2"), ("body", "base", None), ("joint", "nobody", None),
        ("world", "world", None), ("pair", "j1+j2", "j1"),
    ):  # fmt: skip
        assert joint_of(model, Location(kind, name)) == joint  # type: ignore[arg-type]


def test_a_share_says_what_it_is_of(diagnosis: Diagnosis, source: str) -> None:
    """A joint that errs by little, and a base by much, count alike in it, not in the headline."""
    said = "Shares of squared errors count every joint alike"
    proof = dataclasses.replace(diagnosis.proof, joints=dict([*diagnosis.proof.joints.items()][:1]))
    assert said in source and len(diagnosis.proof.joints) > 1
    assert said not in report(dataclasses.replace(diagnosis, proof=proof))


def test_what_is_found_at_all_drives_shows_at_one_of_them(diagnosis: Diagnosis) -> None:
    """What floats takes most of any force; no drive acts on it."""
    model = mujoco.MjModel.from_xml_string(synthetic.ARM)
    most = np.array([9.0, 1.0])
    traces = tuple(
        dataclasses.replace(t, force_before=most * np.ones_like(t.force_before),
                            force_after=np.zeros_like(t.force_after))
        for t in diagnosis.traces
    )  # fmt: skip
    floating = dataclasses.replace(diagnosis, joints=("base/x", "j2"), traces=traces)
    assert charts._joint(floating, Location("actuator", "all"), model) == 1
    assert charts._joint(floating, Location("body", "base"), model) == 0


def test_a_marked_body_stands_out_and_stays_on_the_page() -> None:
    model = mujoco.MjModel.from_xml_string(synthetic.ARM)
    svg = draw(model, np.array([0.4, -1.0]), {Location("body", "fore"): ["payload"]})
    assert re.search(r'class="s\d hot"', svg)
    assert "body fore" in svg
    assert "payload" in svg
    assert not re.search(r'class="s\d hot"', draw(model, np.zeros(2), {}))
    numbers = [float(n) for d in re.findall(r'd="([^"]+)"', svg) for n in re.findall(r"[\d.]+", d)]
    assert max(numbers) <= 560


def test_figures_stay_with_their_units(source: str) -> None:
    shown = re.sub(
        r"<style>.*?</style>|<script>.*?</script>|<pre>.*?</pre>", "", source, flags=re.S
    )
    assert "95\u00a0% interval" in shown
    assert "0.81\u00a0N·m" in shown
    apart = re.findall(r"[0-9⁻⁰¹²³⁴⁵⁶⁷⁸⁹] (?:%|[mµ]?rad|[mµ]?s|N|N·m)(?![\w])", shown)
    # what a picture says is read aloud, and breaks nowhere
    assert [a for a in apart if a not in " ".join(re.findall(r'aria-label="[^"]*"', shown))] == []
    assert text.tied("in 5 months at 3 m/s and 2 steps") == "in 5 months at 3\u00a0m/s and 2 steps"


def test_lines_on_a_terminal_keep_them_too(
    diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]
) -> None:
    for end in range(30):
        longer = dataclasses.replace(diagnosis, notes=("x" * end + " within 95 % of 0.81 N·m",))
        Report.of(longer).show()
    printed = capsys.readouterr().out
    assert "\u00a0" not in printed
    assert not re.search(r"(95|0\.81)\n", printed)


@pytest.mark.parametrize(
    ("effect", "said"),
    [("joint.friction_coulomb", "Coulomb friction"), ("body.payload_fixed", "fixed payload"),
     ("actuator.speed_limit", "speed limit"), ("unknown", "unknown")],
)  # fmt: skip
def test_effects_have_names(effect: str, said: str) -> None:
    assert text.name_of(effect) == said


def used(*paths: str) -> tuple[Used, ...]:
    return tuple(Used(path, "fit", 10.0, 100.0) for path in paths)


def test_recordings_are_named_where_there_are_several(diagnosis: Diagnosis) -> None:
    several = dataclasses.replace(diagnosis, recordings=used("a/run.parquet", "b/run.parquet"))
    when = (
        Interval("a/run.parquet", 1.0, 2.0),
        Interval("b/run.parquet", 0.5, 0.75),
        Interval("b/run.parquet", 3.0, 4.0),
    )
    assert [line.replace("\u00a0", " ") for line in text.times(several, when)] == [
        "a/run.parquet: 1.0 to 2.0 s",
        "b/run.parquet: 0.50 to 0.75 s, 3.00 to 4.00 s",
    ]
    alone = dataclasses.replace(diagnosis, recordings=used("a/run.parquet"))
    assert text.times(alone, [Interval("a/run.parquet", 0.01, 9.99)]) == ["throughout"]
    assert text.short_name(alone, "a/run.parquet") == "run.parquet"


def test_shaded_is_when_the_mismatch_shows_in_that_very_recording(diagnosis: Diagnosis) -> None:
    page = report(diagnosis)
    held, fitted = page.split("<summary>fit.parquet")[:2]
    assert 'class="span"' not in held
    assert fitted.count('class="span"') == 4  # two intervals, two joints
    other = Located(synthetic.J2, 1.0, (Interval("held.parquet", 1.0, 2.0),))
    moved = report(dataclasses.replace(diagnosis, locations=(other,)))
    held, fitted = moved.split("<summary>fit.parquet")[:2]
    assert held.count('class="span"') == 2
    assert 'class="span"' not in fitted


def test_an_outlier_does_not_squeeze_the_law(diagnosis: Diagnosis) -> None:
    (held, fitted) = diagnosis.traces
    wild = np.array(held.force_before)
    wild[100, 1] = 500.0
    odd = dataclasses.replace(
        diagnosis, traces=(dataclasses.replace(held, force_before=wild), fitted)
    )
    chart = report(odd).split("missing force [N·m]")[0].rpartition("<svg")[2]
    assert max(float(n) for n in re.findall(r'class="y"[^>]*>([0-9.]+)<', chart)) <= 1.0


def test_a_law_that_only_replays_tell_shows_no_after(diagnosis: Diagnosis) -> None:
    same = tuple(
        dataclasses.replace(t, force_after=1.002 * t.force_before) for t in diagnosis.traces
    )
    page = report(dataclasses.replace(diagnosis, traces=same))
    chart = page.split("missing force [N·m]")[1].partition("</figure>")[0]
    assert "beads before" in chart
    assert "beads after" not in chart
    assert "shows in replays alone" in chart
    keys = page.split("What the missing force depends on")[1].partition("<svg")[0]
    assert "key before" in keys and "key after" not in keys


def force(actuator: str, joint: str, side: str) -> MeasuredForce:
    return MeasuredForce(actuator, joint, ("fore",), 0.1, 0.8, 0.8, "N·m", side)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("effect", "at", "side", "said"),
    [
        ("joint.friction_coulomb", synthetic.J2, "behind", "bears this out"),
        ("joint.friction_coulomb", synthetic.J2, "drive", "speaks against this"),
        ("joint.friction_coulomb", synthetic.J2, "both", "bears this out"),
        ("joint.friction_coulomb", synthetic.J2, "neither", ""),
        ("joint.friction_coulomb", Location("joint", "j1"), "behind", ""),
        ("joint.backlash", synthetic.J2, "drive", ""),
        ("actuator.gain", synthetic.A2, "drive", "bears this out"),
        ("actuator.gain", synthetic.A2, "behind", "speaks against this"),
        ("body.mass", Location("body", "fore"), "behind", "bears this out"),
        ("sensor.offset", synthetic.J2, "drive", ""),
        ("unknown", synthetic.J2, "behind", ""),
    ],
)
def test_a_measured_force_speaks_for_or_against_a_finding(
    diagnosis: Diagnosis, effect: str, at: Location, side: str, said: str
) -> None:
    found: Finding = dataclasses.replace(diagnosis.findings[0], effect=effect, at=at)
    seen = dataclasses.replace(
        diagnosis, findings=(found,), measured=Measured((force("a2", "j2", side),))
    )
    assert bool(said) == bool(text.borne_out(seen, found))
    assert said in text.borne_out(seen, found)
    assert said in Page(report(seen)).words


def test_other_sensors_stand_in_the_proof(diagnosis: Diagnosis, tmp_path: Path) -> None:
    sensors = (
        SensorError("gyro", "rad/s", 0.02, 0.005),
        SensorError("enc", "rad", 4e-3, 2e-4),
        SensorError("force/a2", "N·m", 0.8, None),
    )
    seen = dataclasses.replace(diagnosis, measured=Measured((), sensors))
    said = Page(report(seen)).words
    assert "gyro 0.0200 rad/s 0.00500 rad/s 25 %" in said
    assert "enc 4.00 mrad 0.200 mrad 5.0 %" in said
    assert "force/a2 0.800 N·m – –" in said
    assert "What else the robot reports" not in Page(report(diagnosis)).words
    plain = synthetic.nothing(str(synthetic.write_model(tmp_path)))
    alone = Page(report(dataclasses.replace(plain, measured=seen.measured))).words
    assert "gyro 0.0200 rad/s enc 4.00 mrad" in alone


def test_a_translation_s_evidence_is_shown(diagnosis: Diagnosis, source: str) -> None:
    assert "What a trained translation says" not in source
    name = diagnosis.recordings[0].path
    t = np.arange(0.0, 4.0, 0.02)
    found = Translated(
        "wt-arm/3",
        (ChannelLeft("qpos/j1", "rad", 0.004, 0.002), ChannelLeft("qvel/j1", "rad/s", 0.2, 0.1)),
        (Distance(name, t, 1.0 + 5.0 * (np.abs(t - 2.0) < 0.1)),),
        (Interval(name, 1.9, 2.1),),
    )
    assert found.left == pytest.approx(0.25)
    page = Page(report(dataclasses.replace(diagnosis, translated=found)))
    text = " ".join(" ".join(page.text).replace("\N{NO-BREAK SPACE}", " ").split())
    assert "wt-arm/3 leaves 25 % of the squared error" in text
    assert "qpos 4.00 mrad 2.00 mrad 25 %" in text
    assert "shaded where it stands out" in text


def test_cells_say_their_column_for_pages_too_narrow_for_a_table() -> None:
    shown = table(("place", "#share"), ['<tr><td>hip</td><td class="n">91 %</td></tr>'])
    assert '<td data-label="place">hip</td><td data-label="share" class="n">91 %</td>' in shown


def test_the_page_says_where_the_patched_model_looks_ahead_worse() -> None:
    diagnosis = synthetic.diagnosis()
    assert "worse than the one given" not in Page(report(diagnosis)).words
    horizons = {"rad": {**diagnosis.proof.horizons["rad"], 0.1: (1.8e-3, 5e-3)}}
    proof = dataclasses.replace(diagnosis.proof, horizons=horizons)
    words = Page(report(dataclasses.replace(diagnosis, proof=proof))).words
    assert "worse than the one given: 5.00 against 1.80 mrad at 0.1 s." in words


def test_an_error_that_fades_is_one_of_the_start() -> None:
    diagnosis = synthetic.diagnosis()
    assert "that fades" not in Page(report(diagnosis)).words
    horizons = {"rad": {0.1: (9e-3, 1.6e-3), 2.0: (19e-3, 7e-4)}}
    proof = dataclasses.replace(diagnosis.proof, horizons=horizons)
    assert "that fades" in Page(report(dataclasses.replace(diagnosis, proof=proof))).words


def test_errors_of_slides_and_hinges_over_the_look_ahead_are_two_charts() -> None:
    diagnosis = synthetic.diagnosis()
    slides = {0.1: (9e-5, 2.1e-5), 2.0: (6e-4, 3e-5)}
    horizons = {**diagnosis.proof.horizons, "m": slides}
    proof = dataclasses.replace(diagnosis.proof, horizons=horizons)
    words = Page(report(dataclasses.replace(diagnosis, proof=proof))).words
    assert "look ahead, of positions in rad" in words
    assert "look ahead, of positions in m" in words and "RMSE [mm]" in words


def test_one_joint_is_not_told_twice() -> None:
    diagnosis = synthetic.diagnosis()
    assert "all joints" in Page(report(diagnosis)).words
    alone = dataclasses.replace(diagnosis.proof, joints={"j2": diagnosis.proof.joints["j2"]})
    said = Page(report(dataclasses.replace(diagnosis, proof=alone))).words
    assert "all joints" not in said and "j2 " in said


def test_what_has_no_law_is_not_said_to_remove_anything() -> None:
    known = synthetic.diagnosis()
    place = dataclasses.replace(
        known.findings[0], effect="unknown", parameters={}, statement="Joint j2 is moved by x.",
        holdout_gain=0.0, depends_on=(), formula=None, confusable_with=(),
    )  # fmt: skip
    unknown = dataclasses.replace(known, findings=(place,), verdict="unexplained")
    said = Page(report(unknown)).words
    assert "No law of it is proven, and none is written." in said
    assert "removes" not in said and "of such a gain" not in said
    assert "this names where it acts." in said and "takes of it" not in said


def test_what_is_another_way_back_is_drawn_each_way() -> None:
    known = synthetic.diagnosis()
    way = dataclasses.replace(known.findings[0], effect="joint.hysteresis")
    page = report(dataclasses.replace(known, findings=(way,)))
    chart = page.split("missing force [N·m]")[1].partition("</figure>")[0]
    assert chart.count("beads before") == 2
    assert "beads their means, on the way there and on the way back." in Page(page).words
