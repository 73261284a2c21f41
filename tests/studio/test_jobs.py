"""A job that dies, fails or is stopped is a line; the server and the next job go on."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest

from tests.studio.conftest import TOKEN, Studio
from wt.studio.jobs import Job, Jobs


def test_a_parser_that_crashes_ends_its_job_alone(studio: Studio, cart: Path) -> None:
    studio.drop(cart / "model.xml")
    for number in range(20):  # enough to be met while it works
        studio.drop(cart / "1.parquet", f"{number}.parquet")
    studio.post("check")
    job = studio.jobs.latest("check")
    assert job is not None
    while "step" not in job.told:
        time.sleep(0.01)
    os.kill(job._process.pid, signal.SIGSEGV)
    studio.ended("check")
    assert job.state == "failed" and "\n" not in job.line
    assert "ended by SIGSEGV while checking logs/" in studio.get("live/check")
    for number in range(1, 20):
        (studio.session.folder / f"logs/{number}.parquet").unlink()
    studio.post("check")
    assert studio.ended("check").state == "done"


def test_what_is_unexpected_is_a_line(studio: Studio) -> None:
    job = studio.jobs.start("keep_map", log=7, fields={}, others={})
    job.wait(60.0)
    assert job.state == "failed" and job.line.startswith("unexpected TypeError")
    assert "\n" not in job.line


def test_a_new_job_ends_the_one_before(studio: Studio, cart: Path) -> None:
    studio.drop(cart / "model.xml")
    studio.drop(cart / "1.parquet")
    given = {"model": "model/model.xml", "fitted": ["logs/1.parquet"], "held": []}
    first = studio.jobs.start("diagnose", out="diagnosis", **given)
    while "step" not in first.told:
        time.sleep(0.01)
    second = studio.jobs.start("diagnose", out="diagnosis-2", **given)
    assert first.state == "stopped" and not first._process.is_alive()
    assert second.running and second.elapsed < 5.0
    assert "0 hypotheses decided" in studio.get("live/diagnosis")
    assert ">Stop</button>" in studio.get("")
    assert "Stopped after" in studio.post("stop")
    assert studio.session.diagnoses() == []
    assert not second._process.is_alive()


def test_a_second_tab_ends_no_diagnosis_of_the_first(studio: Studio, cart: Path) -> None:
    for name in ("model.xml", "1.parquet", "2.parquet"):
        studio.drop(cart / name)
    studio.post("check")
    studio.ended("check")
    studio.post("diagnosis", holdout="logs/2.parquet")
    first = studio.jobs.latest("diagnose")
    assert first is not None
    while "step" not in first.told:
        time.sleep(0.01)
    said = studio.post("diagnosis", holdout="logs/1.parquet")
    assert "a diagnosis runs already; stop it first" in said and ">Stop</button>" in said
    assert studio.jobs.latest("diagnose") is first and first.running
    for name in ("model/model.xml", "logs/1.parquet", "logs/2.parquet"):
        answer = studio.browser.post(f"/{TOKEN}/remove", data={"name": name})
        assert answer.status_code == 400 and "is being diagnosed" in answer.text
        assert studio.session.has(name)
    studio.post("stop")
    studio.post("remove", name="logs/1.parquet")
    assert not studio.session.has("logs/1.parquet")
    while (check := studio.jobs.latest("check")) and check.running:  # as a tab does that waits
        answer = studio.browser.get(f"/{TOKEN}/live/diagnosis")
        assert answer.status_code in (200, 204)
    assert ">Start the diagnosis</button>" in studio.get("live/diagnosis")


def test_how_long_a_job_took_is_known_once_it_is_stopped() -> None:
    job = Job("diagnose", began=time.monotonic() - 3.0)

    class Process:
        def terminate(self) -> None:
            assert job.state == "stopped" and job.elapsed >= 3.0

    job._process = Process()
    job.stop()
    assert 3.0 <= job.seconds < 60.0


def test_messages_are_json_and_nothing_else(tmp_path: Path, jobs: Jobs) -> None:
    """A parser that was taken over may say what it likes: here it is a text."""
    from wt.studio.jobs import _listen

    ours, theirs = jobs._context.Pipe(duplex=False)

    class Process:
        exitcode = 1

        def join(self) -> None:
            pass

    job = Job("check", _process=Process())
    theirs.send({"result": "by pickle"})
    theirs.send_bytes(json.dumps({"result": "too late"}).encode())
    theirs.close()
    _listen(job, ours)
    assert job.state == "failed" and job.result is None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"<mujoco><worldbody></mujoco>", "does not compile"),
        (b"\x00\xff\xfe", "does not compile"),
        (b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><mujoco/>', "has a DTD"),
        (b'<mujoco><include file="../../../../etc/hostname"/></mujoco>', "does not compile"),
    ],
)
def test_a_model_that_cannot_be_read_is_one_line(
    studio: Studio, cart: Path, content: bytes, said: str
) -> None:
    studio.browser.put(f"/{TOKEN}/files/bad.xml", content=content)
    studio.drop(cart / "1.parquet")
    studio.post("check")
    (line,) = studio.ended("check").result["errors"]
    assert said in line and "\n" not in line and "'model/bad.xml'" in line
    page = studio.get("live/check")
    assert line.replace("'", "&#39;").replace("<", "&lt;").replace(">", "&gt;") in page
    assert "logs/1.parquet" in studio.ended("check").result["forms"]
