"""The folder of a session: what was dropped, what was made of it, and the commands that would too.

::

    model/        as dropped; one of its .xml files is the model
    logs/         as dropped
    maps/         one for each log whose columns were mapped: wt import --map
    recordings/   what wt import makes of logs
    check/        check.html
    diagnosis/    what wt diagnose writes; diagnosis-2, … later ones
    session.json  which of the models it is
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import tempfile
import time
import zipfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from wt.data.importers.base import importers
from wt.errors import UserError
from wt.show.files import write_whole

STATE = "session.json"
MODEL, LOGS, MAPS, RECORDINGS, CHECK = "model", "logs", "maps", "recordings", "check"
DIAGNOSIS = "diagnosis"
MODELS = (".xml", ".mjcf", ".urdf")
"""Endings of files that may be the model; others in its folder are what it includes."""
_INCLUDE = re.compile(rb"""<include\s[^>]*file\s*=\s*["']([^"']+)""")


class Session:
    """One folder.

    Attributes:
        folder: where it is.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Make the folder, or go on in one of an earlier session.

        Args:
            folder: new, empty, or of an earlier session; a new one named after the time if None.

        Raises:
            UserError: it holds something else, or cannot be made.
        """
        self.folder = _fresh() if folder is None else folder
        if self.folder.exists() and not self.folder.is_dir():
            raise UserError(f"--dir {self.folder} is a file; name a folder")
        if self.folder.is_dir() and any(self.folder.iterdir()) and not self._state_file.is_file():
            raise UserError(
                f"--dir {self.folder} holds what no wt studio wrote; name a new or empty folder, "
                "or that of an earlier session"
            )
        try:
            for name in (MODEL, LOGS, MAPS, RECORDINGS):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
            if not self._state_file.is_file():
                self._keep({"model": None})
        except OSError as error:
            raise UserError(
                f"--dir {self.folder} cannot be written ({error.strerror}); name another folder"
            ) from error
        self.folder = self.folder.resolve()

    @property
    def _state_file(self) -> Path:
        return self.folder / STATE

    def _keep(self, state: dict[str, object]) -> None:
        write_whole(self._state_file, json.dumps(state, indent=2) + "\n")

    def models(self) -> list[str]:
        """Files that may be the model, relative to the folder.

        Those come first that no other includes, and of them those nearest to the top.
        """
        files = [f for f in self._files(MODEL) if Path(f).suffix.lower() in MODELS]
        texts = {f: (self.folder / f).read_bytes() for f in files}
        included = {Path(os.fsdecode(n)).name for t in texts.values() for n in _INCLUDE.findall(t)}
        return sorted(files, key=lambda f: (Path(f).name in included, f.count("/"), f))

    def model(self) -> str | None:
        """The model, relative to the folder: as chosen, else the first; None if there is none."""
        models = self.models()
        try:
            chosen = json.loads(self._state_file.read_text(encoding="utf-8")).get("model")
        except (OSError, ValueError, AttributeError):
            chosen = None
        return chosen if chosen in models else next(iter(models), None)

    def choose(self, model: str) -> None:
        """Take one of :meth:`models` for the model.

        Raises:
            UserError: it is none of them.
        """
        if model not in self.models():
            raise UserError(f"{model!r} is none of the models that were dropped")
        self._keep({"model": model})

    def assets(self) -> list[str]:
        """What else lies in the model's folder."""
        return [f for f in self._files(MODEL) if f not in self.models()]

    def logs(self) -> list[str]:
        """Logs, relative to the folder: files, and folders of a format that an importer knows."""
        return sorted(p.relative_to(self.folder).as_posix() for p in _logs(self.folder / LOGS))

    def map_of(self, log: str) -> str:
        """Where the map of a log is, or would be."""
        return f"{MAPS}/{_flat(log)}.yaml"

    def recording_of(self, log: str) -> str:
        """Where the recording that is made of a log is: the log itself if it is one unchanged."""
        if Path(log).suffix.lower() == ".parquet" and not self.has(self.map_of(log)):
            return log
        return self._made_of(log)

    def _mapped(self, log: str) -> bool:
        return self.has(self.map_of(log))

    def _made_of(self, log: str) -> str:
        name = _flat(log)
        return f"{RECORDINGS}/{name if name.endswith('.parquet') else f'{name}.parquet'}"

    def recordings(self) -> list[str]:
        """Recordings that are there, of all logs."""
        return [r for r in map(self.recording_of, self.logs()) if self.has(r)]

    def has(self, name: str) -> bool:
        """Tell whether a file is there."""
        return (self.folder / name).is_file()

    def diagnoses(self) -> list[str]:
        """Folders of diagnoses that were finished, the latest last."""
        found = [p for p in _visible(self.folder) if p.name.startswith(DIAGNOSIS)]
        done = [p.name for p in found if (p / "diagnosis.json").is_file()]
        return sorted(done, key=_number)

    def next_diagnosis(self) -> str:
        """Name of a folder for a diagnosis that is to come."""
        number = max(map(_number, self.diagnoses()), default=0) + 1
        return DIAGNOSIS if number == 1 else f"{DIAGNOSIS}-{number}"

    def checking(self, guessed: Collection[str] = ()) -> list[str]:
        """The commands that import the logs and check all.

        Args:
            guessed: logs that need a map and have none yet.
        """
        lines = []
        model = self.model()
        for log in self.logs():
            recording, mapping = self.recording_of(log), self.map_of(log)
            if log in guessed and not self._mapped(log):
                of = ["--model", model] if model else []
                lines.append(_line("import", [log, "--guess", *of, "--to", mapping]))
                continue
            if recording != log:
                mapped = ["--map", mapping] if self.has(mapping) else []
                lines.append(_line("import", [log, *mapped, "--to", recording]))
        made = [self.recording_of(r) for r in self.logs() if r not in guessed or self._mapped(r)]
        given = [*filter(None, [model]), *made]
        return [*lines, _line("check", [*given, "--out", CHECK])] if given else lines

    def diagnosing(self, fitted: Sequence[str], held: Sequence[str], out: str) -> list[str]:
        """The command of a diagnosis."""
        holdout = ["--holdout", *held] if held else []
        return [_line("diagnose", [self.model() or "", *fitted, *holdout, "--out", out])]

    def remove(self, name: str) -> None:
        """Take away a file that was dropped, which is a copy, and what was made of it.

        Raises:
            UserError: it is none of them.
        """
        if name not in (*self.models(), *self.assets(), *self.logs()):
            raise UserError(f"{name!r} is none of the files that were dropped")
        path = self.folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
        if name.startswith(f"{LOGS}/"):
            for made in (self.map_of(name), self._made_of(name)):
                (self.folder / made).unlink(missing_ok=True)

    def output(self, name: str) -> Path:
        """A page that a command wrote.

        Raises:
            UserError: there is none of this name.
        """
        pages = [f"{CHECK}/check.html", *(f"{d}/report.html" for d in self.diagnoses())]
        if name not in pages or not self.has(name):
            raise UserError(f"no command wrote {name!r}")
        return self.folder / name

    def packed(self) -> Path:
        """All of it in a .zip, outside the folder; the caller removes it."""
        handle, name = tempfile.mkstemp(suffix=".zip")
        os.close(handle)
        with zipfile.ZipFile(name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for path in sorted(self.folder.rglob("*")):
                inside = path.relative_to(self.folder)
                if path.is_file() and not any(p.startswith(".") for p in inside.parts):
                    archive.write(path, Path(self.folder.name) / inside)
        return Path(name)

    def _files(self, part: str) -> list[str]:
        top = self.folder / part
        found = [p for p in top.rglob("*") if p.is_file() and not p.name.startswith(".")]
        return sorted(p.relative_to(self.folder).as_posix() for p in found)


def _line(command: str, words: Sequence[str]) -> str:
    return shlex.join(["wt", command, *words])


def _visible(folder: Path) -> list[Path]:
    return [p for p in folder.iterdir() if not p.name.startswith(".")]


def _logs(folder: Path) -> Iterator[Path]:
    """Logs below a folder."""
    known = importers().values()
    for path in _visible(folder):
        if path.is_file() or any(importer.recognises(path) for importer in known):
            yield path
        else:
            yield from _logs(path)


def _flat(log: str) -> str:
    """A log's name in one part, whatever folder it is in."""
    return "-".join(Path(log).parts[1:])


def _number(diagnosis: str) -> int:
    number = diagnosis.removeprefix(DIAGNOSIS).lstrip("-")
    return int(number) if number.isdecimal() else 1


def _fresh() -> Path:
    stem = f"studio-{time.strftime('%Y-%m-%dT%H-%M-%S')}"
    names = [stem, *(f"{stem}-{i}" for i in range(2, 100))]
    return next(path for path in map(Path, names) if not path.exists())
