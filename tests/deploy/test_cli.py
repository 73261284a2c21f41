"""The two commands: help, bad input in one line, and nothing that a robot's computer lacks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from deploy.cli.run import main as wt_run
from deploy.cli.sim_go2 import main as wt_sim_go2
from deploy.job import RunOptions, run
from tests.deploy.policies import write_policy
from wt.errors import UserError
from wt.worlds.go2_model import JOINTS

HEAVY = ["cyclonedds", "mlflow", "mujoco", "onnxruntime", "pandas", "pyarrow", "rerun", "torch"]
SWAPPED = [JOINTS[3], *JOINTS[1:3], JOINTS[0], *JOINTS[4:]]
"""FR and FL, as in the maker's order."""


def loaded(code: str, names: Sequence[str]) -> list[str]:
    """Which of some modules a fresh interpreter has after some code."""
    code += f"\nimport sys; print(*[n for n in {names!r} if n in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


@pytest.mark.parametrize("main", [wt_run, wt_sim_go2])
def test_help_has_an_example(main: object, capsys: pytest.CaptureFixture[str]) -> None:
    assert callable(main) and main(["--help"]) == 0
    out = capsys.readouterr().out
    assert "Example:" in out and "--interface" in out


def test_help_loads_nothing_heavy() -> None:
    code = "import deploy.cli.sim_go2; from deploy.cli.run import main; main(['--help'])"
    assert [n for n in loaded(code, HEAVY) if n in HEAVY] == []


def test_the_runner_loads_no_torch() -> None:
    """All that a run imports, and a policy at work."""
    code = (
        "import deploy.job, deploy.dds, deploy.go2, deploy.operator, deploy.runner, deploy.sim\n"
        "from deploy.policies import load; from deploy.pilot import Pilot; Pilot(load('go2'))\n"
        "import registry.policies, mlflow"
    )
    assert loaded(code, ["torch", "lightning", "onnxruntime"]) == ["onnxruntime"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--interface", "eth99"], "there is no network interface 'eth99'; this machine has lo"),
        (["--domain", "999"], "DDS domain is 999; 0 to 230 are allowed"),
        (["tlit=1"], "did you mean 'tilt'"),
        (["tilt=wide"], "a number is needed"),
        (["--policy", "nobody"], "policy 'nobody' does not exist; the package has: g1"),
        (["--policy", "g1"], "its robot differs from go2's"),
        (["--policy", "go2@champion"], "no model store at"),
        (["--robot", "spot"], "'spot' is not"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert wt_run(["--policy", "go2", *words]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and said in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"joints": SWAPPED}, "joints differs from go2's (number 0 is 'FR_hip_joint'"),
        ({"stiffness": [25.0] * 12}, "stiffness differs"),
        ({"velocity_gain": [0.5] * 12}, "velocity_gain differs"),
        ({"action_scale": [0.25] * 12}, "action_scale differs"),
        ({"default": [0.0, 0.8, -1.5] * 4}, "default differs"),
        ({"rate_hz": 100.0}, "rate_hz differs"),
        ({"observation": ["gyro/x"] * 45}, "observation differs"),
        ({"sha256": "0" * 64}, "their sha256 differ"),
        ({"observation_units": ["deg"] * 45}, "observation_units differs"),
        ({"commit": "0" * 40}, "metadata and its card differ in commit (number 0 is 'unknown'"),
        ({"config": {}}, "its graph's metadata and its card differ in config_hash"),
        ({"task": "swimming"}, "differ in task (number 0 is 'go2' instead of 'swimming')"),
        ({"sources": {"model": "0" * 64}}, "its graph's metadata lack model_sha256"),
    ],
)
def test_a_policy_whose_card_is_not_the_robot_s_is_refused(
    changes: dict[str, object], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write_policy(tmp_path / "policy", **changes)
    assert wt_run(["--policy", str(tmp_path / "policy")]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and said in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--interface", "eth99"], "no network interface"),
        (["1:sit"], "write SECONDS:stand"),
        (["--fault", "explode@1"], "no fault is called 'explode'"),
    ],
)
def test_a_simulator_that_makes_no_sense_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert wt_sim_go2(words) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and said in err


def test_precedence_that_the_system_denies_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def denied(*_: object) -> None:
        raise PermissionError("Operation not permitted")

    monkeypatch.setattr("os.sched_setscheduler", denied)
    assert wt_sim_go2(["--realtime"]) == 2
    assert "--realtime: the system does not allow it" in capsys.readouterr().err


def test_the_policys_thread_begins_with_precedence(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []

    def no_network(*_: object) -> None:
        raise UserError("no network")

    monkeypatch.setattr("deploy.clock.take_precedence", lambda: order.append("precedence"))
    monkeypatch.setattr("deploy.pilot.Pilot", lambda policy: order.append("thread"))
    monkeypatch.setattr("deploy.job._go2", no_network)
    with pytest.raises(UserError, match="no network"):
        run("go2", RunOptions(realtime=True))
    assert order == ["precedence", "thread"]
