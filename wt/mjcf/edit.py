"""The MJCF with the findings written into it, otherwise as the user wrote it.

The truth is what MuJoCo makes of the patched spec. The text is the user's own, with changes only
at the elements that the patches changed, each under a comment that says why; it counts only if it
compiles, from another folder, to the same numbers. If it does not (a model that MuJoCo expands,
such as ``replicate``), the text is MuJoCo's writing of the model instead.
"""

from __future__ import annotations

import contextlib
import difflib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco

from wt.mjcf.compare import (
    Added,
    Change,
    Changed,
    UnexpectedError,
    as_written,
    changes,
    keyed,
    keys,
)
from wt.mjcf.compare import Path as Place
from wt.mjcf.keyframes import balance
from wt.mjcf.standalone import compiles_to, standalone
from wt.mjcf.text import Document, Element, remark
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene
from wt.physics.source import name_unnamed, read

_ALTERNATIVES = (
    {"quat", "axisangle", "euler", "xyaxes", "zaxis"},
    {"diaginertia", "fullinertia"},
)
_LONG = re.compile(r"-?\d*\.\d{9,}(e-?\d+)?")
_KEYFRAMES = (("keyframe", "#0"),)
_BALANCED = "with the joints and filters that were added, in balance"
_AMENDED = "as the audit of model and recordings found"
_REWRITTEN = "the file could not be changed in place, so this is MuJoCo's own writing of the model"


def patched_xml(
    scene: Scene,
    hypothesis: Hypothesis,
    statements: Sequence[str],
    *,
    timestep: float | None = None,
) -> str:
    """The user's MJCF, amended, with every finding's patch; as it was if there is nothing of it.

    It loads from any folder of this machine: included files are put in, and the folder of meshes
    and textures is written out.

    Args:
        scene: the model as given.
        hypothesis: the findings.
        statements: one sentence for each, in the same order.
        timestep: a finer time step than the model's own [s], if the recordings need one.
    """
    patched = _patch(scene, hypothesis, statements, timestep)
    truth = patched.spec.compile()
    for given, head in _texts(scene):
        try:
            text = _edited(given, patched, head)
        except (UnexpectedError, ValueError):
            continue
        if compiles_to(text, truth):
            return text
    _write_out_folders(patched.spec, scene)
    document = Document(str(patched.spec.to_xml()))
    _head(document, [_REWRITTEN, *statements])
    return document.text()


def diff(given: str, patched: str, name: str = "model.xml") -> str:
    """Unified diff of two MJCF texts, with three lines around every change."""
    lines = difflib.unified_diff(
        given.splitlines(), patched.splitlines(), f"given/{name}", f"patched/{name}", lineterm=""
    )
    return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class _Patched:
    """A patched spec, and the sentence that stands for each change.

    Attributes:
        spec: with all patches.
        before: the model as given, as XML in the user's notation.
        after: the same of the patched one.
        reasons: places that a patch changed, and its sentence.
        unwritten: sentences of what changes nothing in the file.
    """

    spec: mujoco.MjSpec
    before: ET.Element
    after: ET.Element
    reasons: tuple[tuple[Place, str], ...]
    unwritten: tuple[str, ...]

    def sentences(self, place: Place, inside: bool = False) -> list[str]:
        """Reasons for what changed at a place, and possibly inside it."""
        return list(
            dict.fromkeys(
                s for p, s in self.reasons if p == place or (inside and p[: len(place)] == place)
            )
        )


def _patch(
    scene: Scene, hypothesis: Hypothesis, statements: Sequence[str], timestep: float | None
) -> _Patched:
    spec = scene.written(amended=False)
    before = last = as_written(spec)
    reasons: list[tuple[Place, str]] = []
    unwritten = []
    if scene.amendments:
        for amend in scene.amendments:
            amend(spec)
        last = as_written(spec)
        reasons += [(place, _AMENDED) for place in _places(before, last)]
    own = float(spec.option.timestep)
    if timestep is not None and timestep != own:
        spec.option.timestep = timestep
        now = as_written(spec)
        why = f"time step refined from {1e3 * own:g} ms to {1e3 * timestep:g} ms"
        reasons += [(place, f"{why}, as the recordings need.") for place in _places(last, now)]
        last = now
    for planted, statement in zip(hypothesis, statements, strict=True):
        planted.effect.patch(spec, planted.at, planted.theta)
        now = as_written(spec)
        places = _places(last, now)
        where = "see diagnosis.json" if planted.effect.native else "physics.py has it"
        if not places:
            unwritten.append(f"{statement} (MuJoCo has no element for it; {where}.)")
        elif not planted.effect.native:
            statement = f"{statement} (The nearest that MuJoCo has; {where}.)"
        # what MuJoCo makes of keyframes is undone below
        reasons += [(place, statement) for place in places if place[:1] != _KEYFRAMES]
        last = now
    if balance(spec, scene, hypothesis):
        now = as_written(spec)
        reasons += [(place, _BALANCED) for place in _places(last, now)]
        last = now
    return _Patched(spec, before, last, tuple(reasons), tuple(unwritten))


def _places(before: ET.Element, after: ET.Element) -> list[Place]:
    """Places at which two models differ; inside a new section, every element counts for itself."""
    places: list[Place] = []
    try:
        for change in changes(before, after):
            section = isinstance(change, Added) and change.parent.tag == "mujoco"
            inside = keyed(change.element) if isinstance(change, Added) and section else {}
            places += [(*change.path, key) for key in inside] or [change.path]
    except UnexpectedError:
        places.append(())
    return places


def _texts(scene: Scene) -> Iterator[tuple[str, str]]:
    """Texts to edit, the best first, each with a remark for its head."""
    # MuJoCo reads some files that are not well-formed XML
    with contextlib.suppress(ValueError, OSError, KeyError):
        yield _named(standalone(scene.path), scene), ""
    spec = scene.written(amended=False)
    _write_out_folders(spec, scene)
    yield ET.tostring(as_written(spec), encoding="unicode"), _REWRITTEN


def _named(text: str, scene: Scene) -> str:
    """A text in which joints and actuators without a name have those that they go by here."""
    spec = read(scene.path)
    given = as_written(spec)
    if not name_unnamed(spec):
        return text
    document = Document(text)
    located = dict(_located(given, [document.root]))
    for before, after in zip(given.iter(), as_written(spec).iter(), strict=True):
        if before.get("name") != after.get("name"):
            document.set(located[before][-1], {"name": after.get("name")})
    return document.text()


def _write_out_folders(spec: mujoco.MjSpec, scene: Scene) -> None:
    folder = scene.path.resolve().parent
    spec.compiler.meshdir = (folder / spec.compiler.meshdir).as_posix()
    spec.compiler.texturedir = (folder / spec.compiler.texturedir).as_posix()


def _edited(given: str, patched: _Patched, head: str) -> str:
    document = Document(given)
    located = dict(_located(patched.before, [document.root]))
    differences: list[Change] = list(changes(patched.before, patched.after))
    _head(document, [*([head] if head else []), *patched.unwritten])
    for change in differences:
        if isinstance(change, Added):
            _add(document, located, change, patched)
    for change in differences:
        if isinstance(change, Changed):
            _change(document, located, change, patched)
    return document.text()


def _head(document: Document, sentences: Sequence[str]) -> None:
    if sentences:
        document.insert_text(document.root, None, [], sentences)


def _located(
    written: ET.Element, elements: list[Element]
) -> Iterator[tuple[ET.Element, list[Element]]]:
    """Pair elements of MuJoCo's writing with those of the text; a section may be in parts."""
    yield written, elements
    children = [child for element in elements for child in element.children]
    top = written.tag == "mujoco"
    places: dict[tuple[str, str], list[Element]] = {}
    named = keys(written.tag, [(c.tag, c.attributes) for c in children])
    for key, child in zip(named, children, strict=True):
        places.setdefault((child.tag, "") if top else key, []).append(child)
    for key, part in keyed(written).items():
        if written_as := places.get((part.tag, "") if top else key):
            yield from _located(part, written_as)


def _add(
    document: Document,
    located: dict[ET.Element, list[Element]],
    change: Added,
    patched: _Patched,
) -> None:
    parents = located.get(change.parent, [])
    behind = located.get(change.behind, []) if change.behind is not None else []
    if not parents or (change.behind is not None and not behind):
        raise UnexpectedError(f"{change.path} has no place in the file")
    anchor = behind[-1] if behind else None
    parent = parents[0] if anchor is None else anchor.parent
    if parent is None or parent not in parents:
        raise UnexpectedError(f"{change.path} has no place in the file")
    element = _short(change.element)
    sentences = patched.sentences(change.path, inside=True)
    if change.parent.tag == "mujoco" and len(element):
        # a whole section: each of its elements gets its own comment
        for key, child in keyed(element).items():
            for sentence in patched.sentences((*change.path, key), inside=True):
                element.insert(list(element).index(child), ET.Comment(remark(sentence)))
        sentences = []
    document.insert(parent, anchor, element, sentences)


def _change(
    document: Document,
    located: dict[ET.Element, list[Element]],
    change: Changed,
    patched: _Patched,
) -> None:
    elements = located.get(change.before, [])
    if not elements:
        raise UnexpectedError(f"{change.path} has no place in the file")
    after, target = _short(change.after), elements[-1]
    if change.before.tag != after.tag:
        document.replace_tag(target, after.tag, after.attrib)
    else:
        for name, value in change.attributes.items():
            # of several notations, and of several parts of a section, the last one written rules
            group = next((g for g in _ALTERNATIVES if name in g), {name})
            having = [e for e in elements if group & e.attributes.keys()]
            target = having[-1] if having else elements[-1]
            others = sorted(group & target.attributes.keys() - {name})
            gone: dict[str, str | None] = dict.fromkeys(others) if value is not None else {}
            document.set(target, gone | {name: after.attrib.get(name)})
    for sentence in patched.sentences(change.path):
        document.comment(target, sentence)


def _short(element: ET.Element) -> ET.Element:
    """A copy in which numbers have ten digits: more say nothing about a robot."""
    copy = ET.fromstring(ET.tostring(element))
    for part in copy.iter():
        for name, value in part.attrib.items():
            words = [f"{float(w):.10g}" if _LONG.fullmatch(w) else w for w in value.split()]
            part.set(name, " ".join(words))
    return copy
