"""A process that tells the operator when the robot is no longer the one in its passport.

It follows the runner as the scribe does, judges every ten seconds of positions that were held
(:mod:`wt.passport.live`), keeps ``drift.json`` up to date, and says a line when joints err more
than they did. What takes long at first, the passport's own recordings, is done before the run
begins. From then on it works only where nobody else wants the processor, and looks twice a second
at what has come, so that no tick has to wake it: it may be late, and then leaves out what it has no
time for.
"""

from __future__ import annotations

import hashlib
import json
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from io import BufferedReader
from pathlib import Path

import numpy as np

from deploy import follower
from deploy.follower import Follower
from deploy.record import Recorder
from wt.errors import RecordingError, UserError
from wt.passport import folder as passports
from wt.passport.folder import Passport
from wt.passport.live import Judgement, Live, reference
from wt.show.files import write_together

DRIFT = "drift.json"
SECONDS = 10.0
"""What is judged at once [s]."""
_POLL_S, _KEPT_S = 0.5, 60.0  # between two looks at what has come; of which so much is kept


def watch(
    folder: Path, passport: Path, unit: str, model: Path, recorder: Recorder, load: str = ""
) -> Follower:
    """Start the process, and wait until it has replayed what it compares with.

    Args:
        folder: of the run, for ``drift.json``.
        passport: the robot's.
        unit: which of its units this is; "" for the only one.
        model: the MJCF of the run.
        recorder: whose rows it judges.
        load: what the unit carries; "" for nothing, or the only load that it ever carried.

    Raises:
        UserError: the passport is of another model, or lacks the unit, the load or its recordings.
    """
    known = passports.read(passport)
    _refuse(known, passport, model)
    labels, _ = reference(known, unit, load)
    words = [str(folder), str(passport), labels.unit, str(model), labels.load]
    print(f"replaying {labels}, to compare the robot with it", file=sys.stderr, flush=True)
    follower = Follower("deploy.drift", words, recorder, {})
    follower.await_ready()
    return follower


def _refuse(known: Passport, passport: Path, model: Path) -> None:
    if not known.additions:
        raise UserError(f"--passport {passport} holds no passport; make one with wt passport add")
    given = hashlib.sha256(model.read_bytes()).hexdigest()
    if known.additions[0].model_sha256 != given:
        raise UserError(
            f"--passport {passport} is of another model than this robot's; add recordings with the "
            f"one that wt-run leaves, {model.name}"
        )


class Incoming:
    """Rows that have come and were not judged yet; they come while others are judged."""

    def __init__(self, columns: Mapping[str, list[str]]) -> None:
        """Nothing has come yet."""
        self._columns, self._rows = columns, [np.empty((0, len(columns["log"])))]
        self._end, self._ended = threading.Condition(), False

    def add(self, rows: np.ndarray) -> None:
        """Take rows of the log."""
        with self._end:
            self._rows.append(rows)

    def end(self) -> None:
        """No more will come."""
        with self._end:
            self._ended = True
            self._end.notify()

    def latest(self) -> Recorder | None:
        """The latest :data:`SECONDS` that were recorded, once there are so many; None at the end.

        What came before them is left out: nobody is helped by a judgement that is late.
        """
        due = SECONDS
        while True:
            with self._end:
                ended = self._end.wait_for(lambda: self._ended, _POLL_S)
                rows = np.concatenate(self._rows)
                rows = rows[rows[:, 0] >= rows[-1, 0] - _KEPT_S] if len(rows) else rows
                self._rows = [rows]
            span = float(np.ptp(rows[:, 0])) if len(rows) else 0.0
            if span >= due or ended:
                if Recorder.restored(self._columns, rows).recorded_s >= SECONDS:
                    with self._end:  # and what has come since
                        self._rows[0] = rows[:0]
                    latest = rows[rows[:, 0] >= rows[-1, 0] - SECONDS]
                    return Recorder.restored(self._columns, latest)
                due = span + 1.0  # limp in between: there has to be more
            if ended:
                return None


def main(
    stream: BufferedReader, folder: Path, passport: Path, unit: str, model: Path, load: str = "",
    ready: Callable[[], None] | None = None,
) -> None:  # fmt: skip
    """Judge until the pipe closes.

    Args:
        stream: what a :class:`~deploy.follower.Follower` sends.
        folder: where ``drift.json`` is written.
        passport: folder of the passport.
        unit: name of the unit.
        model: the MJCF.
        load: what the unit carries.
        ready: called once the passport's own recordings are replayed.
    """
    columns = follower.header(stream)["columns"]
    incoming = Incoming(columns)

    def read() -> None:
        for rows in follower.rows(stream, len(columns["log"])):
            incoming.add(rows)
            time.sleep(_POLL_S)  # the pipe holds more
        incoming.end()

    threading.Thread(target=read, daemon=True).start()
    try:
        live = Live(passports.read(passport), model, unit, load)
    except UserError as error:
        print(f"no drift is watched: {error}", file=sys.stderr, flush=True)
        return
    if ready is not None:
        ready()
    judgements: list[dict[str, object]] = []
    said: tuple[str, ...] = ()
    while (recorder := incoming.latest()) is not None:
        t = recorder.ticks()["t"]
        judgement = _judged(live, recorder)
        judgements.append({"from": float(t[0]), "to": float(t[-1]), **judgement.to_json()})
        about = {"passport": str(passport), **asdict(live.labels)}
        text = json.dumps({**about, "judgements": judgements}, indent=1) + "\n"
        write_together(folder, {DRIFT: text})
        if judgement.changed and judgement.changed != said:
            print(judgement.line(unit), file=sys.stderr, flush=True)
        said = judgement.changed


def _judged(live: Live, recorder: Recorder) -> Judgement:
    try:
        return live.judge(recorder.recording())
    except RecordingError as error:
        return Judgement({}, 1.0, (), str(error))


if __name__ == "__main__":
    out, its_passport, its_unit, its_model, its_load = sys.argv[1:]
    what = its_unit, Path(its_model), its_load
    main(follower.told(), Path(out), Path(its_passport), *what, ready=follower.ready)
