"""``wt --help`` is quick: commands import heavy libraries only when they run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from wt.cli._extras import EXTRAS

ROOT = Path(__file__).parents[2]

HEAVY = ["lightning", "matplotlib", "mlflow", "mujoco", "onnx", "onnxruntime", "pandas", "pyarrow"]
HEAVY += ["rerun", "scipy", "sklearn", "torch"]


def test_commands_import_nothing_heavy() -> None:
    code = (
        "import sys; from wt.cli.main import build; build();"
        f"print(*[name for name in {HEAVY} if name in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    loaded = result.stdout.split()
    assert not loaded, f"imported by wt's help: {loaded}; move the import into the function"


def test_help_is_quick() -> None:
    """Seconds of the processor, which other tests on the cores hardly change; the best of five."""
    command = [sys.executable, "-m", "wt.cli.main", "--help"]
    seconds = []
    for _ in range(5):
        before = os.times()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = os.times()
        used = after.children_user - before.children_user
        seconds.append(used + after.children_system - before.children_system)
    assert min(seconds) < 0.7, f"wt --help takes {min(seconds):.2f} s, promised are 0.7"


BLOCKED = """
import importlib, importlib.abc, sys
class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {absent}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)
sys.meta_path.insert(0, Absent())
for name in {modules}:
    importlib.import_module(name)
"""
DIAGNOSIS = [
    "wt.diagnose.pipeline", "wt.diagnose.report.write", "wt.diagnose.report.text",
    "wt.diagnose.report.verify", "wt.diagnose.experiment.excite", "wt.data.importers.base",
    "wt.physics.spread", "wt.mjcf.simulator", "wt.prove.bench", "wt.worlds.robots",
]  # fmt: skip
RUNNER = [
    "deploy.job", "deploy.clock", "deploy.dds", "deploy.go2", "deploy.operator", "deploy.pilot",
    "deploy.policies", "deploy.runner", "deploy.scribe", "deploy.sim", "wt.worlds.robots",
]  # fmt: skip


@pytest.mark.parametrize(
    ("modules", "brought"),
    [(DIAGNOSIS, set()), (RUNNER, {"deploy"}), (["registry.store"], {"registry"})],
    ids=["diagnose", "run", "registry"],
)
def test_an_installation_without_other_extras_is_enough(
    modules: list[str], brought: set[str]
) -> None:
    absent = [name for name, extra in EXTRAS.items() if extra not in brought]
    code = BLOCKED.format(absent=set(absent), modules=modules)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr.splitlines()[-6:]


def test_every_extra_is_one_of_the_project_and_brings_what_is_said() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    always = {distribution(line) for line in project["dependencies"]}
    for module, extra in EXTRAS.items():
        brings = {distribution(line) for line in project["optional-dependencies"][extra]}
        names = {
            name.lower()
            for name in packages_distributions().get(module, [module, f"{module}-learn"])
        }
        assert names & brings and not names & always, module


def distribution(requirement: str) -> str:
    """Name in a requirement."""
    return re.split(r"[\[<>=]", requirement)[0].lower()
