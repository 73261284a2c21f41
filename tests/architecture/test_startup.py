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
import importlib, sys
from importlib.machinery import PathFinder
def find_spec(name, path=None, target=None):
    return None if name.partition('.')[0] in {absent} else PathFinder.find_spec(name, path, target)
class Fewer(PathFinder):
    find_spec = staticmethod(find_spec)
sys.meta_path[sys.meta_path.index(PathFinder)] = Fewer
for name in {modules}:
    importlib.import_module(name)
"""
DIAGNOSIS = [
    "wt.diagnose.pipeline", "wt.diagnose.report.write", "wt.diagnose.report.text",
    "wt.diagnose.report.verify", "wt.diagnose.experiment.excite", "wt.data.importers.base",
    "wt.physics.spread", "wt.mjcf.simulator", "wt.prove.bench", "wt.worlds.robots",
    "wt.passport.add", "wt.passport.page",
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


WANTS = {
    ("fit", "--config", "debug"): "fit",
    ("evaluate", "wt-r5@champion", "--config", "r5"): "fit",
    ("reproduce",): "fit",
    ("train-policy", "--config", "policy_go2"): "rl",
    ("finetune", "--config", "finetune_go2"): "rl",
    ("demo",): "fit",
    ("view", "some.rrd"): "view",
    ("studio",): "studio",
    ("import", "log.h5", "--to", "log.parquet"): "formats",
    ("prove", "--quick", "--rivals"): "rivals",
    ("diagnose", "robot.xml", "log.parquet", "--out", "diagnosis", "--track"): "registry",
    ("diagnose", "robot.xml", "log.parquet", "--out", "diagnosis", "--jobs", "ray"): "scale",
    ("wt-run", "--policy", "go2"): "deploy",
    ("wt-sim-go2",): "deploy",
}
"""Command → extra without which it cannot do what it is asked to."""
RUN_ALL = """
import deploy.cli.run, deploy.cli.sim_go2
import wt.cli.main
PROGRAMS = {{"wt-run": deploy.cli.run.main, "wt-sim-go2": deploy.cli.sim_go2.main}}
for first, *rest in {commands}:
    main = PROGRAMS.get(first)
    code = main(rest) if main else wt.cli.main.main([first, *rest])
    assert code, first
"""


def test_every_command_says_at_once_which_extra_it_misses(tmp_path: Path) -> None:
    (tmp_path / "some.rrd").write_bytes(b"RRF2")
    (tmp_path / "log.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    # no extra brings pydantic alone: typer does
    code = BLOCKED.format(absent=set(EXTRAS) - {"pydantic"}, modules=[])
    done = subprocess.run(
        [sys.executable, "-c", code + RUN_ALL.format(commands=list(WANTS))],
        capture_output=True, text=True, check=False, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, ""), done.stderr[-2000:]
    lines = done.stderr.splitlines()
    for words, line in zip(WANTS, lines, strict=True):
        assert line.startswith("error: ") and f"pip install '.[{WANTS[words]}]'" in line, words
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.h5", "some.rrd"]


IN_THE_END = [
    ("onnxscript", "fit", ()),
    ("rerun", "view", ()),
    ("ray", "scale", ("collect.jobs=ray",)),
]
"""Package, the extra that brings it, and the words after which a fit wants it."""
FITS = """
import wt.cli.main
for name, _, words in {missed}:
    gone.clear()
    gone.add(name)
    assert wt.cli.main.main(["fit", "--config", "debug", "--out", "run", *words]) == 1
    assert name not in sys.modules
"""


def test_a_fit_says_first_what_it_would_miss_in_the_end(tmp_path: Path) -> None:
    code = "gone = set()\n" + BLOCKED.format(absent="gone", modules=[])
    code += FITS.format(missed=IN_THE_END)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, ""), done.stderr[-2000:]
    for (name, extra, _), line in zip(IN_THE_END, done.stderr.splitlines(), strict=True):
        assert f"needs the package '{name}', which the extra '{extra}' brings: pip install" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
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
