"""XML text that is edited in place: whatever is not touched stays as it was written, to the byte.

MuJoCo's own writer drops comments, includes and layout. A :class:`Document` knows where every
element stands in the text, collects edits, and applies them all at once.
"""

from __future__ import annotations

import contextlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.parsers import expat

_START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")
_ATTRIBUTE = re.compile(rb"""\s+([^\s=<>/"']+)\s*=\s*("[^"]*"|'[^']*')""")
_COMMENT = re.compile(rb"<!--(.*?)-->", re.DOTALL)
_LINE_REST = re.compile(rb"[ \t]*(?:<!--(?:(?!-->)[^\n])*-->[ \t]*)*(?=\r?\n)")
_BARE = re.compile("&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9a-fA-F]+);)")
_DECLARED = re.compile(rb"""^\s*<\?xml[^>]*?encoding\s*=\s*["']([\w.-]+)["']""")
_UNIT = "  "


@dataclass(eq=False)
class Element:
    """An element and its place; positions are bytes of the UTF-8 text.

    Attributes:
        tag: its name.
        attributes: as written.
        parent: what it stands in; None for the root.
        start: of its start tag.
        head: behind its start tag.
        end: behind its end tag; ``head`` for an empty element like ``<joint/>``.
        children: elements directly inside.
    """

    tag: str
    attributes: dict[str, str]
    parent: Element | None
    start: int
    head: int
    end: int = 0
    children: list[Element] = field(default_factory=list)

    def walk(self) -> Iterator[Element]:
        """The element and all inside it, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.walk()


class Document:
    """A text of XML, its elements, and edits of them."""

    def __init__(self, text: str) -> None:
        """Parse.

        Raises:
            ValueError: it is not well-formed XML.
        """
        # MuJoCo takes a bare "&", XML does not; escaped it says the same to both
        self._raw = _BARE.sub("&amp;", text).encode("utf-8")
        self._edits: list[tuple[int, int, bytes]] = []
        self._filled: dict[Element, list[str]] = {}  # what goes into elements written as <a/>
        self.root = self._parse()

    def _parse(self) -> Element:
        raw = self._raw
        roots: list[Element] = []
        stack: list[Element] = []
        parser = expat.ParserCreate("utf-8")

        def start(tag: str, attributes: dict[str, str]) -> None:
            at = parser.CurrentByteIndex
            head = _START_TAG.match(raw, at)
            if head is None:
                raise ValueError(f"no start tag at byte {at}")
            element = Element(tag, attributes, stack[-1] if stack else None, at, head.end())
            (stack[-1].children if stack else roots).append(element)
            stack.append(element)

        def end(tag: str) -> None:
            element = stack.pop()
            element.end = element.head
            if not raw.endswith(b"/>", element.start, element.head):
                element.end = raw.index(b">", parser.CurrentByteIndex) + 1

        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            # MuJoCo allows "--" in comments, XML does not: what they say is kept from the parser
            parser.Parse(_COMMENT.sub(lambda c: b"<!--" + b" " * len(c[1]) + b"-->", raw), True)
        except expat.ExpatError as error:
            raise ValueError(str(error)) from error
        return roots[0]

    # -- edits -------------------------------------------------------------------------------

    def set(self, element: Element, changes: Mapping[str, str | None]) -> None:
        """Change, add or (None) remove attributes; all others stay where and as they are."""
        name_end = element.start + 1 + len(element.tag.encode())
        last, left = name_end, dict(changes)
        for attribute in _ATTRIBUTE.finditer(self._raw, name_end, element.head):
            last = attribute.end()
            name = attribute[1].decode()
            if name not in left:
                continue
            value = left.pop(name)
            if value is None:
                self._edits.append((attribute.start(), attribute.end(), b""))
            else:
                self._edits.append((attribute.start(2), attribute.end(2), _quoted(value)))
        added = [f" {name}=".encode() + _quoted(v) for name, v in left.items() if v is not None]
        if added:
            self._edits.append((last, last, b"".join(added)))

    def replace_tag(self, element: Element, tag: str, attributes: Mapping[str, str]) -> None:
        """Write an element's tag anew under another name; what it holds stays."""
        closing = b"/>" if element.end == element.head else b">"
        written = b"".join(f" {name}=".encode() + _quoted(v) for name, v in attributes.items())
        self._edits.append((element.start, element.head, f"<{tag}".encode() + written + closing))
        if closing == b">":
            close = self._raw.rindex(b"</", element.head, element.end)
            self._edits.append((close, element.end, f"</{tag}>".encode()))

    def comment(self, element: Element, sentence: str) -> None:
        """Put a comment on a line of its own just above an element."""
        line = self._raw.rfind(b"\n", 0, element.start) + 1
        first = not self._raw[line : element.start].strip()
        indent = self._indent(element)
        before = "" if first else f"\n{indent}"
        text = f"{before}{comment(sentence)}\n{indent}"
        self._edits.append((element.start, element.start, text.encode()))

    def insert(
        self, parent: Element, after: Element | None, added: ET.Element, sentences: Sequence[str]
    ) -> None:
        """Put a new element under comments into a parent: behind a child of it, or first."""
        self.insert_text(parent, after, written(added), sentences)

    def insert_text(
        self, parent: Element, after: Element | None, lines: Sequence[str], sentences: Sequence[str]
    ) -> None:
        """As :meth:`insert`, for text."""
        own_lines = [c for c in parent.children if self._on_own_line(c)]
        indent = self._indent(own_lines[0]) if own_lines else self._inner(parent)
        text = "".join(f"\n{indent}{line}" for line in [*map(comment, sentences), *lines])
        if parent.head == parent.end:
            self._filled.setdefault(parent, []).append(text)
            return
        at = parent.head if after is None else after.end
        rest = _LINE_REST.match(self._raw, at)  # a remark behind it stays behind it
        at = rest.end() if rest else at
        self._edits.append((at, at, text.encode()))

    def replace(self, element: Element, text: str) -> None:
        """Put any text in place of a whole element."""
        self._edits.append((element.start, element.end, text.encode()))

    def inside(self, element: Element) -> str:
        """The text between an element's start and end tags."""
        if element.head == element.end:
            return ""
        return self._raw[element.head : self._raw.rindex(b"</", 0, element.end)].decode()

    def text(self) -> str:
        """The text with all edits."""
        edits = list(self._edits)
        for parent, texts in self._filled.items():
            closing = f">{''.join(texts)}\n{self._indent(parent)}</{parent.tag}>"
            edits.append((parent.head - 2, parent.head, closing.encode()))
        parts, done = [], 0
        # insertions come before what replaces the text at the same place, in order of asking
        for start, end, new in sorted(edits, key=lambda e: e[:2]):
            parts += [self._raw[done:start], new]
            done = end
        return b"".join([*parts, self._raw[done:]]).decode("utf-8")

    # -- layout ------------------------------------------------------------------------------

    def _on_own_line(self, element: Element) -> bool:
        line = self._raw.rfind(b"\n", 0, element.start) + 1
        return not self._raw[line : element.start].strip()

    def _indent(self, element: Element) -> str:
        if self._on_own_line(element):
            line = self._raw.rfind(b"\n", 0, element.start) + 1
            return self._raw[line : element.start].decode()
        return "" if element.parent is None else self._inner(element.parent)

    def _inner(self, parent: Element) -> str:
        return self._indent(parent) + _UNIT


def decoded(raw: bytes) -> str:
    """The text of a file: UTF-8, else as its XML declaration says, else Latin-1."""
    declared = _DECLARED.match(raw)
    for encoding in ("utf-8-sig", declared[1].decode("ascii") if declared else ""):
        with contextlib.suppress(UnicodeDecodeError, LookupError):
            return raw.decode(encoding)
    return raw.decode("latin-1")


def remark(sentence: str) -> str:
    """A sentence as the inside of an XML comment of ours, on one line."""
    said = " ".join(sentence.split())
    while "--" in said:  # not allowed inside a comment
        said = said.replace("--", "- -")
    return f" wt diagnose: {said} "


def comment(sentence: str) -> str:
    """A sentence as an XML comment of ours, on one line."""
    return f"<!--{remark(sentence)}-->"


def written(element: ET.Element) -> list[str]:
    """Lines of a new element."""
    ET.indent(element, _UNIT)
    element.tail = None
    return ET.tostring(element, encoding="unicode").replace(" />", "/>").splitlines()


def _quoted(value: str) -> bytes:
    for raw, escaped in (("&", "&amp;"), ("<", "&lt;"), ('"', "&quot;")):
        value = value.replace(raw, escaped)
    return f'"{value}"'.encode()
