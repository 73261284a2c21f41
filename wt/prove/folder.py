"""The folder of a trial: its files, in the order of their publication.

=====================  =========================================================================
``plan.json``          the plan: set, seed, contenders, and the hash of the code
``key``                the key of the seals; nobody reads it before ``ledger.json`` is written
``manifest.json``      hashes of all files of all cases, and the commitments to their answers
``cases/ID/``          ``robot.xml``, ``fit-*.parquet``, ``holdout-*.parquet``, ``answer.sealed``
``diagnoses/WHO/ID/``  the diagnosis, and ``ran.json``
``ledger.json``        hashes of all diagnoses; with it the key is released
``answers.json``       the opened answers with their salts
``results.json``       the score; ``report.html`` and ``trials.rrd`` show it
=====================  =========================================================================
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from wt.errors import DataError, WorkError
from wt.prove.blind import ROOT
from wt.prove.seal import sha256
from wt.show.files import write_whole

SEALED = "answer.sealed"


@dataclass(frozen=True)
class Plan:
    """The plan of a trial.

    Attributes:
        set: of cases; "" for cases of others.
        only: pattern that names of cases match.
        seed: of the cases.
        who: the contenders.
        brought: folder of the cases of others, or "".
        code: hash of the package's source.
        machines: folder with recordings of real machines, or "".
    """

    set: str
    only: str
    seed: int
    who: tuple[str, ...]
    brought: str
    code: str
    machines: str = ""


class Folder:
    """A trial on disk."""

    def __init__(self, path: Path, plan: Plan) -> None:
        """Open it; see :meth:`begin` and :meth:`resume`."""
        self.path, self.plan = path, plan
        self.home = Path(plan.brought) if plan.brought else path
        """Folder of cases and manifest."""

    @classmethod
    def begin(cls, path: Path, plan: Plan) -> Folder:
        """Claim a folder for a trial.

        Raises:
            DataError: it is a file, or holds something.
        """
        if path.exists() and not path.is_dir():
            raise DataError(f"--out {path} is a file; name a folder, new or empty")
        if path.exists() and any(path.iterdir()):
            raise DataError(f"--out {path} is not empty; add --resume, or name another folder")
        path.mkdir(parents=True, exist_ok=True)
        write_json(path / "plan.json", asdict(plan))
        return cls(path, plan)

    @classmethod
    def resume(cls, path: Path) -> Folder:
        """Open the trial in a folder.

        Raises:
            DataError: there is none, or the code is no longer the one that it began with.
        """
        file = path / "plan.json"
        if not file.is_file():
            raise DataError(f"--resume: '{path}' holds no trial (plan.json is missing)")
        data = json.loads(file.read_text())
        plan = Plan(**(data | {"who": tuple(data["who"])}))
        if plan.code != code() and not (path / "ledger.json").exists():
            raise DataError(
                f"--resume: the code has changed since '{path}' was begun, and its score would be "
                "of neither; go back to that code, or begin anew with another --out"
            )
        return cls(path, plan)

    @property
    def cases(self) -> Path:
        """Folder of the cases."""
        return self.home / "cases"

    def said(self, who: str, name: str) -> Path:
        """Folder of a diagnosis."""
        return self.path / "diagnoses" / who / name

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Case → hashes of its files and commitment to its answer.

        Raises:
            DataError: it cannot be read, or a file is not the one it names.
        """
        file = self.home / "manifest.json"
        try:
            entries: dict[str, Any] = json.loads(file.read_text())["cases"]
            for name, entry in entries.items():
                for inner, expected in entry["files"].items():
                    if sha256(self.cases / name / inner) != expected:
                        raise DataError(f"'{self.cases / name / inner}' is not what {file} names")
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(
                f"'{file}' is no manifest of cases and their seals ({error}); "
                f"make one with: wt prove --bring {self.home} --seal ANSWERS.json"
            ) from error
        return entries

    @property
    def left_out(self) -> list[str]:
        """Names of the set's cases that could not be made."""
        manifest = json.loads((self.home / "manifest.json").read_text())
        return [str(name) for name in manifest.get("left_out", ())]

    def write_ledger(self) -> None:
        """Record all diagnoses, and the code that made them; afterwards the key may be read."""
        write_json(self.path / "ledger.json", {"code": code(), **self._recorded()})

    @property
    def ledger(self) -> dict[str, Any]:
        """The recorded hashes.

        Raises:
            WorkError: nothing is, or something was changed since.
        """
        file = self.path / "ledger.json"
        if not file.exists():
            raise WorkError("the key is not released: not every diagnosis is written")
        ledger: dict[str, Any] = json.loads(file.read_text())
        now = self._recorded()
        if any(ledger[key] != now[key] for key in now):
            raise WorkError(
                f"cases or diagnoses in '{self.path}' were changed after {file.name} was written; "
                "nothing is scored: begin anew with another --out"
            )
        return ledger

    def _recorded(self) -> dict[str, Any]:
        return {
            "manifest": sha256(self.home / "manifest.json"),
            "diagnoses": {who: self._hashes(who) for who in self.plan.who},
        }

    def _hashes(self, who: str) -> dict[str, dict[str, str]]:
        hashes = {}
        for name in self.manifest:
            said = self.said(who, name)
            files = sorted(said.iterdir()) if said.is_dir() else []
            hashes[name] = {file.name: sha256(file) for file in files}
        return hashes

    def keep_key(self, key: bytes) -> None:
        """Write the key where only its owner may read it."""
        file = self.path / "key"
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
            out.write(key.hex() + "\n")

    @property
    def kept_key(self) -> bytes | None:
        """The key that was kept, if any."""
        file = self.path / "key"
        return bytes.fromhex(file.read_text()) if file.exists() else None


def code() -> str:
    """SHA-256 of the package's source, names and contents."""
    digest = hashlib.sha256()
    for file in sorted((ROOT / "wt").rglob("*.py")):
        digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def write_json(path: Path, value: object) -> None:
    """Write a JSON file whole."""
    write_whole(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")
