"""An MJCF as one text that loads from any folder: includes put in, asset folders written out."""

from __future__ import annotations

import tempfile
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Shaped

from wt.mjcf.text import Document, Element, decoded

_TEXTURE = "texture"
FOLDERS = ("assetdir", "meshdir", "texturedir")
"""Attributes of ``compiler`` that say where assets are."""


def standalone(path: Path) -> str:
    """The text of an MJCF with included files in place and folders of assets as full paths.

    What needs neither stays as it was written, to the byte.

    Args:
        path: the MJCF.

    Raises:
        ValueError: it is not well-formed XML.
        OSError: an included file cannot be read.
    """
    folder = path.resolve().parent
    document = Document(_inlined(path, folder))
    if document.root.tag != "mujoco":
        return document.text()  # URDF; its meshes are MuJoCo's business
    relative = [e for e in document.root.walk() if _relative_files(e)]
    for model in [e for e in relative if e.tag == "model"]:
        # a child model is looked for beside the main file, whatever the folders say
        document.set(model, {"file": (folder / model.attributes["file"]).as_posix()})
    if any(e.tag != "model" for e in relative):
        _write_out_folders(document, folder, any(e.tag == _TEXTURE for e in relative))
    return document.text()


def _write_out_folders(document: Document, folder: Path, textures: bool) -> None:
    compilers = [e for e in document.root.children if e.tag == "compiler"]
    given = {name for e in compilers for name in FOLDERS if name in e.attributes}
    for element in compilers:
        changes: dict[str, str | None] = {
            name: (folder / element.attributes[name]).as_posix()
            for name in FOLDERS
            if name in element.attributes
        }
        document.set(element, changes)
    needed = {"meshdir", "texturedir"} if textures else {"meshdir"}
    if "assetdir" in given or needed <= given:
        return
    sentence = "the folder of the assets, so that this file loads from anywhere"
    if compilers:
        document.set(compilers[-1], {"assetdir": folder.as_posix()})
        document.comment(compilers[-1], sentence)
    else:
        document.insert_text(
            document.root, None, [f'<compiler assetdir="{folder.as_posix()}"/>'], [sentence]
        )


def _inlined(path: Path, folder: Path) -> str:
    """The text of a file with the files that it includes in place of the ``include``."""
    text = decoded(path.read_bytes())
    document = Document(text)
    for element in document.root.walk():
        if element.tag == "include":
            document.replace(element, _included(element, path, folder))
        elif path.parent.resolve() != folder:
            own_folder = path.resolve().parent
            # MuJoCo also looks beside the included file
            changes: dict[str, str | None] = {
                name: (own_folder / file).as_posix()
                for name, file in _relative_files(element).items()
                if (own_folder / file).is_file()
            }
            document.set(element, changes)
    return document.text()


def _included(element: Element, path: Path, folder: Path) -> str:
    file = Path(element.attributes["file"])
    places = [folder / file, path.resolve().parent / file]
    inner = Document(_inlined(next((p for p in places if p.is_file()), places[0]), folder))
    return inner.inside(inner.root).strip()


def _relative_files(element: Element) -> dict[str, str]:
    """Attributes that name a file relative to some folder."""
    if element.tag in ("include", "compiler"):
        return {}
    return {
        name: value
        for name, value in element.attributes.items()
        if name.startswith("file") and value and not Path(value).is_absolute()
    }


def compiles_to(text: str, truth: mujoco.MjModel, folder: Path | None = None) -> bool:
    """Tell whether an MJCF text compiles to the numbers of a model.

    Args:
        text: the MJCF.
        truth: the model.
        folder: where it is written to and read from; a new one if left out.
    """
    if folder is None:
        with tempfile.TemporaryDirectory() as new:
            return compiles_to(text, truth, Path(new))
    path = folder / "model.xml"
    path.write_text(text, encoding="utf-8")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError):
        return False
    return all(
        _equal(np.asarray(getattr(a, name)), np.asarray(getattr(b, name)))
        for a, b in ((model, truth), (model.opt, truth.opt), (model.stat, truth.stat))
        for name in _numeric(b)
    )


def _numeric(of: object) -> list[str]:
    """Names of the arrays and numbers of a MuJoCo struct that say something about physics."""
    names = []
    for name in dir(of):
        value = None if name.startswith("_") else getattr(of, name)
        if isinstance(value, (int, float, np.ndarray)) and "path" not in name:
            names.append(name)
    return [n for n in names if n != "nbuffer"]


def _equal(a: Shaped[np.ndarray, "*one"], b: Shaped[np.ndarray, "*other"]) -> bool:
    if a.shape != b.shape:
        return False
    if a.tobytes() == b.tobytes():
        return True
    if a.dtype.kind in "fc":
        return bool(np.allclose(a, b, rtol=1e-8, atol=1e-9, equal_nan=True))
    return bool((a == b).all())
