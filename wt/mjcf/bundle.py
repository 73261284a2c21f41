"""An MJCF with copies of its meshes, textures and height fields beside it, for other machines.

``wt diagnose`` writes a model that finds its assets where the user has them: it loads from any
folder of this machine. Bundled, it names copies of them in ``assets/`` and loads anywhere.
"""

from __future__ import annotations

import tempfile
from collections.abc import Container
from pathlib import Path, PurePath, PurePosixPath

import mujoco

from wt.errors import ModelError
from wt.mjcf.standalone import FOLDERS, compiles_to, standalone
from wt.mjcf.text import Document, Element

ASSETS = "assets"
_FOLDER_OF = {"texture": "texturedir"}
"""Which of the compiler's folders a kind of asset lies in; ``meshdir`` for the rest."""
_NAMED_BY_FILE = ("mesh", "texture", "hfield", "skin")
"""Kinds of assets that have the name of their file where none is given."""


def bundled(text: str) -> tuple[str, dict[str, bytes]]:
    """An MJCF that finds its assets in ``assets/`` beside it, and their contents by file name.

    Args:
        text: an MJCF in which includes are put in and folders are full paths, as
            :func:`wt.mjcf.standalone.standalone` makes it. It comes back as it is if it has no
            assets in files.

    Raises:
        ModelError: an asset cannot be read, or the copy would be another machine.
    """
    copies = _Copies()
    mine = copies.made(text, ASSETS)
    if not copies.files:
        return text, {}
    _refuse_another(mine, copies.files, text)
    return mine, copies.files


class _Copies:
    """Copies of files, each under a name of its own.

    Attributes:
        files: contents by name.
    """

    def __init__(self) -> None:
        """None yet."""
        self.files: dict[str, bytes] = {}
        self._names: dict[Path, str] = {}

    def made(self, text: str, folder: str) -> str:
        """An MJCF that finds its files' copies in a folder; they join the others."""
        document = Document(text)
        compilers = [e for e in document.root.children if e.tag == "compiler"]
        folders, strip = _folders(compilers)
        for element in document.root.walk():
            changes: dict[str, str | None] = {}
            for name, file in _files(element).items():
                if element.tag == "model":  # looked for beside the file, whatever folders say
                    changes[name] = (PurePosixPath(folder) / self._model(Path(file))).as_posix()
                    continue
                inner = PurePath(file).name if strip else file
                changes[name] = self._asset(
                    Path(folders[_FOLDER_OF.get(element.tag, "meshdir")]) / inner
                )
                if element.tag in _NAMED_BY_FILE and "name" not in element.attributes:
                    changes["name"] = PurePosixPath(file).stem
            document.set(element, changes)
        for element in compilers:
            document.set(element, dict.fromkeys(FOLDERS))
        if self.files:
            document.insert_text(document.root, None, [f'<compiler assetdir="{folder}"/>'], [])
        return document.text()

    def _asset(self, source: Path) -> str:
        if source not in self._names:
            self._names[source] = _free(source.name, self.files)
            self.files[self._names[source]] = _read(source)
        return self._names[source]

    def _model(self, source: Path) -> str:
        if source not in self._names:
            _read(source)
            self._names[source] = name = _free(source.name, self.files)
            self.files[name] = b""  # taken while its own files are copied
            self.files[name] = self.made(standalone(source), ".").encode()
        return self._names[source]


def _folders(compilers: list[Element]) -> tuple[dict[str, str], bool]:
    """Folders of meshes and of textures, the last one said; and if paths in front of names go."""
    folders, strip = {"meshdir": "", "texturedir": ""}, False
    for e in compilers:
        if "assetdir" in e.attributes:
            folders = dict.fromkeys(folders, e.attributes["assetdir"])
    for e in compilers:
        folders |= {name: e.attributes[name] for name in folders if name in e.attributes}
        strip = e.attributes.get("strippath", str(strip).lower()) == "true"
    return folders, strip


def _files(element: Element) -> dict[str, str]:
    """Attributes of an element that name a file."""
    if element.tag in ("include", "compiler"):
        return {}
    return {k: v for k, v in element.attributes.items() if k.startswith("file") and v}


def _free(name: str, taken: Container[str]) -> str:
    """The name, with a number before its suffix if another file has it."""
    stem, suffix, number = PurePath(name).stem, PurePath(name).suffix, 2
    while name in taken:
        name, number = f"{stem}_{number}{suffix}", number + 1
    return name


def _read(source: Path) -> bytes:
    try:
        return source.read_bytes()
    except OSError as error:
        raise ModelError(f"--bundle: asset {source} cannot be read ({error.strerror})") from error


def _refuse_another(text: str, files: dict[str, bytes], given: str) -> None:
    """Refuse a copy that does not compile to the numbers of what was given."""
    truth = mujoco.MjModel.from_xml_string(given)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / ASSETS).mkdir()
        for name, content in files.items():
            (Path(folder) / ASSETS / name).write_bytes(content)
        if not compiles_to(text, truth, Path(folder)):
            raise ModelError(
                "--bundle: with its assets beside it the model would be another one; leave "
                "--bundle out and copy the folders that model.xml names"
            )
