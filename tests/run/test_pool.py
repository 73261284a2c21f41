"""Jobs side by side: each has an end of its own, and none outlives the run."""

from __future__ import annotations

import functools
import multiprocessing
import os
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import pytest

from wt.run.pool import at_once, side_by_side
from wt.run.study import Listener, Silent


def inverting(listener: Listener, index: int) -> Callable[[int], float]:
    """Does jobs that say what they do, one of which is an error."""

    def do(job: int) -> float:
        listener.progress(str(job), 1, 1)
        return 1 / job

    return do


class Said(Silent):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.jobs: set[str] = set()

    def progress(self, what: str, done: int, total: int) -> None:
        self.jobs.add(what)


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_ends_the_job_that_it_is_in(workers: int) -> None:
    ended, said = dict[int, Future[float]](), Said()
    side_by_side([4, 0, 2], workers, inverting, said, ended.__setitem__)
    assert {job: done.result() for job, done in ended.items() if job} == {4: 0.25, 2: 0.5}
    assert isinstance(ended[0].exception(), ZeroDivisionError)
    assert said.jobs == {"4", "0", "2"}
    assert multiprocessing.active_children() == []


def waiting(folder: Path, listener: Listener, index: int) -> Callable[[str], None]:
    """Does jobs that take for ever, and one that ends when the other has begun."""

    def do(job: str) -> None:
        if job == "short":
            while not (folder / "begun").exists():
                time.sleep(0.01)
            return
        try:
            (folder / "begun").touch()
            time.sleep(600)
        except KeyboardInterrupt:
            (folder / "put away").write_text(str(os.getpid()))
            raise

    return do


def test_ctrl_c_lets_jobs_put_away_what_they_have(tmp_path: Path) -> None:
    def ended(job: str, _: Future[None]) -> None:
        raise KeyboardInterrupt

    jobs = ["long", "short", "never begun"]
    with pytest.raises(KeyboardInterrupt):
        side_by_side(jobs, 2, functools.partial(waiting, tmp_path), Silent(), ended, grace=60.0)
    assert (tmp_path / "put away").read_text() != str(os.getpid())
    assert multiprocessing.active_children() == []


def test_the_number_of_processes() -> None:
    assert (at_once(3, 8), at_once(3, 2), at_once(0, 1)) == (3, 2, 1)
    assert at_once(0, 1000) == os.cpu_count()
