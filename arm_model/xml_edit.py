"""An XML text changed in place: attributes, their numbers, and new elements; every other byte as it was."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from arm_io import InputError
from arm_io.types import Array

CLOSE = 1e-9
"""Relative: what differs by less has come through a file."""


@dataclass
class Element:
    """An element where it stands in the text.

    start, inside, end  bytes: of its '<', behind its start tag, of its end tag ('</'; equal to ``inside`` where it is
                        empty, '<a/>')
    """

    tag: str
    attributes: dict[str, str]
    start: int
    inside: int
    end: int = -1
    empty: bool = False
    children: list[Element] = field(default_factory=list)

    def child(self, tag: str) -> Element | None:
        """The first child with a tag."""
        return next((one for one in self.children if one.tag == tag), None)

    def named(self, tag: str, name: str) -> Element | None:
        """The first child with a tag and an attribute 'name'."""
        return next((one for one in self.children if (one.tag, one.attributes.get("name")) == (tag, name)), None)


class XmlText:
    """A text in UTF-8 and the edits to it. InputError where it is not well-formed."""

    def __init__(self, path: str | Path, data: bytes) -> None:
        self.path, self._data = path, data
        self._edits: list[tuple[int, int, bytes]] = []
        self.root = self._parse()

    def set(self, element: Element, **values: str) -> None:
        """Gives attributes of an element new values in their places; one that is not there comes last.

        Numbers that are the same but for rounding stay as they are written.

        InputError where a value that would change is an expression of xacro.
        """
        tag = self._data[element.start : element.inside]
        for name, value in values.items():
            if _same(element.attributes.get(name), value):
                continue
            found = re.search(rb"\s" + name.encode() + rb"\s*=\s*(\"[^\"]*\"|'[^']*')", tag)
            if "${" in element.attributes.get(name, ""):
                raise InputError(
                    self.path, f"<{element.tag}> has {name}={element.attributes[name]!r}: expand it first, xacro FILE"
                )
            if found:
                first = element.start + found.start(1) + 1
                self._edits.append((first, element.start + found.end(1) - 1, value.encode()))
            else:
                place = element.inside - (2 if element.empty else 1)
                while self._data[place - 1 : place].isspace():
                    place -= 1
                self._edits.append((place, place, f' {name}="{value}"'.encode()))

    def drop(self, element: Element, name: str) -> None:
        """Removes an attribute of an element, with the space before it."""
        tag = self._data[element.start : element.inside]
        found = re.search(rb"\s+" + name.encode() + rb"\s*=\s*(\"[^\"]*\"|'[^']*')", tag)
        if found:
            self._edits.append((element.start + found.start(), element.start + found.end(), b""))

    @property
    def edited(self) -> bool:
        """Whether anything will be different."""
        return bool(self._edits)

    def add(self, parent: Element, text: str) -> None:
        """Adds an element as the last child, on a line of its own, indented as the parent's children are."""
        line = self._data.rfind(b"\n", 0, parent.start) + 1
        margin = re.match(rb"[ \t]*", self._data[line:])
        indent = margin[0].decode() if margin else ""
        ending = "\r\n" if b"\r\n" in self._data else "\n"
        if parent.empty:
            inner = f">{ending}{indent}  {text}{ending}{indent}</{parent.tag}>"
            self._edits.append((parent.inside - 2, parent.inside, inner.encode()))
            return
        place = parent.end
        while self._data[place - 1 : place] in (b" ", b"\t"):
            place -= 1
        self._edits.append((place, place, f"{indent}  {text}{ending}".encode()))

    def text(self) -> str:
        """The text with all edits."""
        parts, place = [], 0
        for first, last, new in sorted(self._edits, key=lambda edit: edit[:2]):
            parts += [self._data[place:first], new]
            place = last
        return b"".join([*parts, self._data[place:]]).decode("utf-8")

    def _parse(self) -> Element:
        parser = expat.ParserCreate()
        top = Element("", {}, 0, 0)
        open_: list[Element] = [top]

        def begin(tag: str, attributes: dict[str, str]) -> None:
            start = parser.CurrentByteIndex
            quoted = re.compile(rb"<[^\"'>]*(?:\"[^\"]*\"[^\"'>]*|'[^']*'[^\"'>]*)*>").match(self._data, start)
            inside = quoted.end() if quoted else start
            element = Element(tag, attributes, start, inside, empty=self._data[inside - 2 : inside] == b"/>")
            open_[-1].children.append(element)
            open_.append(element)

        def finish(tag: str) -> None:
            element = open_.pop()
            element.end = element.inside if element.empty else parser.CurrentByteIndex

        parser.StartElementHandler, parser.EndElementHandler = begin, finish
        try:
            self._data.decode("utf-8")
            parser.Parse(self._data, True)
        except (expat.ExpatError, ValueError) as error:
            raise InputError(self.path, f"cannot be read as XML in UTF-8: {error}") from None
        return top.children[0]


def _same(old: str | None, new: str) -> bool:
    """Whether both are the same numbers but for rounding."""
    try:
        one, other = ([float(part) for part in str(text).split()] for text in (old, new))
    except ValueError:
        return False
    return len(one) == len(other) and all(math.isclose(a, b, rel_tol=CLOSE, abs_tol=1e-15) for a, b in zip(one, other))


def differ(one: object, other: object) -> bool:
    """Whether numbers, or arrays of one shape, differ by more than ``CLOSE``."""
    return not np.allclose(np.asarray(one, float), np.asarray(other, float), rtol=CLOSE, atol=1e-15)


def number(value: float) -> str:
    """The shortest decimal that reads as this number; never -0."""
    return repr(float(value) + 0.0)


def vector(values: Array) -> str:
    """Numbers (n,) separated by spaces."""
    return " ".join(number(value) for value in values)
