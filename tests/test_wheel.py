"""The built wheel holds what commands look for beside the code, and brings no more than it must."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


def test_the_wheel_has_configurations_examples_policies_and_licence(tmp_path: Path) -> None:
    source = tmp_path / "source"
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for folder in ("wt", "registry", "deploy", "conf", "examples"):
        shutil.copytree(ROOT / folder, source / folder, ignore=ignored)
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    done = subprocess.run(
        [*command, "--no-index", "--wheel-dir", str(tmp_path), str(source)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    (wheel,) = tmp_path.glob("*.whl")
    inside = zipfile.ZipFile(wheel).namelist()
    share = "data/share/world-translation"
    for ending in (
        f"{share}/conf/base.yaml",
        f"{share}/examples/arm/model.xml",
        f"{share}/examples/go2/1.parquet",
        "wt/py.typed",
        "wt/worlds/policies/go2/policy.onnx",
        "wt/show/page.html",
        "wt/show/page.css",
        "wt/studio/static/htmx.min.js",
        "wt/studio/static/htmx.LICENSE",
        "wt/studio/templates/page.html",
        "licenses/LICENSE",
    ):
        assert any(name.endswith(ending) for name in inside), ending
    assert sum(name.endswith(".yaml") for name in inside) >= len(list((ROOT / "conf").iterdir()))


def test_without_an_extra_less_than_a_gigabyte_is_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    waiting = [Requirement(line) for line in project["dependencies"]]
    size, seen = 0, set[tuple[str, str]]()
    while waiting:
        wanted = waiting.pop()
        # what an extra of a package brings is asked for beside the package itself
        for extra in ("", *wanted.extras):
            if (wanted.name, extra) in seen:
                continue
            seen.add((wanted.name, extra))
            package = metadata.distribution(wanted.name)
            if not extra:
                size += sum(f.size or 0 for f in package.files or ())
            needs = (Requirement(line) for line in package.requires or ())
            waiting += [n for n in needs if not n.marker or n.marker.evaluate({"extra": extra})]
    names = {name for name, _ in seen}
    assert not names & {"torch", "mlflow", "rerun-sdk", "ray", "cyclonedds"}
    assert 200e6 < size < 1e9, f"{size / 1e6:.0f} MB"
