"""Packages that not every installation has, and the extra of this one that brings each."""

from __future__ import annotations

import importlib.util

from wt.errors import lacking

EXTRAS = {
    "absl": "rivals",
    "colorama": "rivals",
    "cyclonedds": "deploy",
    "daqp": "fit",
    "fastapi": "studio",
    "jinja2": "studio",
    "h5py": "formats",
    "lightning": "fit",
    "matplotlib": "fit",
    "mink": "fit",
    "mlflow": "registry",
    "omegaconf": "fit",
    "onnxscript": "fit",
    "pandas": "registry",
    "pydantic": "registry",
    "pysindy": "rivals",
    "ray": "scale",
    "rerun": "view",
    "rerun_cli": "view",
    "rsl_rl": "rl",
    "sklearn": "fit",
    "tabulate": "rivals",
    "tensordict": "rl",
    "torch": "fit",
    "umap": "report",
    "uvicorn": "studio",
}
"""Module → extra, as in ``pyproject.toml``."""


def missing(module: str | None) -> str | None:
    """One line about a module that is not installed; None if no extra brings it.

    Args:
        module: dotted name of what could not be imported.
    """
    top = (module or "").partition(".")[0]
    return lacking("this", top, EXTRAS[top]) if top in EXTRAS else None


def need(*modules: str) -> None:
    """Look for modules that a command imports only in the end: what is missing is said at once.

    Args:
        modules: names of their packages, as they are imported.

    Raises:
        ModuleNotFoundError: one is not installed.
    """
    for name in modules:
        if importlib.util.find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
