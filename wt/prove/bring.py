"""Cases of others: a folder of models and recordings, and their answers sealed."""

from __future__ import annotations

import json
import os
from pathlib import Path

import mujoco

from wt.data import recording as recordings
from wt.errors import DataError, UserError
from wt.prove.answer import from_json
from wt.prove.bench import publish, write_sealed
from wt.prove.blind import inputs
from wt.prove.seal import new_key


def seal_all(home: Path, answers: Path) -> Path:
    """Check cases, seal their answers and write the manifest.

    Args:
        home: folder with ``cases/NAME/``.
        answers: JSON, case → answer.

    Returns:
        Where the key is: beside the folder, not in it.

    Raises:
        DataError: a case or an answer cannot be used; the message names it.
    """
    folder, kept = home / "cases", home.with_name(f"{home.resolve().name}.key")
    if not folder.is_dir():
        raise DataError(f"'{home}' has no folder 'cases' with one folder a case")
    if kept.exists():
        raise DataError(f"'{kept}' exists: these answers are sealed; move the key away first")
    if answers.resolve().is_relative_to(home.resolve()):
        raise DataError(f"'{answers}' lies in '{home}', which is passed on: move it out first")
    try:
        said = json.loads(answers.read_text())
    except (OSError, ValueError) as error:
        raise DataError(f"--seal: '{answers}' cannot be read as JSON: {error}") from error
    cases = sorted(path for path in folder.iterdir() if path.is_dir() and path.name[0] != ".")
    names = [case.name for case in cases]
    if not isinstance(said, dict) or sorted(said) != names or not names:
        raise DataError(
            f"'{answers}' must hold one answer for each of the cases {', '.join(names)}"
        )
    opened = {case: from_json(said[case.name], case.name) for case in cases}
    for case in cases:
        check(case)
    key = new_key()
    for case, answer in opened.items():
        write_sealed(case, case.name, answer, key)
    publish(home)
    with os.fdopen(os.open(kept, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
        out.write(key.hex() + "\n")
    return kept


def check(case: Path) -> None:
    """Make sure that a case's model and recordings belong together.

    Raises:
        DataError: something is missing or cannot be used.
    """
    fit, holdout = inputs(case)
    if not (case / "robot.xml").is_file() or not fit or not holdout:
        raise DataError(
            f"case '{case.name}' needs robot.xml, fit-1.parquet and holdout-1.parquet "
            "(more of each: fit-2.parquet, …)"
        )
    try:
        model = mujoco.MjModel.from_xml_path(str(case / "robot.xml"))
        for file in (*fit, *holdout):
            recordings.check_against(recordings.read(file), model)
    except (ValueError, mujoco.FatalError) as error:
        raise DataError(f"case '{case.name}': robot.xml does not compile: {error}") from error
    except UserError as error:
        raise DataError(f"case '{case.name}': {error}") from error
