"""Imports go one way, and packages do not import each other."""

from __future__ import annotations

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Each room of wt may import of its own level and of those above it in this list, never of those
# below; inside a level any order without a cycle will do. A new room is entered here.
LEVELS = [
    {"types", "errors", "shipped", "version", "batch", "cluster"},
    {"schema", "config", "data", "nets", "losses", "mjcf", "physics", "show", "worlds"},
    {"train", "translate", "baselines", "check"},
    {"diagnose"},
    {"evaluate", "export", "locomotion", "run"},
    {
        "ask",
        "demo",
        "finetune",
        "fit",
        "joined",
        "passport",
        "prove",
        "registered",
        "reproduce",
        "studio",
    },
    {"cli", "__init__"},
]
REGISTRY_MAY = {"types", "errors", "export"}
REGISTRY_IS_FOR = {"run", "registered", "finetune", "cli"}
# The runner has the policy's contract from worlds, and none of what trained it.
DEPLOY_MAY = {"types", "errors", "data", "worlds"}
# A process beside the runner, which only who names a passport starts.
DRIFT_MAY = DEPLOY_MAY | {"passport", "show"}

FILES = sorted(p for top in ("wt", "registry", "deploy") for p in (ROOT / top).rglob("*.py"))


def room_of(file: Path) -> str:
    """The package or module directly under wt/ that a file belongs to; else its top folder."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return parts[1] if parts[0] == "wt" else parts[0]


def imports_of(file: Path) -> Iterator[tuple[int, str, str]]:
    """(line, top package, room or "") of all imports of our own code, inside functions too."""
    package = file.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join([*above, *([node.module] if node.module else [])])
            # "from wt import cli" imports a room; "from wt import __version__" does not.
            names = [f"{base}.{alias.name}" for alias in node.names] if base == "wt" else [base]
        else:
            continue
        for name in names:
            top, _, rest = name.partition(".")
            if top in ("wt", "registry", "deploy"):
                room = rest.partition(".")[0]
                yield node.lineno, top, "" if room.startswith("__") else room


def level_of(room: str) -> int:
    """Index into LEVELS."""
    for index, level in enumerate(LEVELS):
        if room in level:
            return index
    raise AssertionError(f"wt/{room} stands in no level: enter it in LEVELS")


@pytest.mark.parametrize("file", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_one_way(file: Path) -> None:
    room = room_of(file)
    top = file.relative_to(ROOT).parts[0]
    wrong = []
    for line, package, target in imports_of(file):
        if package == "deploy":
            allowed = top == "deploy"
        elif package == "registry":
            allowed = top in ("registry", "deploy") or room in REGISTRY_IS_FOR
        elif top == "registry":
            allowed = not target or target in REGISTRY_MAY
        elif top == "deploy":
            may = DEPLOY_MAY | {"cli"} if file.parent.name == "cli" else DEPLOY_MAY
            may = DRIFT_MAY if file.name == "drift.py" else may
            allowed = not target or target in may
        else:
            allowed = not target or level_of(target) <= level_of(room)
        if not allowed:
            wrong.append(f"line {line}: {room} imports {package}.{target}".rstrip("."))
    assert not wrong, f"{file.relative_to(ROOT)}: {wrong}"


def test_no_cycles_between_packages() -> None:
    graph: dict[str, set[str]] = {}
    for file in FILES:
        room = room_of(file)
        rooms = {target if top == "wt" else top for _, top, target in imports_of(file)}
        graph.setdefault(room, set()).update(rooms - {room, ""})
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(f"packages import each other: {' -> '.join(error.args[1])}")


def modules_of(file: Path, known: set[str]) -> set[str]:
    """Modules of ours that a file imports, in functions and for types alone too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            # "from package import module" asks for the module, not for what the package holds
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inside & known or {node.module}
    return found & known


def test_no_circles_between_modules() -> None:
    names = {
        ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f
        for f in FILES
    }
    graph = {name: modules_of(file, set(names)) - {name} for name, file in names.items()}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(f"modules import each other: {' -> '.join(error.args[1])}")


def test_the_rules_see_imports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every way to write an import is seen, so that none goes around the rules."""
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    file = tmp_path / "wt" / "nets" / "a.py"
    file.parent.mkdir(parents=True)
    file.write_text(
        "import wt.cli.main as m\n"
        "from wt.train import x\n"
        "from wt import evaluate, __version__\n"
        "from ..data import y\n"
        "def f():\n    from registry.store import z\n"
    )
    assert [(top, room) for _, top, room in imports_of(file)] == [
        ("wt", "cli"),
        ("wt", "train"),
        ("wt", "evaluate"),
        ("wt", ""),
        ("wt", "data"),
        ("registry", "store"),
    ]
