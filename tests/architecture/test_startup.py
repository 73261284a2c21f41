"""``wt --help`` is quick: commands import heavy libraries only when they run."""

from __future__ import annotations

import subprocess
import sys
import time

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
    """The best of five, since other tests share the cores."""
    command = [sys.executable, "-m", "wt.cli.main", "--help"]
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 0.7, f"wt --help takes {min(seconds):.2f} s, promised are 0.7"
