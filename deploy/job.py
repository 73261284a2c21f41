"""The work of the commands, from words to files."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from wt.errors import UserError, WorkError

if TYPE_CHECKING:
    from deploy.runner import RunOutcome

REPORT, MODEL = "report.json", "model.xml"


def run(
    reference: str, *, interface: str, domain: int, limits: Sequence[str],
    seconds: float | None, out: Path | None, dry_run: bool, realtime: bool,
) -> None:  # fmt: skip
    """Run a policy on a Go2 and print the timing report.

    Args:
        reference: of the policy, see :func:`deploy.policies.load`.
        interface: of the network.
        domain: of DDS.
        limits: ``KEY=VALUE`` changes of :class:`deploy.safety.Limits`.
        seconds: when to end; None for when the operator says so.
        out: folder of recording, log and report; None for one of its own.
        dry_run: send nothing.
        realtime: run before all other processes.

    Raises:
        UserError: policy, interface or limits cannot be used.
        WorkError: no robot answers, or a fault ended the run.
    """
    from deploy.clock import take_precedence
    from deploy.dds import DdsParticipant
    from deploy.go2 import Go2
    from deploy.operator import KEYS, HumanOperator
    from deploy.pilot import Pilot
    from deploy.policies import load
    from deploy.robot import Silent
    from deploy.runner import RATE_HZ, Runner, teller
    from deploy.safety import Limits
    from deploy.scribe import Scribe
    from wt.worlds.robots import mjcf

    bounds, policy = Limits.parse(list(limits)), load(reference)
    if realtime:
        take_precedence()  # before the network's threads begin
    robot = Go2(DdsParticipant(interface, domain), policy.card.joints)
    folder = _folder(out)
    left = _leave_model(folder / MODEL, mjcf("go2"))
    operator, say = HumanOperator(policy.card.command_limits), teller()
    say(f"policy {policy.card.name} ({policy.card.sha256[:12]}) on {interface}\n{KEYS}")
    runner = Runner(Silent(robot) if dry_run else robot, Pilot(policy), operator, bounds, say=say)
    meta: dict[str, object] = {
        "robot": "go2", "source": f"wt-run on {interface}", "rate": RATE_HZ,
        "policy": reference, "policy_sha256": policy.card.sha256, "dry_run": dry_run,
        "limits": vars(bounds),
    }  # fmt: skip
    scribe = Scribe(folder, runner.recorder, meta)
    try:
        with operator.attending():
            outcome = runner.run(math.inf if seconds is None else seconds)
    finally:
        meta |= {"events": runner.events, "health": robot.health()}
        written = runner.recorder.write(folder, meta)
        scribe.dismiss()
        if left and not written:
            _take_back(folder)
    _write_whole(folder / REPORT, _report(outcome, runner.events))
    _tell(folder, [p.name for p in written], outcome)
    if outcome.fault:
        raise WorkError(f"ended in damping after a fault: {outcome.fault}")


def _folder(out: Path | None) -> Path:
    """Make the folder of a run: if it cannot be, better before the run than after it."""
    folder = out or Path("runs") / f"go2-{datetime.now():%Y-%m-%dT%H-%M-%S}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _leave_model(path: Path, xml: str) -> bool:
    """Write the machine's MJCF unless it is there; False if it was.

    Raises:
        UserError: another file has that name.
    """
    if path.exists():
        if path.read_text(errors="replace") != xml:
            raise UserError(f"{path} is there already and is not the Go2's: give another --out")
        return False
    _write_whole(path, xml)
    return True


def _take_back(folder: Path) -> None:
    """Remove the model that no recording followed, and the folder if nothing else is in it."""
    (folder / MODEL).unlink()
    with suppress(OSError):
        folder.rmdir()


def _report(outcome: RunOutcome, events: object) -> str:
    report = {"timing": outcome.timing.dict(), "events": events, "began": outcome.began}
    return json.dumps(report, indent=1) + "\n"


def _tell(folder: Path, written: Sequence[str], outcome: RunOutcome) -> None:
    """Print the timing, what was written, and how to compare it with the model."""
    from deploy.record import RECORDING

    print(outcome.timing.text())
    print(f"{folder}: {', '.join([*written, MODEL, REPORT])}")
    if RECORDING in written:
        print(f"wt diagnose {folder / MODEL} {folder / RECORDING} --out {folder / 'diagnosis'}")


def simulate(
    *, interface: str, domain: int, remote: Sequence[str], fault: str | None,
    seconds: float | None, out: Path | None, realtime: bool,
) -> None:  # fmt: skip
    """Simulate a Go2 until Ctrl-C or the time is over, and say where it got.

    Args:
        interface: of the network.
        domain: of DDS.
        remote: script of the remote control, :class:`deploy.script.Script`.
        fault: what goes wrong, :class:`deploy.mischief.Mischief`.
        seconds: how long after the first command to end; None for never.
        out: folder of a recording; None for none.
        realtime: run before all other processes.

    Raises:
        UserError: interface, script or fault cannot be used.
    """
    from deploy.clock import take_precedence
    from deploy.dds import DdsParticipant
    from deploy.mischief import Mischief
    from deploy.script import Script
    from deploy.sim import Sim

    script = Script.parse(remote)
    if realtime:
        take_precedence()
    sim = Sim(DdsParticipant(interface, domain), script, Mischief.parse(fault) if fault else None)
    ended = [False]
    for s in (signal.SIGINT, signal.SIGTERM):
        signal.signal(s, lambda *_: ended.__setitem__(0, True))
    print(f"a Go2 lies at {interface}, DDS domain {domain}; Ctrl-C ends", flush=True)
    end = math.inf if seconds is None else seconds
    sim.run(lambda elapsed: ended[0] or elapsed >= end)
    if not len(sim.recorder.ticks()["t"]):
        print("nobody commanded it")
        return
    print(sim.walk())
    if out is not None:
        meta: dict[str, object] = {"robot": "go2", "source": "wt-sim-go2", "rate": 500.0}
        written = sim.recorder.write(out, {**meta, "fault": fault})
        print(f"{out}: {', '.join(p.name for p in written)}")


def _write_whole(path: Path, content: str) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.write_text(content, encoding="utf-8")
    os.replace(temporary, path)
