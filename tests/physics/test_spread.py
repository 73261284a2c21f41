"""Replays say the same to the bit wherever they run; what cannot run anywhere is one line."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import types
from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import mujoco
import numpy as np
import psutil
import pytest

from tests.physics.arm import ARM, commands, scene
from tests.physics.truths import TRUTHS
from wt.cli.main import main
from wt.diagnose import pipeline
from wt.diagnose.unknown.force import UnknownForce
from wt.diagnose.unknown.law import Atom, Law
from wt.errors import UserError
from wt.physics import workers
from wt.physics.acting import is_live
from wt.physics.effect import effects
from wt.physics.packed import PackedScene
from wt.physics.planted import Planted
from wt.physics.remembered import Remembered
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer, Replays
from wt.physics.runner import Threads, chosen, split
from wt.physics.scene import Scene
from wt.physics.spread import over
from wt.physics.workers import Workers
from wt.types import Location

Array = np.ndarray
Hypothesis = tuple[Planted, ...]


def planted(effect: str, kind: str, name: str, *theta: float) -> Planted:
    return Planted(effects()[effect], Location(kind, name), np.array(theta))  # type: ignore[arg-type]


def learned(terms: int) -> Planted:
    """A learned law of so many terms on joint j1."""
    kinds = ("linear", "sign", "square", "sin", "cos", "bump", "kink")
    atoms = [Atom(c, kind, 0.1, 0.3) for kind in kinds for c in (0, 1)]  # type: ignore[arg-type]
    used = tuple((a,) for a in atoms[:terms])
    weights = np.linspace(-0.3, 0.4, terms)
    law = Law(("qpos/j1", "qvel/j1"), np.full(2, -5.0), np.full(2, 5.0), used, weights)
    return Planted(UnknownForce(law, ""), Location("joint", "j1"), np.ones(1))


def hypotheses() -> list[Hypothesis]:
    """Every effect; laws that act at every step, also together; and what MuJoCo cannot replay."""
    here = [t for t in TRUTHS if t.model == ARM]
    known = [(Planted(effects()[t.id], t.at, np.array(t.theta)),) for t in here]
    together = permutations(
        [
            planted("joint.friction_stribeck", "joint", "j1", 0.3, 0.5, 0.1),
            planted("actuator.fade", "actuator", "m1", 0.3, 2.0),
            planted("actuator.speed_limit", "actuator", "m1", 5.0, 3.0),
        ]
    )
    explodes = planted("actuator.gain", "actuator", "m1", -1e7)
    refused = planted("body.mass", "body", "b1", -1.0)
    laws = [(learned(n),) for n in (3, 8, 13)]
    return [(), *known, *together, *laws, (explodes,), (refused,)]


def on_the_arm(folder: Path) -> Replayer:
    """Four stretches of two recordings, that overlap and leave gaps."""
    t, held = commands(0.5)
    pieces = [(0, 150), (100, 251), (200, 500), (600, 899)]
    stretches = [
        Stretch(i % 2, t[a:b], held[a:b], 0.1 * held[a], np.zeros(3))
        for i, (a, b) in enumerate(pieces)
    ]
    return Replayer(scene(folder, ARM), stretches, 1e-3)


@pytest.fixture(scope="module")
def replayer(tmp_path_factory: pytest.TempPathFactory) -> Replayer:
    return on_the_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def whole(replayer: Replayer) -> Replays:
    """As everybody gets it who chooses nothing."""
    return replayer.run(hypotheses())


def anew(replayer: Replayer) -> Replayer:
    """The same one, which has forgotten what it said."""
    replayer._known = Remembered()
    return replayer


def live() -> Hypothesis:
    return (planted("joint.friction_stribeck", "joint", "j1", 0.3, 0.5, 0.1),)


def same(a: Replays, b: Replays) -> bool:
    return a.q.tobytes() == b.q.tobytes() and a.v.tobytes() == b.v.tobytes()


def test_company_changes_no_bit(replayer: Replayer, whole: Replays) -> None:
    ends = np.cumsum([0, *(len(s.t) for s in replayer.stretches)])
    both = np.stack([whole.q, whole.v])
    assert np.isnan(both[:, -2:]).all()
    assert np.isfinite(both[:, :-2]).all()
    for h, hypothesis in enumerate(hypotheses()):
        for s, rows in enumerate(map(slice, ends, ends[1:])):
            alone = replayer.part([hypothesis], [s], 1)
            assert alone.tobytes() == both[:, [h], rows].tobytes(), (h, s)


@pytest.mark.parametrize("jobs", [1, "3"])
def test_threads_say_the_same(replayer: Replayer, whole: Replays, jobs: int | str) -> None:
    with over(1), over(None), over(jobs):
        runner = chosen()
        assert isinstance(runner, Threads if jobs == 1 else Workers)
        assert runner.count == int(jobs)
        assert same(anew(replayer).run(hypotheses()), whole)
    assert chosen() == Threads()


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Workers]:
    """Two that are given whatever has a live law."""
    monkeypatch.setattr(workers, "_WORTH_S", 0.0)
    monkeypatch.setattr(workers, "_WORTH_STEPS", 1)
    with over(2):
        runner = chosen()
        assert isinstance(runner, Workers)
        yield runner


def test_processes_say_the_same(
    processes: Workers, replayer: Replayer, whole: Replays, tmp_path: Path
) -> None:
    assert same(anew(replayer).run(hypotheses()), whole)
    one = next(i for i, h in enumerate(hypotheses()) if any(is_live(p.effect) for p in h))
    alone = anew(replayer).run(hypotheses()[one : one + 1])  # its stretches are divided
    assert same(alone, Replays(whole.q[[one]], whole.v[[one]]))
    others = [on_the_arm(tmp_path) for _ in range(workers._KEPT + 1)]
    for other in (*others, replayer):  # more than they keep
        assert same(anew(other).run(hypotheses()[one : one + 1]), alone)
    assert processes._processes and len(processes._processes) == 2


def test_a_process_that_is_gone_is_done_without(
    processes: Workers, replayer: Replayer, whole: Replays
) -> None:
    anew(replayer).run([live()])
    assert processes._processes
    for process in processes._processes:
        process._process.kill()
    assert same(anew(replayer).run(hypotheses()), whole)
    assert processes._processes is None


def test_without_a_second_process_it_is_done_here(
    processes: Workers, replayer: Replayer, whole: Replays, monkeypatch: pytest.MonkeyPatch
) -> None:
    started, begin = [], workers._Process

    def once() -> workers._Process:
        if started:
            raise BlockingIOError
        started.append(begin())
        return started[0]

    monkeypatch.setattr(workers, "_Process", once)
    assert same(anew(replayer).run(hypotheses()), whole)
    assert processes._processes is None
    assert started[0]._process.poll() is not None


def test_what_cannot_be_told_is_done_here(processes: Workers, replayer: Replayer) -> None:
    lock = threading.Lock()

    class Local(type(effects()["joint.friction_stribeck"])):  # type: ignore[misc]
        held = lock

    law = Planted(Local(), Location("joint", "j1"), np.array([0.3, 0.5, 0.1]))
    assert same(anew(replayer).run([(law,)]), anew(replayer).run([live()]))
    assert processes._processes is None


def test_what_is_unknown_there_is_done_here(
    processes: Workers,
    replayer: Replayer,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """A law of a module that only this process can import."""
    here = types.ModuleType("only_here")
    law = type("Law", (type(effects()["joint.friction_stribeck"]),), {"__module__": "only_here"})
    monkeypatch.setattr(here, "Law", law, raising=False)
    monkeypatch.setitem(sys.modules, "only_here", here)
    own = Planted(law(), Location("joint", "j1"), np.array([0.3, 0.5, 0.1]))
    assert same(anew(replayer).run([(own,)]), anew(replayer).run([live()]))
    assert processes._processes is None
    assert capfd.readouterr().err == ""


def test_what_a_process_raises_is_raised(processes: Workers, replayer: Replayer) -> None:
    nowhere = replace(live()[0], at=Location("joint", "none"))
    with pytest.raises(KeyError):
        replayer.run([(nowhere,)])
    assert np.isfinite(anew(replayer).run([live()]).q).all()


def test_processes_end_with_their_parent(tmp_path: Path) -> None:
    """However it ends."""
    code = """
import sys, os, signal
from pathlib import Path
from tests.physics.test_spread import live, on_the_arm
from wt.physics import workers
from wt.physics.runner import chosen
from wt.physics.spread import over
workers._WORTH_S, workers._WORTH_STEPS = 0.0, 1
with over(2):
    on_the_arm(Path(sys.argv[1])).run([live()])
    print(*(p._process.pid for p in chosen()._processes), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""
    made = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True
    )
    pids = [int(pid) for pid in made.stdout.split()]
    assert len(pids) == 2, made.stderr
    gone = psutil.wait_procs([psutil.Process(p) for p in pids if psutil.pid_exists(p)], timeout=20)
    assert not gone[1]


@pytest.mark.parametrize("sizes", [(1, 1, 1), (7, 3, 2), (2, 5, 16), (1, 9, 4), (5, 1, 64)])
def test_every_replay_is_in_one_part(sizes: tuple[int, int, int]) -> None:
    hypotheses, stretches, cores = sizes
    count = np.zeros((hypotheses, stretches), int)
    parts = split(*sizes)
    for some, run in parts:
        count[some, run] += 1
    assert (count == 1).all()
    assert len(parts) >= min(cores, hypotheses * stretches) // 2
    assert len(parts) < 2 * cores


def test_a_model_travels_with_its_files(tmp_path: Path) -> None:
    here, away = tmp_path / "here", tmp_path / "away"
    for folder in (here / "robot", here / "meshes", away):
        folder.mkdir(parents=True)
    (here / "meshes" / "m.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    (here / "robot" / "parts.xml").write_text(
        '<mujoco><asset><mesh name="m" file="m.obj"/></asset></mujoco>'
    )
    main_file = here / "robot" / "robot.xml"
    main_file.write_text(
        '<mujoco><compiler meshdir="../meshes"/><include file="parts.xml"/><worldbody><body>'
        '<joint name="j"/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    before = mujoco.MjModel.from_xml_path(str(main_file))
    packed = PackedScene.of(Scene(main_file))
    assert packed.unpacked(lambda: away).path == main_file  # the files are here
    here.rename(tmp_path / "gone")
    after = packed.unpacked(lambda: away).model
    assert after.body_inertia.tobytes() == before.body_inertia.tobytes()


def test_a_model_travels_as_it_is_amended(tmp_path: Path) -> None:
    """What an audit mended in it stays so wherever replays run."""
    path = tmp_path / "robot.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>'
    )

    def weightless(spec: mujoco.MjSpec) -> None:
        spec.option.gravity = np.zeros(3)

    arrived = PackedScene.of(Scene(path, [weightless])).unpacked(lambda: tmp_path)
    assert not arrived.model.opt.gravity.any()


# -- the command ---------------------------------------------------------------------------------


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Where replays would have run; the analysis is replaced by a failure."""
    found: list[object] = []

    def analysis(*_: object, **__: object) -> None:
        found.append(chosen())
        raise UserError("that is all")

    monkeypatch.setattr(pipeline, "diagnose", analysis)
    monkeypatch.setenv("WT_DEBUG", "0")
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    return found


def refusal(jobs: str, capsys: pytest.CaptureFixture[str], code: int = 2) -> str:
    """The one line of a command that was refused, with an exit code."""
    words = ["diagnose", "m.xml", "a.parquet", "--out", "nowhere", f"--jobs={jobs}"]
    assert main(words) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


def test_the_option_reaches_the_replays(
    asked: list[object], capsys: pytest.CaptureFixture[str]
) -> None:
    assert refusal("3", capsys) == "error: that is all\n"
    (runner,) = asked
    assert isinstance(runner, Workers) and runner.count == 3


@pytest.mark.parametrize("jobs", ["0", "-2", "1.5", "many", "Ray", ""])
def test_wrong_jobs_are_refused(
    jobs: str, asked: list[object], capsys: pytest.CaptureFixture[str]
) -> None:
    assert f"jobs '{jobs}': give a number of cores from 1 up, or 'ray'" in refusal(jobs, capsys)
    assert asked == []


def test_without_ray_the_extra_is_named(
    asked: list[object], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert "pip install '.[scale]'" in refusal("ray", capsys, code=1)
    assert asked == []


def test_a_cluster_that_nobody_runs_is_refused(
    asked: list[object], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ray.is_initialized", lambda: False)
    with socket.socket() as nobody:  # bound, but not listening
        nobody.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{nobody.getsockname()[1]}"
        monkeypatch.setenv("RAY_ADDRESS", address)
        assert f"RAY_ADDRESS '{address}': [Errno" in refusal("ray", capsys)
    monkeypatch.setenv("RAY_ADDRESS", "head")
    assert "'head' is neither HOST:PORT" in refusal("ray", capsys)
    assert asked == []
