"""All audits, in order: what one stage finds is mended before the next one looks."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

from wt.check.audit import STAGES, Audit, ChannelAudit, Subject, Suspect, audits
from wt.check.balance import Balance
from wt.check.channels import found
from wt.check.finding import AuditFinding, amendments
from wt.physics.quiet import quiet
from wt.physics.scene import Scene
from wt.types import Recording


@dataclass(frozen=True, eq=False)
class Checked:
    """What was found in one recording, or in the model alone.

    Attributes:
        findings: in the order in which they were mended.
        recording: as corrected; None if there is none.
    """

    findings: tuple[AuditFinding, ...]
    recording: Recording | None


@quiet()  # a model that explodes is a finding, and no warning
def check(scene: Scene | None, recording: Recording | None) -> Checked:
    """Audit a model, a recording, or both.

    Args:
        scene: the model.
        recording: of its machine.
    """
    subject = Subject(scene, recording)
    findings: list[AuditFinding] = []
    known = audits()
    for stage in STAGES:
        new: list[AuditFinding] = []
        if stage == "channel":
            new = found(subject, _suspected)
        for audit in known:
            if isinstance(audit, Audit) and audit.stage == stage:
                new += audit.findings(subject)
        if stage == "gain":
            new = one_model(subject, new)
        subject = _mended(subject, new)
        findings += new
    return Checked(tuple(findings), subject.recording)


def one_model(subject: Subject, findings: list[AuditFinding]) -> list[AuditFinding]:
    """Findings that each explain every force by another change of the model: the best of them."""
    balance, several = subject.balance, [f for f in findings if f.sure and f.model_change]
    if balance is None or len(several) < 2:
        return findings

    def misfit(finding: AuditFinding) -> float:
        scene = Scene(balance.scene.path, [*balance.scene.amendments, *amendments([finding])])
        return Balance(scene, balance.signals).misfit()

    best = min(several, key=misfit)
    return [f for f in findings if f is best or f not in several]


def _suspected(balance: Balance) -> list[Suspect]:
    """Every mix-up of columns that may have happened."""
    return [s for a in audits() if isinstance(a, ChannelAudit) for s in a.suspects(balance)]


def _mended(subject: Subject, findings: Sequence[AuditFinding]) -> Subject:
    """The same with the recording and the model corrected."""
    scene, recording = subject.scene, subject.recording
    hold = subject.commands_hold and not any(f.voids_commands for f in findings)
    changes = [f.change for f in findings if f.change and f.sure]
    wanted = amendments(findings)
    if hold == subject.commands_hold and not changes and not wanted:
        return subject
    if recording is not None:
        recording = functools.reduce(lambda mended, change: change(mended), changes, recording)
    if scene is not None and wanted:
        scene = Scene(scene.path, [*scene.amendments, *wanted])
    return Subject(scene, recording, hold)
