"""Ray in processes of its own: where it does not start, it takes nobody with it.

Ray's core ends the process that called it when its daemon dies, and waits for minutes for one that
does not answer; so no test calls it here.
"""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

START_S, WORK_S = 120.0, 240.0

_STARTS = """
import ray
ray.init("local", include_dashboard=False, log_to_driver=False, logging_level="ERROR")
assert ray.get(ray.remote(lambda: 1).remote()) == 1
ray.shutdown()
"""
_IMPORTS = """
import sys
from pathlib import Path
import numpy as np
from tests.physics.arm import commands, scene
from tests.physics.test_spread import anew, hypotheses, on_the_arm, same
from wt import cluster
from wt.errors import UserError
from wt.physics.cluster import Cluster
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer, Replays
from wt.physics.runner import chosen
from wt.physics.spread import over
folder = Path(sys.argv[1])
"""
_SAME = """
replayer = on_the_arm(folder)
whole = replayer.run(hypotheses())
cluster._connect("local")
with over("ray"):
    assert isinstance(chosen(), Cluster)
    assert same(anew(replayer).run(hypotheses()), whole)
    one = anew(replayer).run(hypotheses()[5:6])
    assert same(one, Replays(whole.q[5:6], whole.v[5:6]))
    assert replayer.run([]).q.shape == (0, *whole.q.shape[1:])
import ray
assert ray.is_initialized()  # what was there before stays
"""
_RAISES = """
import wt.physics.cluster as replays
versions = cluster.versions()
replays.versions = lambda: {**versions, "mujoco": "1.50"}
with over("ray"):
    try:
        on_the_arm(folder).run([()])
    except UserError as error:
        print(error)
"""
_LONG = """
with over("ray"):
    replayer = Replayer(scene(folder), [Stretch(0, *commands(0.5), *np.zeros((2, 3)))])
    replayer.run([()])
    print("runs", flush=True)
    while True:
        anew(replayer).run([()])
"""


@contextmanager
def started(code: str, *args: str) -> Iterator[subprocess.Popen[str]]:
    """Python in a group of its own, with two cores for Ray; nothing of it outlives the block."""
    env = {**os.environ, "RAY_OVERRIDE_RESOURCES": '{"CPU": 2}', "RAY_USAGE_STATS_ENABLED": "0"}
    env["PYTHONPATH"] = str(Path(__file__).parents[2])
    env.pop("RAY_ADDRESS", None)
    child = subprocess.Popen(
        [sys.executable, "-c", code, *args],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env, start_new_session=True,
    )  # fmt: skip
    try:
        yield child
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.communicate()


def ran(code: str, *args: str, limit: float = WORK_S) -> str:
    """What a child printed, which must be nothing but answers."""
    with started(code, *args) as child:
        out, err = child.communicate(timeout=limit)
    assert (child.returncode, err) == (0, ""), err
    return out


@pytest.fixture(scope="module", autouse=True)
def _ray_starts() -> None:
    """Skip, and say why, on a machine where Ray itself does not work."""
    try:
        ran(_STARTS, limit=START_S)
    except (subprocess.TimeoutExpired, AssertionError) as error:
        pytest.skip(f"Ray does not start on this machine: {str(error).strip()[-300:]}")


@pytest.mark.long
def test_ray_says_the_same(tmp_path: Path) -> None:
    assert ran(_IMPORTS + _SAME, str(tmp_path)) == ""


@pytest.mark.long
def test_what_a_worker_raises_is_raised_here(tmp_path: Path) -> None:
    said = ran(_IMPORTS + _RAISES, str(tmp_path))
    assert re.search(r"'mujoco': '1\.50'.*install the same", said)


@pytest.mark.long
@pytest.mark.usefixtures("proc")
def test_ctrl_c_ends_the_workers(tmp_path: Path) -> None:
    with started(_IMPORTS + _LONG, str(tmp_path)) as child:
        assert child.stdout is not None
        assert select.select([child.stdout], [], [], WORK_S)[0], "no answer"
        assert child.stdout.readline() == "runs\n"
        assert len(alive(child.pid)) > 2
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does it
        _, err = child.communicate(timeout=60)
        assert err.splitlines()[-1] == "KeyboardInterrupt"
        until = time.monotonic() + 20.0
        while alive(child.pid) and time.monotonic() < until:
            time.sleep(0.2)
        assert not alive(child.pid)


def alive(group: int) -> list[str]:
    """Processes of a group that work: none that are only waited for, nor Ray's two agents.

    On a busy machine Ray ends their parent so abruptly that they take a minute to notice.
    """
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = path.read_text().rpartition(")")
        except OSError:  # it ended meanwhile
            continue
        state, _, its_group = rest.split()[:3]
        if int(its_group) == group and state != "Z" and not re.search("::(Dash|Runt)", name):
            found.append(name)
    return found
