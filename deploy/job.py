"""The work of the commands, from words to files."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from wt.errors import UserError, WorkError

if TYPE_CHECKING:
    from deploy.follower import Follower
    from deploy.go2 import Go2
    from deploy.record import Recorder
    from deploy.runner import RunOutcome

REPORT, MODEL = "report.json", "model.xml"


def run(
    reference: str, *, interface: str, domain: int, limits: Sequence[str],
    seconds: float | None, out: Path | None, dry_run: bool, realtime: bool,
    passport: Path | None, unit: str,
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
        passport: of the robot, to say when it is no longer the one in it; None for none.
        unit: which unit of it; "" for the only one.

    Raises:
        UserError: policy, interface, limits or passport cannot be used.
        WorkError: no robot answers, or a fault ended the run.
    """
    from deploy.clock import take_precedence
    from deploy.operator import KEYS, HumanOperator
    from deploy.pilot import Pilot
    from deploy.policies import load
    from deploy.robot import Silent
    from deploy.runner import RATE_HZ, Runner, teller
    from deploy.safety import Limits
    from wt.worlds.robots import mjcf

    bounds, policy = Limits.parse(list(limits)), load(reference)
    if realtime:
        take_precedence()  # before the network's threads begin
    robot = _go2(interface, domain, policy.card.joints)
    folder = _folder(out)
    left = _leave_model(folder / MODEL, mjcf("go2"))
    operator, say = HumanOperator(policy.card.command_limits), teller()
    say(f"policy {policy.card.name} ({policy.card.sha256[:12]}) on {interface}\n{KEYS}")
    runner = Runner(Silent(robot) if dry_run else robot, Pilot(policy), operator, bounds, say=say)
    meta: dict[str, object] = {
        "source": f"wt-run on {interface}", "policy": reference, "limits": vars(bounds),
        "robot": "go2", "rate": RATE_HZ, "policy_sha256": policy.card.sha256, "dry_run": dry_run,
    }  # fmt: skip
    followers: list[Follower] = []
    try:
        followers += _followers(folder, runner.recorder, meta, passport, unit)
        with operator.attending():
            outcome = runner.run(math.inf if seconds is None else seconds)
    finally:
        meta |= {"events": runner.events, "health": robot.health()}
        written = runner.recorder.write(folder, meta)
        for follower in followers:
            follower.dismiss()
        if left and not written:
            _take_back(folder)
    _tell(folder, [p.name for p in written], outcome, runner.events)
    if outcome.fault:
        raise WorkError(f"ended in damping after a fault: {outcome.fault}")


def _go2(interface: str, domain: int, joints: Sequence[str]) -> Go2:
    from deploy.dds import DdsParticipant
    from deploy.go2 import Go2

    return Go2(DdsParticipant(interface, domain), joints)


def _followers(
    folder: Path, recorder: Recorder, meta: Mapping[str, object], passport: Path | None, unit: str
) -> list[Follower]:
    """Start the processes beside the run: one keeps it, one compares it with the passport."""
    from deploy.scribe import scribe

    watching = []
    if passport is not None:
        from deploy.drift import watch

        watching.append(watch(folder, passport, unit, folder / MODEL, recorder))
    return [*watching, scribe(folder, recorder, meta)]


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


def _tell(folder: Path, written: Sequence[str], outcome: RunOutcome, events: object) -> None:
    """Leave a report; print the timing, what was written, and how to compare it with the model."""
    from deploy.record import RECORDING

    report = {"timing": outcome.timing.dict(), "events": events, "began": outcome.began}
    _write_whole(folder / REPORT, json.dumps(report, indent=1) + "\n")
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
