"""The house's own measure: small files and functions, typed, documented, nothing left undone."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted(p for top in ("wt", "registry", "deploy") for p in (ROOT / top).rglob("*.py"))
MAX_FILE, MAX_FUNCTION = 450, 60
# Spelled in pieces, since this file is searched too.
MARKS = re.compile(r"\b(" + "|".join(["TO" + "DO", "FIX" + "ME", "X" * 3, "HA" + "CK"]) + r")\b")
MACHINE_PATH = re.compile(r"(?<![\w.~$}/])/(ho" r"me|ro" r"ot|Us" r"ers|wo" r"rk|o" r"pt)/[\w.]")

each_file = pytest.mark.parametrize("file", FILES, ids=lambda p: str(p.relative_to(ROOT)))


@each_file
def test_file_keeps_the_measure(file: Path) -> None:
    text = file.read_text()
    tree = ast.parse(text)
    complaints = []
    if (lines := len(text.splitlines())) > MAX_FILE:
        complaints.append(f"{lines} lines, at most {MAX_FILE}: split it")
    if not ast.get_docstring(tree):
        complaints.append("no docstring")
    complaints += [
        f"line {number}: left undone"
        for number, line in enumerate(text.splitlines(), 1)
        if MARKS.search(line) or "NotImplemented" + "Error" in line
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            complaints += function_complaints(node)
    assert not complaints, f"{file.relative_to(ROOT)}: {complaints}"


def function_complaints(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """What is wrong with the length and the annotations of one function."""
    where = f"line {node.lineno}: {node.name}"
    complaints = []
    if (lines := (node.end_lineno or node.lineno) - node.lineno + 1) > MAX_FUNCTION:
        complaints.append(f"{where} has {lines} lines, at most {MAX_FUNCTION}")
    a = node.args
    named = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
    complaints += [
        f"{where}: argument {arg.arg} has no type"
        for arg in named
        if arg.annotation is None and arg.arg not in ("self", "cls")
    ]
    if node.returns is None:
        complaints.append(f"{where}: no return type")
    return complaints


def test_no_paths_of_one_machine() -> None:
    git = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if git.returncode:
        pytest.skip("not a git checkout: which files belong to the project is not known")
    found = []
    for name in git.stdout.splitlines():
        try:
            lines = (ROOT / name).read_text().splitlines()
        except (UnicodeDecodeError, FileNotFoundError):  # binary; deleted but still in the index
            continue
        found += [f"{name}:{n}" for n, line in enumerate(lines, 1) if MACHINE_PATH.search(line)]
    assert not found, f"paths that exist on one machine only: {found}"
