"""A process that keeps what the runner records, so that the runner may be killed at any time.

If the pipe closes before the runner has written its own files, the scribe writes them: the
recording up to the last tick. A runner that has written them dismisses it.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from deploy import follower
from deploy.follower import Follower
from deploy.record import Recorder


def scribe(folder: Path, recorder: Recorder, meta: Mapping[str, object]) -> Follower:
    """Start the process.

    Args:
        folder: where it would write.
        recorder: whose rows it keeps.
        meta: free metadata of both files.
    """
    return Follower("deploy.scribe", [str(folder)], recorder, meta)


def main(folder: Path) -> None:
    """Read until the pipe closes, then write.

    Args:
        folder: where to.
    """
    stream = follower.told()
    header = follower.header(stream)
    width = len(header["columns"]["log"])
    kept = [np.empty((0, width)), *follower.rows(stream, width)]
    recorder = Recorder.restored(header["columns"], np.concatenate(kept))
    recorder.write(folder, {**header["meta"], "killed": True})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
