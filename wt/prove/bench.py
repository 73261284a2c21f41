"""The trial from beginning to end: make and seal, diagnose blind, record, open, mark.

Every phase leaves its work on disk and finds it again, so that an interrupted trial is continued.
The key of the seals is read in one place, :func:`opened`, which first makes sure that everything
that was claimed is in the ledger and unchanged.
"""

from __future__ import annotations

import fnmatch
import hmac
import json
import multiprocessing
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from wt.data import recording as recordings
from wt.errors import ConfigError
from wt.prove import blind, contenders, fleet, real
from wt.prove.answer import Answer, from_json, of_case
from wt.prove.asked import AskedMachine
from wt.prove.blind import DiagnosisJob
from wt.prove.case import Case
from wt.prove.cases import cases
from wt.prove.fleet import FleetCase
from wt.prove.folder import SEALED, Folder, write_json
from wt.prove.seal import new_key, seal, sha256, unseal
from wt.prove.visibility import visibilities
from wt.prove.world import FallsError, build

Report = Callable[[str, float], None]
"""Called with the current step, and the share of all work that is done, 0…1."""

_BUILT, _DIAGNOSED = 0.1, 0.95
"""Shares of all work after which cases are built and diagnosed."""


def chosen(set: str, only: str, seed: int) -> list[Case | FleetCase]:
    """The cases of a set whose names match a pattern, or contain it.

    Raises:
        ConfigError: there is no such set, or none matches.
    """
    pattern = only if "*" in only else f"*{only}*"
    drawn = fleet.fleets(seed) if set == "fleet" else cases(set, seed)
    matches = [case for case in drawn if fnmatch.fnmatch(case.name, pattern)]
    if not matches:
        raise ConfigError(
            f"--only '{only}' matches no case of the set '{set}'; "
            "give a part of a case's name, such as 'arm6-joint.backlash'"
        )
    return matches


def make(folder: Folder, jobs: int, say: Report) -> None:
    """Build the cases that are not there yet, seal their answers, and publish the manifest.

    Raises:
        FallsError: no robot can stand with the effects hidden in it; if some can, the others' cases
            are left out, and the manifest names them.
    """
    if folder.plan.brought or (folder.path / "manifest.json").exists():
        return
    key = folder.kept_key
    if key is None:
        key = new_key()
        folder.keep_key(key)
    planned = chosen(folder.plan.set, folder.plan.only, folder.plan.seed)
    missing = [case for case in planned if not (folder.cases / alias(case.name, key)).exists()]
    done, fallen = len(planned) - len(missing), []
    with workers(min(jobs, len(missing))) as pool:
        made = {pool.submit(make_one, c, folder.cases, key): c.name for c in missing}
        for future in as_completed(made):
            try:
                future.result()
            except FallsError:
                fallen.append(made[future])
                if len(fallen) == len(planned):
                    raise
            done += 1
            say(f"made {done} of {len(planned)} cases", _BUILT * done / len(planned))
    _take_in(folder, key)
    publish(folder.path, sorted(fallen))


def _take_in(folder: Folder, key: bytes) -> None:
    """Write the cases of real machines, if they take part."""
    home = Path(folder.plan.machines)
    for machine in real.present(home) if folder.plan.machines else ():
        name = alias(machine.name, key)
        if not (folder.cases / name).exists():
            part = folder.cases / f".{name}.part"
            write_sealed(part, name, real.write_case(machine, home, part), key)
            part.rename(folder.cases / name)


def publish(home: Path, left_out: Sequence[str] = ()) -> None:
    """Write the manifest of the cases in a folder; each has its commitment beside its seal.

    Args:
        home: the folder.
        left_out: names of cases that cannot be made.
    """
    entries = {}
    for case in sorted(path for path in (home / "cases").iterdir() if path.name[0] != "."):
        files = [file for file in sorted(case.iterdir()) if file.name != "commitment"]
        entries[case.name] = {
            "files": {file.name: sha256(file) for file in files},
            "commitment": (case / "commitment").read_text().strip(),
        }
    said = {"left_out": list(left_out)} if left_out else {}
    write_json(home / "manifest.json", {"schema": 1, "cases": entries, **said})


def alias(name: str, key: bytes) -> str:
    """A case's name while it is sealed; neither it nor the order of all names reveals anything."""
    return f"case-{hmac.digest(key, name.encode(), 'sha256').hex()[:8]}"


def make_one(case: Case | FleetCase, folder: Path, key: bytes) -> None:
    """Simulate a case and write its visible files, with its answer sealed.

    Raises:
        FallsError: the robot falls whatever it does.
    """
    name = alias(case.name, key)
    part = folder / f".{name}.part"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        write_sealed(part, name, write_files(case, part), key)
    except FallsError:
        part.rmdir()  # nothing is written before the robot stands
        raise
    part.rename(folder / name)


def write_files(case: Case | FleetCase, part: Path) -> Answer:
    """Simulate a case and write its visible files into a folder; returns its answer."""
    if isinstance(case, FleetCase):
        return fleet.write_files(case, part)
    world = build(case)
    (part / "robot.xml").write_text(world.nominal_xml)
    meta = {"robot": case.rig, "source": "concealed trial"}
    for kind, recorded in (("fit", world.fit), ("holdout", world.holdout)):
        for i, recording in enumerate(recorded, 1):
            recordings.write(replace(recording, meta=meta), part / f"{kind}-{i}.parquet")
    return of_case(case, visibilities(case, world.calm), world.noise_rms)


def write_sealed(case: Path, name: str, answer: Answer, key: bytes) -> None:
    """Write an answer's seal and the commitment to it into a case's folder."""
    sealed, committed = seal(answer.to_json(), name, key)
    (case / SEALED).write_bytes(sealed)
    (case / "commitment").write_text(committed + "\n")


def diagnose(folder: Folder, jobs: int, say: Report) -> None:
    """Run every contender on every case, blind, and record the diagnoses."""
    if (folder.path / "ledger.json").exists():
        return
    diagnoses = [(who, name) for who in folder.plan.who for name in folder.manifest]
    done = 0
    with workers(jobs) as pool:
        # others after us: they have the time that we took, or as many experiments
        for who in folder.plan.who:
            asked = _machines(folder, pool) if who == contenders.ASK else {}
            missing = [
                _job(folder, who, name, asked.get(name))
                for name in folder.manifest
                if not folder.said(who, name).exists()
            ]
            done += len(folder.manifest) - len(missing)
            for _ in blind.run(missing, jobs):
                done += 1
                share = _BUILT + (_DIAGNOSED - _BUILT) * done / len(diagnoses)
                say(f"{done} of {len(diagnoses)} diagnoses", share)
    folder.write_ledger()


def _machines(folder: Folder, pool: Executor) -> dict[str, AskedMachine]:
    """The hidden machine of every case: who is asked knows it, and the key that names the cases."""
    key = folder.kept_key
    assert key is not None, "the cases were made with it"
    planned = chosen(folder.plan.set, folder.plan.only, folder.plan.seed)
    return {alias(c.name, key): AskedMachine(c, pool) for c in planned if isinstance(c, Case)}


def _job(folder: Folder, who: str, name: str, machine: AskedMachine | None) -> DiagnosisJob:
    budget, experiments = contenders.LIMIT_S, 0
    if who not in contenders.OWN and contenders.OURS in folder.plan.who:
        budget = ran(folder, contenders.OURS, name)["seconds"]
    if who in contenders.ASKING and who != contenders.ASK:
        experiments = ran(folder, contenders.ASK, name)["experiments"]
    return DiagnosisJob(
        case=folder.cases / name,
        out=folder.said(who, name),
        program=contenders.program(who, budget, experiments),
        closed=contenders.closed(who, folder.path, folder.home),
        limit_s=contenders.limit(who, budget),
        product=contenders.product(who),
        machine=machine,
    )


def ran(folder: Folder, who: str, name: str) -> dict[str, Any]:
    """Outcome of a diagnosis: ``seconds``, ``error``, and what was asked of the machine."""
    outcome: dict[str, Any] = json.loads((folder.said(who, name) / blind.RAN).read_text())
    return outcome


def opened(folder: Folder, key: bytes | None = None) -> dict[str, Answer]:
    """Open the seals, now that all diagnoses are written: the answer of every case.

    Args:
        folder: the trial.
        key: that of cases of others; our own is in the folder.

    Raises:
        WorkError: not everything is recorded, or was changed since.
        DataError: the key is not the right one, or an answer cannot be read.
    """
    _ = folder.ledger  # refuses where something is missing or was changed
    key = key or folder.kept_key
    if key is None:
        raise ConfigError("the seals are not ours: give --key, as those who sealed them have it")
    answers, shown = {}, {}
    for name, entry in folder.manifest.items():
        sealed = (folder.cases / name / SEALED).read_bytes()
        inside, salt = unseal(sealed, name, key, entry["commitment"])
        answers[name] = from_json(inside, name)
        shown[name] = {"salt": salt, "answer": inside}
    write_json(folder.path / "answers.json", {"key": key.hex(), "cases": shown})
    return answers


@contextmanager
def workers(count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that leave Ctrl-C to us; what they have not begun is dropped then."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(count, 1), context, _deaf) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _deaf() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
