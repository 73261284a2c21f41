"""The work of the commands, from words to files."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from wt.errors import UserError, WorkError

if TYPE_CHECKING:
    from deploy.follower import Follower
    from deploy.go2 import Go2
    from deploy.motion import Source
    from deploy.record import Recorder
    from deploy.runner import RunOutcome

REPORT, MODEL = "report.json", "model.xml"


@dataclass(frozen=True)
class RunOptions:
    """How a run goes, whatever moves the robot.

    Attributes:
        interface: of the network.
        domain: of DDS.
        limits: ``KEY=VALUE`` changes of :class:`deploy.safety.Limits`.
        seconds: when to end; None for when the operator says so.
        out: folder of recording, log and report; None for one of its own.
        dry_run: send nothing.
        realtime: run before all other processes.
        passport: of the robot, to say when it is no longer the one in it; None for none.
        unit: which unit of it; "" for the only one.
        load: what it carries; "" for nothing, or the only load that it ever carried.
    """

    interface: str = "lo"
    domain: int = 0
    limits: Sequence[str] = ()
    seconds: float | None = None
    out: Path | None = None
    dry_run: bool = False
    realtime: bool = False
    passport: Path | None = None
    unit: str = ""
    load: str = ""


@dataclass(frozen=True)
class _Job:
    """What moves the robot, and what is said and left of it."""

    source: Source
    joints: Sequence[str]
    largest: Sequence[float]  # velocity command of the operator
    xml: str  # MJCF of the machine
    stay: bool  # in damping after a fault, until the operator ends it
    what: str
    meta: Mapping[str, object]


def run(reference: str, options: RunOptions) -> None:
    """Run a policy on a Go2 and print the timing report.

    Args:
        reference: of the policy, see :func:`deploy.policies.load`.
        options: of the run.

    Raises:
        UserError: policy, interface, limits or passport cannot be used.
        WorkError: no robot answers, or a fault ended the run.
    """
    from deploy.pilot import Pilot
    from deploy.policies import load
    from wt.worlds.robots import mjcf

    def job() -> _Job:
        policy = load(reference)
        card = policy.card
        what = f"policy {card.name} ({card.sha256[:12]})"
        meta = {"policy": reference, "policy_sha256": card.sha256}
        return _Job(Pilot(policy), card.joints, card.command_limits, mjcf("go2"), True, what, meta)

    _run(job, options)


def play(commands: Path, model: Path, options: RunOptions) -> None:
    """Play commands on a Go2 whose trunk is held, and print the timing report.

    Args:
        commands: recording with ``ctrl/<joint>`` for each joint, evenly spaced.
        model: MJCF with the drives' gains; it is left beside the recording.
        options: of the run.

    Raises:
        UserError: commands, model, interface, limits or passport cannot be used.
        WorkError: no robot answers, or a fault ended the run.
    """
    from deploy.playback import Playback, joint_targets, servo_gains
    from wt.data.recording import read
    from wt.worlds.go2_model import JOINTS

    def job() -> _Job:
        gains = servo_gains(model, JOINTS)
        source = Playback(*joint_targets(read(commands), JOINTS), gains)
        xml, what, meta = model.read_text(), f"commands {commands}", {"commands": commands.name}
        return _Job(source, JOINTS, (0, 0, 0), xml, False, what, meta)

    _run(job, options)


def recover(folder: Path) -> None:
    """Make the files of a run that was killed together with the process that keeps it.

    Args:
        folder: of the run.

    Raises:
        DataError: it has nothing to recover.
        WorkError: the run still goes on.
    """
    from deploy.scribe import recover as recovered

    written = [path.name for path in recovered(folder)]
    what = f"recovered {', '.join(written)}, up to the last tick" if written else "it has no tick"
    print(f"{folder}: {what}")
    _tell_command(folder, written)


def _run(prepare: Callable[[], _Job], options: RunOptions) -> None:
    """Do what the two above say; what can be refused is, before the robot is looked for.

    Args:
        prepare: makes the job, and with it threads: they have the precedence of this one.
        options: of the run.
    """
    from deploy.clock import take_precedence
    from deploy.operator import KEYS, HumanOperator
    from deploy.robot import Silent
    from deploy.runner import RATE_HZ, Runner, teller
    from deploy.safety import Limits
    from deploy.scribe import discard

    bounds = Limits.parse(list(options.limits))
    _refuse_unrecovered(options.out)
    if options.realtime:
        take_precedence()  # before the threads of policy and network begin
    job = prepare()
    robot = _go2(options.interface, options.domain, job.joints)
    folder = _folder(options.out)
    left = _leave_model(folder / MODEL, job.xml)
    operator, say = HumanOperator(job.largest), teller()
    say(f"{job.what} on {options.interface}\n{KEYS}")
    line = Silent(robot) if options.dry_run else robot
    runner = Runner(line, job.source, operator, bounds, say=say)
    meta: dict[str, object] = {
        "source": f"wt-run on {options.interface}", "limits": vars(bounds), "robot": "go2",
        "rate": RATE_HZ, "dry_run": options.dry_run, **job.meta,
    }  # fmt: skip
    followers: list[Follower] = []
    try:
        followers += _followers(folder, runner.recorder, meta, options)
        with operator.attending():
            seconds = math.inf if options.seconds is None else options.seconds
            outcome = runner.run(seconds, stay=job.stay)
    finally:
        meta |= {"events": runner.events, "health": robot.health()}
        written = runner.recorder.write(folder, meta)
        for follower in followers:
            follower.dismiss()
        discard(folder)
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
    folder: Path, recorder: Recorder, meta: Mapping[str, object], options: RunOptions
) -> list[Follower]:
    """Start the processes beside the run: one keeps it, one compares it with the passport."""
    from deploy.scribe import scribe

    watching = []
    if options.passport is not None:
        from deploy.drift import watch

        of = options.passport, options.unit
        watching.append(watch(folder, *of, folder / MODEL, recorder, options.load))
    return [*watching, scribe(folder, recorder, meta)]


def _folder(out: Path | None) -> Path:
    """Make the folder of a run: if it cannot be, better before the run than after it."""
    folder = out or Path("runs") / f"go2-{datetime.now():%Y-%m-%dT%H-%M-%S}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _refuse_unrecovered(folder: Path | None) -> None:
    """Refuse a folder with what is left of a run that was killed: it would be lost.

    Raises:
        UserError: there is one.
    """
    from deploy.scribe import JOURNAL

    if folder is not None and (folder / JOURNAL).exists():
        raise UserError(
            f"{folder} has the {JOURNAL} of a run that was killed; make a recording of it with "
            f"'wt-run --recover {folder}', or give another --out"
        )


def _leave_model(path: Path, xml: str) -> bool:
    """Write the machine's MJCF unless it is there; False if it was.

    Raises:
        UserError: another file has that name.
    """
    if path.exists():
        if path.read_text(errors="replace") != xml:
            raise UserError(f"{path} is there already and is another machine's: give another --out")
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
    report = {"timing": outcome.timing.dict(), "events": events, "began": outcome.began}
    _write_whole(folder / REPORT, json.dumps(report, indent=1) + "\n")
    print(outcome.timing.text())
    print(f"{folder}: {', '.join([*written, MODEL, REPORT])}")
    _tell_command(folder, written)


def _tell_command(folder: Path, written: Sequence[str]) -> None:
    from deploy.record import RECORDING

    if RECORDING in written:
        print(f"wt diagnose {folder / MODEL} {folder / RECORDING} --out {folder / 'diagnosis'}")


def simulate(
    *, interface: str, domain: int, remote: Sequence[str], fault: str | None,
    seconds: float | None, out: Path | None, realtime: bool, hung: bool = False,
    model: Path | None = None,
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
        hung: whether its trunk is held above the floor.
        model: MJCF of the robot that it is instead of the published one.

    Raises:
        UserError: interface, script, fault or model cannot be used.
    """
    from deploy.clock import take_precedence
    from deploy.dds import DdsParticipant
    from deploy.mischief import Mischief
    from deploy.script import Script
    from deploy.sim import Sim
    from deploy.sim_robot import SimRobot

    script = Script.parse(remote)
    if realtime:
        take_precedence()
    mischief = Mischief.parse(fault) if fault else None
    robot = SimRobot(hung=hung, machine=model)
    sim = Sim(DdsParticipant(interface, domain), script, mischief, robot)
    ended = [False]
    for s in (signal.SIGINT, signal.SIGTERM):
        signal.signal(s, lambda *_: ended.__setitem__(0, True))
    where = f"{'hangs' if robot.hung else 'lies'} at {interface}, DDS domain {domain}"
    print(f"a Go2 {where}; Ctrl-C ends", flush=True)
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
