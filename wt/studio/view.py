"""What the page shows: how the session and its jobs stand, in the words of the page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from wt.show.text import tied
from wt.studio.jobs import Job, Jobs
from wt.studio.mapping import TIME, UNITS
from wt.studio.session import Session
from wt.studio.uploads import MB

VERDICTS = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unexplained": "Unexplained",
    "no_mismatch": "No mismatch",
}


class View:
    """For the templates, which read it and change nothing."""

    units = tuple(UNITS)
    time = TIME

    def __init__(self, session: Session, jobs: Jobs, limit: int) -> None:
        """Look at a session.

        Args:
            session: its folder.
            jobs: that work in it.
            limit: size of an upload [bytes].
        """
        self.session, self._jobs = session, jobs
        self.limit = f"{limit / MB:.4g} MB"

    def job(self, work: str) -> Job | None:
        """The last job of a work, if there was one."""
        return self._jobs.latest(work)

    @property
    def checked(self) -> dict[str, Any]:
        """What the last check found; empty if there was none, or it failed."""
        job = self.job("check")
        return job.result if job is not None and job.state == "done" else {}

    @property
    def recordings(self) -> list[str]:
        """What may be diagnosed."""
        return list(self.checked.get("checked", ())) if self.session.model() else []

    @property
    def commands(self) -> list[str]:
        """The commands that check what is here."""
        return self.session.checking(self.checked.get("doubts", {}))

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Findings of the last check that are sure."""
        return [f for f in self.checked.get("findings", ()) if f["sure"]]

    def form(self, log: str, fixes: bool) -> tuple[str, dict[str, Any]] | None:
        """A log and its columns: the one that is asked for, else one that waits for its map.

        Args:
            log: its file.
            fixes: whether with what the check proposes.
        """
        forms = self.checked.get("forms", {})
        waiting = (each for each in self.checked.get("doubts", {}) if each in forms)
        name = log if log in forms else next(waiting, next(iter(forms), None))
        if name is None:
            return None
        return name, (self.checked["proposed"].get(name) if fixes else None) or forms[name]

    @property
    def diagnosis(self) -> dict[str, Any] | None:
        """The latest diagnosis, with the folder that it is in."""
        for out in reversed(self.session.diagnoses()):
            try:
                text = (self.session.folder / out / "diagnosis.json").read_text(encoding="utf-8")
                said = json.loads(text)
                return {
                    "out": out,
                    "verdict": VERDICTS[said["verdict"]],
                    "good": said["verdict"] in ("explained", "no_mismatch"),
                    "lines": [tied(f["statement"]) for f in said["findings"]],
                    "report": self.session.has(f"{out}/report.html"),
                }
            except (OSError, ValueError, KeyError, TypeError):
                continue
        return None

    def size(self, name: str) -> str:
        """How large a file or folder is."""
        path = self.session.folder / name
        files = [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]
        size = sum(p.stat().st_size for p in files)
        return f"{size / MB:.1f} MB" if size >= MB / 10 else f"{size / 1024:.1f} kB"

    def name(self, path: str) -> str:
        """A file without the folder of the session that it is in."""
        return path.partition("/")[2]

    def stem(self, path: str) -> str:
        """The last part of a path."""
        return Path(path).name

    def number(self, value: float) -> str:
        """A number as one would type it."""
        return f"{value + 0.0:.12g}"  # no −0
