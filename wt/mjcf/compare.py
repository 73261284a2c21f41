"""Changes that an edit of an MjSpec made: the XML that MuJoCo writes before and after, compared."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco

Key = tuple[str, str]
Path = tuple[Key, ...]
"""Keys from below the root down to an element."""

_COMMENT = re.compile("<!--.*?-->", re.DOTALL)
_ONE_NAMESPACE = ("actuator", "sensor", "tendon", "equality")


class UnexpectedError(Exception):
    """The comparison found what cannot be carried over, such as an element that is gone."""


@dataclass(frozen=True, eq=False)
class Changed:
    """An element with other attributes, and possibly another tag.

    Attributes:
        path: where it stands.
        before: as it was.
        after: as it is.
    """

    path: Path
    before: ET.Element
    after: ET.Element

    @property
    def attributes(self) -> dict[str, str | None]:
        """New values of the attributes that differ; None for those that are gone."""
        old, new = self.before.attrib, self.after.attrib
        changed: dict[str, str | None] = {k: v for k, v in new.items() if old.get(k) != v}
        return changed | {k: None for k in old if k not in new}


@dataclass(frozen=True, eq=False)
class Added:
    """An element that was not there.

    Attributes:
        path: where it stands.
        parent: what it stands in, before the edit.
        behind: the nearest sibling above it that was there before; None if it comes first.
        element: the element.
    """

    path: Path
    parent: ET.Element
    behind: ET.Element | None
    element: ET.Element


Change = Changed | Added


def as_written(spec: mujoco.MjSpec) -> ET.Element:
    """A spec as XML in the user's notation and units, with all digits."""
    copy = spec.copy()
    copy.compiler.savecompiled = False
    copy.compiler.savecanonical = False
    copy.compiler.fusestatic = False  # what is written is what the user has, body by body
    # MuJoCo keeps a comment at the top, even one that XML does not allow
    return ET.fromstring(_COMMENT.sub("", copy.to_xml()))


def keys(section: str, children: Sequence[tuple[str, Mapping[str, str]]]) -> list[Key]:
    """Identities of elements among their siblings: a name, or a number where they have none.

    Args:
        section: tag of their parent.
        children: tags and attributes of the siblings.
    """
    identities: list[Key] = []
    for tag, attributes in children:
        # one namespace for all kinds of actuators, since an edit may change the kind
        kind = "any" if section in _ONE_NAMESPACE else tag.replace("freejoint", "joint")
        name = attributes.get("class" if tag == "default" else "name")
        if name is None:
            name = f"#{sum(k == kind and n.startswith('#') for k, n in identities)}"
        identities.append((kind, name))
    return identities


def keyed(parent: ET.Element) -> dict[Key, ET.Element]:
    """The children of an element by what identifies them."""
    children = list(parent)
    return dict(zip(keys(parent.tag, [(c.tag, c.attrib) for c in children]), children, strict=True))


def changes(before: ET.Element, after: ET.Element, path: Path = ()) -> Iterator[Change]:
    """Differences inside two elements at the same place.

    Raises:
        UnexpectedError: an element is gone.
    """
    if before.attrib != after.attrib or before.tag != after.tag:
        yield Changed(path, before, after)
    old, new = keyed(before), keyed(after)
    if gone := [key for key in old if key not in new]:
        raise UnexpectedError(f"{gone[0]} of {before.tag} is gone")
    behind = None
    for key, element in new.items():
        if key in old:
            behind = old[key]
            yield from changes(old[key], element, (*path, key))
        else:
            yield Added((*path, key), before, behind, element)
