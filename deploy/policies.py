"""Policies by name: of the registry, in a folder, or of the package."""

from __future__ import annotations

import tempfile
from pathlib import Path

from registry.reference import is_folder
from wt.worlds.policy import Policy
from wt.worlds.robots import GO2


def load(reference: str) -> Policy:
    """A policy that fits the Go2: hash, joint order, gains, scales, observation and rate checked.

    Args:
        reference: ``go2@champion`` or ``go2/3`` for one of the registry; a folder; or the name of
            one of the package.

    Raises:
        ModelError: it does not fit.
        RegistryError: the registry has no such policy, or its bytes are not those registered.
    """
    if is_folder(reference):
        return Policy.load(reference, GO2)
    from registry.policies import pull

    with tempfile.TemporaryDirectory() as folder:
        pull(reference, Path(folder))
        return Policy.load(folder, GO2)
