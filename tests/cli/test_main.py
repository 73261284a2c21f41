"""What the frame promises of every command: help with an example, one line and an exit code."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import typer

import wt.cli
from deploy.cli import run, sim_go2
from wt.cli import finetune, train_policy
from wt.cli.main import QUIET, build, main
from wt.errors import ConfigError, WorkError

BODY = '''
from typing import Annotated
import typer
{imports}
def command(names: list[str] | None = None) -> None:
    """Say one thing.

    Not joined [key=value] to a second line.

    Args:
        names: not for users.

    Example:
        wt {name} --names a
        wt {name} --names b
    """
    {statement}
'''

AddCommand = Callable[..., None]


@pytest.fixture
def add_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[AddCommand]:
    """Lay command modules into a folder of their own that stands in for ``wt.cli``'s."""
    monkeypatch.setattr(wt.cli, "__path__", [str(tmp_path)])
    monkeypatch.setenv("WT_DEBUG", "0")

    def add(name: str, statement: str, imports: str = "") -> None:
        text = BODY.format(name=name, statement=statement, imports=imports)
        (tmp_path / f"{name}.py").write_text(text)

    yield add
    for file in tmp_path.glob("*.py"):
        sys.modules.pop(f"wt.cli.{file.stem}", None)


def all_commands() -> list[list[str]]:
    """The words of every command of the real application, groups included."""

    def walk(command: object, words: list[str]) -> Iterator[list[str]]:
        yield words
        for name, child in getattr(command, "commands", {}).items():
            yield from walk(child, [*words, name])

    return list(walk(typer.main.get_command(build()), []))


@pytest.mark.parametrize("words", all_commands(), ids=" ".join)
def test_every_help_ends_with_an_example(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--help"]) == 0
    help_text = capsys.readouterr().out
    command = " ".join(["wt", *words])
    is_group = "Commands:\n" in help_text
    paragraphs = help_text.strip().split("\n\n")
    if words and is_group:  # its commands have the examples
        return
    assert paragraphs[-1].lstrip().startswith("Example:"), help_text
    assert command in paragraphs[-1]


def test_docstring_becomes_help(
    add_command: AddCommand, capsys: pytest.CaptureFixture[str]
) -> None:
    add_command("two_words_", "pass")
    assert main(["two-words", "--help"]) == 0
    out = capsys.readouterr().out
    assert "Not joined [key=value] to a second line." in out
    assert "not for users" not in out
    assert out.rstrip().endswith("wt two_words_ --names a\n  wt two_words_ --names b")


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        ("wt.errors.ConfigError('no key\\n  \"a\"')", 2, 'error: no key "a"\n'),
        ("wt.errors.WorkError('training collapsed')", 1, "error: training collapsed\n"),
        ("OSError(28, 'No space', 'x.bin')", 1, "error: the disk is full; earlier"),
        ("PermissionError(13, 'Permission denied', 'x')", 1, "error: Permission denied: x\n"),
        ("ZeroDivisionError('by zero')", 1, "error: unexpected ZeroDivisionError: by zero (WT_D"),
        (
            "ModuleNotFoundError('no', name='cyclonedds.core')",
            1,
            "error: this needs the package 'cyclonedds', which the extra 'deploy' brings: "
            "pip install '.[deploy]'",
        ),
        ("ModuleNotFoundError('no', name='tpyo')", 1, "error: unexpected ModuleNotFoundError: no"),
        ("KeyboardInterrupt", 1, "error: interrupted: nothing finished is lost"),
        ("typer.BadParameter('not so')", 2, "error: Invalid value: not so (see: wt boom --help)"),
    ],
)
def test_errors_become_one_line(
    add_command: AddCommand,
    capsys: pytest.CaptureFixture[str],
    error: str,
    code: int,
    line: str,
) -> None:
    add_command("boom", f"raise {error}", imports="import wt.errors")
    assert main(["boom"]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(line)
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("argv", [["nosuch"], ["--nosuch"], [], ["boom", "--names"], ["boom", "x"]])
def test_usage_errors(
    add_command: AddCommand, capsys: pytest.CaptureFixture[str], argv: list[str]
) -> None:
    add_command("boom", "pass")
    assert main(argv) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1


def test_debug_shows_the_traceback(
    add_command: AddCommand, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_command("boom", "raise ZeroDivisionError")
    monkeypatch.setenv("WT_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        main(["boom"])


def test_module_without_command_is_refused(
    tmp_path: Path, add_command: AddCommand, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "_helper.py").write_text("")
    add_command("fine", "pass")
    assert main(["fine"]) == 0
    (tmp_path / "forgotten.py").write_text("")
    assert main(["fine"]) == 1
    assert "forgotten.py offers neither" in capsys.readouterr().err


def full_sqlite() -> None:
    """SQLite's own error for a full disk, from a database that may not grow."""
    with sqlite3.connect(":memory:") as database:
        database.execute("pragma max_page_count = 2")
        database.execute("create table t (x blob)")
        database.execute("insert into t values (zeroblob(100000))")


def full_torch() -> None:
    """torch.save's, which has no errno."""
    import torch

    torch.save(torch.zeros(100_000), "/dev/full")


def full_chained() -> None:
    """A library's wrapper around the real reason."""
    try:
        Path("/dev/full").write_bytes(b"x" * 100_000)
    except OSError as error:
        raise ValueError("checkpoint not written") from error


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize(
    "write",
    [
        full_sqlite,
        full_torch,
        full_chained,
        lambda: np.zeros(100_000).tofile("/dev/full"),
        lambda: Path("/dev/full").write_bytes(b"x" * 100_000),
    ],
    ids=["sqlite", "torch", "chained", "numpy", "python"],
)
def test_full_disk_is_recognised(
    write: Callable[[], object],
    add_command: AddCommand,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    add_command("boom", "write()", imports="write = None")
    build()  # imports the module, so that its function can be replaced
    monkeypatch.setattr(sys.modules["wt.cli.boom"], "write", write)
    assert main(["boom"]) == 1
    assert capsys.readouterr().err.startswith("error: the disk is full; earlier outputs are intact")


def test_other_errors_are_not_called_a_full_disk() -> None:
    from wt.cli.main import explain

    assert explain(WorkError("a")) == ("a", 1)
    assert explain(ConfigError("b")) == ("b", 2)
    assert "disk" not in explain(RuntimeError("3 requested and none given"))[0]


def test_ctrl_c_in_a_real_process(tmp_path: Path) -> None:
    (tmp_path / "nap.py").write_text(
        "import time\n\ndef command() -> None:\n    print('up', flush=True)\n    time.sleep(60)\n"
    )
    code = (
        "import sys, wt.cli; from wt.cli.main import main;"
        f"wt.cli.__path__ = [{str(tmp_path)!r}]; sys.exit(main(['nap']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    start = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert time.monotonic() - start < 10
    assert process.returncode == 1
    assert err.startswith("error: interrupted")
    assert err.count("\n") == 1


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"wt {wt.__version__}\n"


@pytest.mark.parametrize("words", ["fit", "diagnose", "registry", "registry list", "demo"])
def test_every_command_says_its_version(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words.split(), "--version"]) == 0
    assert capsys.readouterr().out == f"wt {wt.__version__}\n"


def test_programs_of_their_own_say_it_too(capsys: pytest.CaptureFixture[str]) -> None:
    for program in (run, sim_go2, finetune, train_policy):
        assert program.main(["--version"]) == 0
        assert capsys.readouterr().out == f"wt {wt.__version__}\n"


PROGRAMS = {
    "wt": "wt.cli.main", "wt-finetune": "wt.cli.finetune", "wt-run": "deploy.cli.run",
    "wt-sim-go2": "deploy.cli.sim_go2", "wt-train-policy": "wt.cli.train_policy",
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("wt dia", "diagnose"), ("wt diagnose --hol", "--holdout"), ("wt-run --pol", "--policy"),
        ("wt-sim-go2 --hu", "--hung"), ("wt-finetune --con", "--config"),
        ("wt-train-policy --ins", "--install"),
    ],
)  # fmt: skip
def test_the_shell_is_told_what_a_word_may_become(words: str, said: str) -> None:
    program = words.split()[0]
    asked = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    asked[f"_{program.replace('-', '_').upper()}_COMPLETE"] = "complete_bash"
    code = f"import sys; from {PROGRAMS[program]} import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **asked}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert said in done.stdout.split()


def test_telemetry_is_switched_off_by_main_and_not_by_import() -> None:
    code = (
        "import os; from wt.cli.main import QUIET, main;"
        "print(any(name in os.environ for name in QUIET)); main(['--version']);"
        "print(all(os.environ[name] == QUIET[name] for name in QUIET))"
    )
    clean = {name: value for name, value in os.environ.items() if name not in QUIET}
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, env=clean, capture_output=True, text=True, check=True)
    assert result.stdout.split("\n")[:3] == ["False", f"wt {wt.__version__}", "True"]


def test_a_warning_is_one_line_said_once(
    add_command: AddCommand, capsys: pytest.CaptureFixture[str]
) -> None:
    warn = "[warnings.warn(x, stacklevel=1) for x in ('a\\n  b', 'a b', 'c')]"
    add_command("doubt", warn, imports="import warnings")
    assert main(["doubt"]) == 0
    assert capsys.readouterr().err == "warning: a b\nwarning: c\n"


WARN = """
def command() -> None:
    import mujoco
    xml = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qvel[:] = 1e200
    mujoco.mj_step(model, data)
"""


@pytest.mark.parametrize("first", ["", "import mujoco;"])
def test_mujoco_writes_no_log_where_a_command_runs(first: str, tmp_path: Path) -> None:
    (tmp_path / "cli").mkdir()
    (tmp_path / "cli" / "warn.py").write_text(WARN)
    code = (
        f"import os, wt.cli; {first} from wt.cli.main import main;"
        "wt.cli.__path__ = ['cli']; assert main(['warn']) == 0; assert os.listdir() == ['cli'];"
        # and afterwards as it was
        "from wt.cli import warn; warn.command(); assert 'MUJOCO_LOG.TXT' in os.listdir()"
    )
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
