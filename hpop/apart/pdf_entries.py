"""Entries of a PDF that pdfium does not tell: the unit of a page, and layers that are off when it is opened.

pdfium writes a document anew with objects that are not compressed, where these entries are plain to see.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from typing import Any

STREAM = re.compile(rb"stream\r?\n.*?endstream", re.DOTALL)
OBJECT = re.compile(rb"\b(\d{1,10}) \d{1,5} obj\b(.*?)\bendobj", re.DOTALL)
PAGE = re.compile(rb"/Type\s*/Page\b")
UNIT = re.compile(rb"/UserUnit\s+(\d{1,6}(?:\.\d*)?|\.\d+)")
MOST_UNIT = 75_000.0
"""Largest unit of a page, points: a page is at most 200 inches of its units across, and 237 miles."""
REFERENCE = re.compile(rb"(\d{1,10})\s+\d{1,5}\s+R\b")
NAME = re.compile(rb"/Name\s*(\((?:\\.|[^\\()])*\)|<[0-9A-Fa-f\s]*>)", re.DOTALL)
ESCAPE = re.compile(rb"\\([0-7]{1,3}|\r\n|.)", re.DOTALL)
LETTERS = {b"n": b"\n", b"r": b"\r", b"t": b"\t", b"b": b"\b", b"f": b"\f", b"\n": b"", b"\r": b"", b"\r\n": b""}


def unit(pdfium: Any, document: Any, number: int, data: bytes) -> float:
    """Return how many points (1/72 inch) a unit of a page is: its UserUnit (PDF 1.6), 1 where it has none."""
    if not _may_have(data, b"UserUnit"):
        return 1.0
    alone = pdfium.PdfDocument.new()
    alone.import_pages(document, [number])
    found = next((UNIT.search(body) for body in _objects(alone).values() if PAGE.search(body)), None)
    value = float(found[1]) if found else 1.0
    return value if 0 < value <= MOST_UNIT else 1.0


def hidden_layers(document: Any, data: bytes) -> set[str]:
    """Return the names, in lower case, of the layers (optional content) that are off when the document is opened."""
    if not _may_have(data, b"OCProperties"):
        return set()
    objects = _objects(document)
    catalog = next((body for body in objects.values() if b"/OCProperties" in body), b"")
    properties = _entry(catalog, b"OCProperties", objects)
    default = _entry(properties, b"D", objects)
    off = set(_references(default, b"OFF", objects))
    if re.search(rb"/BaseState\s*/OFF\b", default):
        off |= set(_references(properties, b"OCGs", objects)) - set(_references(default, b"ON", objects))
    names = (NAME.search(objects.get(number, b"")) for number in off)
    return {_text(found[1]).casefold() for found in names if found}


def _may_have(data: bytes, name: bytes) -> bool:
    """Whether a file may have an entry: it is there, or what is there is compressed."""
    return name in data or b"ObjStm" in data


def _objects(document: Any) -> dict[int, bytes]:
    """The objects of a document by number, without what streams hold."""
    copy = io.BytesIO()
    document.save(copy)
    return {int(number): body for number, body in OBJECT.findall(STREAM.sub(b"", copy.getvalue()))}


def _entry(body: bytes, name: bytes, objects: dict[int, bytes]) -> bytes:
    """The dictionary that is an entry of another, there or by its number; nothing where there is none."""
    found = re.search(rb"/" + name + rb"\s*(?:(\d{1,10})\s+\d{1,5}\s+R\b|<<)", body)
    if found is None:
        return b""
    if found[1]:
        return objects.get(int(found[1]), b"")
    deep, begin = 1, found.end()
    for bracket in re.finditer(rb"<<|>>", body[begin:]):
        deep += 1 if bracket[0] == b"<<" else -1
        if deep == 0:
            return body[begin : begin + bracket.start()]
    return body[begin:]


def _references(body: bytes, name: bytes, objects: dict[int, bytes]) -> Iterator[int]:
    """The numbers of the objects in an array, there or by its number."""
    found = re.search(rb"/" + name + rb"\s*(?:(\d{1,10})\s+\d{1,5}\s+R\b|\[([^\]]*)\])", body)
    if found is not None:
        array = objects.get(int(found[1]), b"") if found[1] else found[2]
        yield from (int(number) for number in REFERENCE.findall(array))


def _text(string: bytes) -> str:
    """The text of a string that is written in brackets or hexadecimal."""
    inner = string[1:-1]
    if string.startswith(b"<"):
        digits = re.sub(rb"\s", b"", inner).decode("ascii")
        data = bytes.fromhex(digits + "0" * (len(digits) % 2))
    else:
        data = ESCAPE.sub(lambda found: _unescaped(found[1]), inner)
    return decoded(data)


def decoded(data: bytes) -> str:
    """Return the text of a string: UTF-16 with a mark, or bytes that are Latin letters."""
    return data[2:].decode("utf-16-be", "replace") if data.startswith(b"\xfe\xff") else data.decode("latin-1")


def _unescaped(escape: bytes) -> bytes:
    if escape.isdigit():
        return bytes([int(escape, 8) % 256])
    return LETTERS.get(escape, escape)
