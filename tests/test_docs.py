"""README and documentation speak of commands and options that exist, and of every effect."""

from __future__ import annotations

import ast
import functools
import itertools
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from deploy.cli import run, sim_go2
from wt.cli.main import build
from wt.physics.effect import effects
from wt.shipped import folder

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PROGRAMS = {"wt-run": run.command, "wt-sim-go2": sim_go2.command}
OF_WT = {"wt-finetune": "finetune", "wt-train-policy": "train-policy"}
ALWAYS = {"--help", "--version"}
OF_THE_ROOT = {"--install-completion", "--show-completion"} | ALWAYS


def commands_of(page: Path) -> Iterator[str]:
    """Command lines of ours in a page: in blocks for the shell, and in backticks."""
    text = page.read_text(encoding="utf-8")
    for block in re.findall(r"^```(?:sh|console)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            for part in re.split(r"&&|\s&\s|\s&$|\|\s|;\s", line.removeprefix("$ ")):
                yield part.partition(" #")[0].partition(" > ")[0].strip()
    for code in re.findall(r"`([^`\n]+)`", text):
        yield code.strip()


CASES = [
    pytest.param(words, id=f"{page.name}: {' '.join(words)}")
    for page in PAGES
    for words in dict.fromkeys(
        tuple(line.split() if "'" not in line else shlex.split(line))
        for line in commands_of(page)
        if re.match(r"wt(-run|-sim-go2|-finetune|-train-policy)?( |$)", line)
    )
]


@functools.cache
def program() -> typer.core.TyperGroup:
    group = typer.main.get_command(build())
    assert isinstance(group, typer.core.TyperGroup)
    return group


def one(function: object) -> typer.core.TyperCommand:
    app = typer.Typer(add_completion=False)
    app.command()(function)  # type: ignore[type-var]
    return typer.main.get_command(app)  # type: ignore[return-value]


def test_pages_have_commands() -> None:
    assert len(CASES) > 60


@pytest.mark.parametrize("words", CASES)
def test_a_command_of_a_page_exists_with_its_options(words: tuple[str, ...]) -> None:
    first, *rest = words
    command = one(PROGRAMS[first]) if first in PROGRAMS else program()
    rest = [OF_WT[first], *rest] if first in OF_WT else rest
    while rest and isinstance(command, typer.core.TyperGroup) and not rest[0].startswith("-"):
        name = rest.pop(0).rstrip(",")
        assert name in command.commands, f"no command '{name}'"
        command = command.commands[name]  # type: ignore[assignment]
    options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}
    options |= OF_THE_ROOT if command is program() else ALWAYS
    given = {re.sub(r"[\].,…]+$", "", w.lstrip("[")).partition("=")[0] for w in rest}
    unknown = {w for w in given if w.startswith("--")} - options
    assert not unknown, f"no option {unknown}"
    configs = [v for o, v in itertools.pairwise(rest) if o == "--config"]
    for name in (Path(c).stem for c in configs if c.startswith("conf/") or "/" not in c):
        assert (folder("conf") / f"{name}.yaml").is_file() or not name.isidentifier()


BY_HAND = {"trials", "toys", "firmware", "real", "so101", "public_models", "public_robots"}
"""Benchmarks that take hours, or need what is not here."""


def test_make_bench_runs_every_other_benchmark_as_its_first_lines_say() -> None:
    recipe = re.search(r"^bench:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.M)
    assert recipe is not None
    run = dict(re.findall(r"(?<=/)python benchmarks/(\w+)\.py(.*)", recipe[1]))
    files = {file.stem: file for file in (ROOT / "benchmarks").glob("*.py")}
    assert set(run) == set(files) - BY_HAND
    for name, words in run.items():
        first_lines = ast.get_docstring(ast.parse(files[name].read_text(encoding="utf-8")))
        assert f"python benchmarks/{name}.py{words}" in str(first_lines)


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        text = re.sub(
            r"^```.*?^```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.M | re.S
        )
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_effect_stands_in_the_reference_with_its_parameters() -> None:
    rows = {
        row[1].strip(" `"): row
        for row in (
            line.split("|") for line in (ROOT / "docs" / "reference.md").read_text().splitlines()
        )
        if len(row) == 7
    }
    for name, effect in effects().items():
        assert name in rows, f"docs/reference.md has no row for {name}"
        for parameter in effect.parameters:
            if parameter.public:
                assert parameter.name in rows[name][3] and f"[{parameter.unit}]" in rows[name][3]


def test_json_in_the_reference_is_json() -> None:
    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    for block in re.findall(r"^```json\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        assert json.loads(block)["schema"] == 1


def test_the_notebook_runs_and_finds_what_is_hidden() -> None:
    notebook = json.loads((ROOT / "docs" / "tutorial.ipynb").read_text(encoding="utf-8"))
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "tutorial", "exec"), names)
    found, before, after = names["found"], names["before"], names["after"]
    assert [f.effect for f in found.findings] == ["joint.friction_coulomb"]  # type: ignore[attr-defined]
    assert after < 0.1 * before  # type: ignore[operator]
