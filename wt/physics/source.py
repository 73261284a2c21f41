"""An MJCF as users write it: what MuJoCo takes in silence is refused, and what is unnamed named."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path

import mujoco

from wt.errors import ModelError
from wt.physics.quiet import quiet

_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_TAG = re.compile(rb"""<([A-Za-z_][\w.-]*)((?:[^"'<>]|"[^"]*"|'[^']*')*)>""")
_ATTRIBUTE = re.compile(rb"""([\w:.-]+)\s*=\s*("[^"]*"|'[^']*')""")


def check(path: Path) -> None:
    """Refuse a file that is not there, declares entities, or has numbers that are none.

    Raises:
        ModelError: it is such a file; the message names the element.
    """
    if not path.is_file():
        raise ModelError(f"model '{path}' does not exist; give an MJCF file")
    try:
        text = _COMMENT.sub(b"", path.read_bytes())
    except OSError as error:
        raise ModelError(f"model '{path}' cannot be read: {error.strerror}") from error
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ModelError(
            f"model '{path}' has a DTD (<!DOCTYPE …>), whose entities are not read; write out what "
            "they stand for"
        )
    for tag in _TAG.finditer(text):
        for name, value in _ATTRIBUTE.findall(tag[2]):
            if b"nan" in value.lower() and _has_nan(value[1:-1].decode("latin-1")):
                element, attribute = tag[1].decode("latin-1"), name.decode("latin-1")
                raise ModelError(
                    f"model '{path}': {attribute}={value.decode('latin-1')} of <{element}> is not "
                    "a number; give one, or leave it out"
                )


def _has_nan(value: str) -> bool:
    try:
        return any(math.isnan(float(word)) for word in value.split())
    except ValueError:
        return False  # a name


def read(path: Path) -> mujoco.MjSpec:
    """An editable copy of a file, in which everything is text.

    Raises:
        ValueError: MuJoCo refuses it.
    """
    with quiet():  # of what will be deprecated one day
        spec = mujoco.MjSpec.from_file(str(path))
    try:
        spec.comment  # noqa: B018 – the first of the file, of any encoding
    except UnicodeDecodeError:
        spec.comment = ""
    return spec


def compiled(spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """Compile a model in silence.

    Returns:
        (the model; what MuJoCo warns of, a line each).

    Raises:
        ValueError: MuJoCo refuses it.
    """
    with quiet(), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = spec.compile()
    return model, tuple(dict.fromkeys(" ".join(str(w.message).split()) for w in caught))


def name_unnamed(spec: mujoco.MjSpec) -> bool:
    """Name joints and actuators that have no name after their ids, in place.

    Returns:
        Whether there was one.
    """
    kinds = {"joint": spec.joints, "actuator": spec.actuators}
    if all(element.name for elements in kinds.values() for element in elements):
        return False
    copy = spec.copy()
    compiled(copy)  # which gives ids
    for kind, numbered in {"joint": copy.joints, "actuator": copy.actuators}.items():
        taken = {element.name for element in kinds[kind]}
        for element, same in zip(kinds[kind], numbered, strict=True):
            name = f"{kind}{same.id}"
            while name in taken and not element.name:
                name += "_"
            element.name = element.name or name
    return True
