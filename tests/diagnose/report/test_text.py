"""What is said of a diagnosis, in sentences and tables."""

from __future__ import annotations

from dataclasses import replace

from tests.diagnose import synthetic
from wt.check.finding import AuditFinding
from wt.diagnose.report import text
from wt.diagnose.result import Diagnosis, Estimate, Finding


def pushed() -> Diagnosis:
    """Pushes in a fitted recording, of which the held-out one has none."""
    d = synthetic.diagnosis()
    first = d.findings[0]
    push = Finding(
        effect="joint.force_intermittent",
        at=first.at,
        parameters={
            "torque": Estimate(-0.4, "N·m", (-0.6, -0.2)),
            "windows": Estimate((1.1, 1.5), "s", ((1.1, 1.5), (1.1, 1.5))),
        },
        statement="Joint j2 is pushed now and then: -0.4 N·m at 1.10–1.50 s.",
        holdout_gain=0.5,
        p_value=1e-4,
        confusable_with=(),
        reference="",
    )
    h = d.proof.holdout
    same = replace(h, after=1.001 * h.before, ratio=1.001, ratio_ci95=(1.0, 1.0))
    return replace(d, findings=(push,), proof=replace(d.proof, holdout=same))


def test_an_error_that_stays_does_not_fall() -> None:
    said = text.fit(pushed())
    assert "stays at 8.78 mrad" in said
    assert "fell" not in said
    assert "fell from 8.78 to" in text.fit(synthetic.diagnosis())


def test_an_error_that_rose_did_not_fall() -> None:
    """What is a few per cent worse was said to stay, and what is more so to have fallen."""
    d = pushed()
    h = d.proof.holdout
    worse = replace(h, after=1.06 * h.before, ratio=1.06, ratio_ci95=(1.02, 1.1))
    said = text.fit(replace(d, proof=replace(d.proof, holdout=worse)))
    assert "rose from 8.78 to 9.30 mrad, to 106 % (95 % interval 102 to 110 %)" in said


def test_an_error_beyond_noise_of_which_nothing_is_missing_is_said_to_be_tolerances() -> None:
    """47 times the noise and "nothing is missing" stood side by side without a word."""
    d = pushed()
    nothing = replace(d, findings=(), verdict="no_mismatch")
    assert "no more than what any model is off by" in text.fit(nothing)
    assert "any model" not in text.fit(replace(nothing, verdict="unexplained"))
    h = d.proof.holdout
    quiet = replace(nothing, proof=replace(d.proof, holdout=replace(h, before=h.noise_floor)))
    assert "any model" not in text.fit(quiet)


def test_more_than_all_does_not_read_as_all() -> None:
    shares = (0.017, 0.5, 0.996, 0.9999, 1.0, 1.0145, 1.14, 12.3)
    said = ["1.7", "50", "99.6", "100", "100", "101", "114", "1230"]
    assert [text.percent(share) for share in shares] == said


def test_times_of_pushes_are_no_estimates() -> None:
    assert [row[2] for row in text.parameter_rows(pushed().findings)] == ["torque"]


def test_what_an_audit_is_unsure_of_is_left_to_do() -> None:
    """Neither recordings nor models are corrected by a note, nor said to be."""
    finding = AuditFinding(
        "gain_unit", (), (), "kp is off", "kp=5", 0.5, model_change=lambda spec: None
    )
    assert text.audited(finding) == "kp is off; to do: kp=5."
    assert text.audited(replace(finding, confidence=0.9)).endswith("is of the corrected data.")
