"""Reader of the lines and dark fills of a PDF page, with the library pdfium.

pdfium reports neither the unit of a page nor the layers that are off when the document is opened. But it can write a
document again with uncompressed objects, in which these entries are plain text.
"""

from __future__ import annotations

import ctypes
import io
import math
import re
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from hpop.apart.child import FARTHEST, MOST_DEEP, MOST_POINTS, SAG, ChildAnswer, ChildRefused, Lines, Visible

STREAM = re.compile(rb"stream\r?\n.*?endstream", re.DOTALL)
OBJECT = re.compile(rb"\b(\d{1,10}) \d{1,5} obj\b(.*?)\bendobj", re.DOTALL)
PAGE = re.compile(rb"/Type\s*/Page\b")
UNIT = re.compile(rb"/UserUnit\s+(\d{1,6}(?:\.\d*)?|\.\d+)")
MOST_UNIT = 75_000.0
"""Largest unit of a page, points."""
REFERENCE = re.compile(rb"(\d{1,10})\s+\d{1,5}\s+R\b")
NAME = re.compile(rb"/Name\s*(\((?:\\.|[^\\()])*\)|<[0-9A-Fa-f\s]*>)", re.DOTALL)
ESCAPE = re.compile(rb"\\([0-7]{1,3}|\r\n|.)", re.DOTALL)
LETTERS = {b"n": b"\n", b"r": b"\r", b"t": b"\t", b"b": b"\b", b"f": b"\f", b"\n": b"", b"\r": b"", b"\r\n": b""}
PAPER = 0.9
"""Brightness above which a line is ignored, because it only covers what is below it."""
INK = 0.5
"""Brightness below which a fill is read as solid; lighter fills colour rooms."""
LAYERLESS = "(no layer)"
PEN = 72 / 25.4
"""Largest thickness of a pen stroke, points (1 mm on paper); a thicker line is read as an area."""
Matrix = np.ndarray[Any, np.dtype[np.float64]]


def page_unit(pdfium: Any, document: Any, number: int, data: bytes) -> float:
    """Return the length of a page's unit in points (1/72 inch): its UserUnit (PDF 1.6), by default 1.

    ``number`` is the index of the page, from 0; ``data`` are the bytes of the file.
    """
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
    return {_string(found[1]).casefold() for found in names if found}


def _may_have(data: bytes, name: bytes) -> bool:
    """Return whether a file may have an entry ``name``: whether it occurs in the data, or objects are compressed."""
    return name in data or b"ObjStm" in data


def _objects(document: Any) -> dict[int, bytes]:
    """Return the objects of a document by number, without the contents of streams."""
    copy = io.BytesIO()
    document.save(copy)
    return {int(number): body for number, body in OBJECT.findall(STREAM.sub(b"", copy.getvalue()))}


def _entry(body: bytes, name: bytes, objects: dict[int, bytes]) -> bytes:
    """Return the dictionary under a name in another dictionary, direct or by reference; empty if there is none."""
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
    """Yield the object numbers in the array under a name, which is direct or a reference."""
    found = re.search(rb"/" + name + rb"\s*(?:(\d{1,10})\s+\d{1,5}\s+R\b|\[([^\]]*)\])", body)
    if found is not None:
        array = objects.get(int(found[1]), b"") if found[1] else found[2]
        yield from (int(number) for number in REFERENCE.findall(array))


def _string(string: bytes) -> str:
    """Return the text of a PDF string, written in brackets or in hexadecimal."""
    inner = string[1:-1]
    if string.startswith(b"<"):
        digits = re.sub(rb"\s", b"", inner).decode("ascii")
        data = bytes.fromhex(digits + "0" * (len(digits) % 2))
    else:
        data = ESCAPE.sub(lambda found: _unescaped(found[1]), inner)
    return decode(data)


def decode(data: bytes) -> str:
    """Return the text of bytes: UTF-16 with a byte order mark, or else Latin-1."""
    return data[2:].decode("utf-16-be", "replace") if data.startswith(b"\xfe\xff") else data.decode("latin-1")


def _unescaped(escape: bytes) -> bytes:
    if escape.isdigit():
        return bytes([int(escape, 8) % 256])
    return LETTERS.get(escape, escape)


def extract(data: bytes, options: dict[str, Any]) -> ChildAnswer:
    """Return the lines of a page as `Lines.answer` does, in points from the lower left corner of the displayed page.

    ``options["page"]`` is its number, from 1, and ``options["layers"]`` are names of layers, or None for all that are
    on. The words of the answer include ``pages``, the number of pages, and ``unit``, see `page_unit`.
    """
    try:
        import pypdfium2 as pdfium  # of an extra
        from pypdfium2 import raw  # of an extra
    except ImportError as error:
        raise ChildRefused(
            f"reading PDF drawings needs pypdfium2, which cannot be imported ({error}); run pip install 'hpop[plans]'"
        ) from None
    try:
        document = pdfium.PdfDocument(data)
        pages = len(document)
        if not 1 <= options["page"] <= pages:
            raise ChildRefused(f"it has {pages:,} pages; page must be from 1 to {pages:,}, got {options['page']}")
        page = document[options["page"] - 1]
    except pdfium.PdfiumError as error:
        raise ChildRefused(
            f"it cannot be read as a PDF ({str(error)[:200]}); if it has a password, save it without one"
        ) from None
    lines = Lines(options["layers"])
    unit = page_unit(pdfium, document, options["page"] - 1, data)
    hidden = hidden_layers(document, data)
    to_page, width, height = _display_matrix(page, unit)
    visible = Visible((0.0, 0.0, width, height))
    for thing, matrix, layer, clip in _visible_objects(raw, page.raw, to_page, LAYERLESS, visible, 0, lines):
        kind = raw.FPDFPageObj_GetType(thing)
        if kind == raw.FPDF_PAGEOBJ_PATH:
            _add(raw, thing, matrix, layer, clip, lines, shown=layer.casefold() not in hidden)
        else:
            names = {raw.FPDF_PAGEOBJ_TEXT: "texts", raw.FPDF_PAGEOBJ_IMAGE: "images"}
            lines.left_out[names.get(kind, "shadings and others")] += 1
    if (notes := raw.FPDFPage_GetAnnotCount(page.raw)) > 0:
        lines.left_out["annotations"] += notes
    return lines.answer((), pages=pages, unit=unit)


def _display_matrix(page: Any, unit: float) -> tuple[Matrix, float, float]:
    """Return the matrix from page coordinates to points of the displayed page, and that page's width and height."""
    left, bottom, right, top = page.get_cropbox()
    x0, y0, x1, y1 = page.get_mediabox()
    if min(right, x1) > max(left, x0) and min(top, y1) > max(bottom, y0):
        left, bottom, right, top = max(left, x0), max(bottom, y0), min(right, x1), min(top, y1)
    width, height = right - left, top - bottom
    to_corner = np.array([[1.0, 0, 0], [0, 1, 0], [-left, -bottom, 1]])
    turned = {
        0: [[1.0, 0, 0], [0, 1, 0], [0, 0, 1]],
        90: [[0.0, -1, 0], [1, 0, 0], [0, width, 1]],
        180: [[-1.0, 0, 0], [0, -1, 0], [width, height, 1]],
        270: [[0.0, 1, 0], [-1, 0, 0], [height, 0, 1]],
    }
    across = (width, height) if page.get_rotation() in (0, 180) else (height, width)
    whole = to_corner @ np.array(turned[page.get_rotation()]) @ np.diag([unit, unit, 1.0])
    return np.asarray(whole), across[0] * unit, across[1] * unit


def _visible_objects(
    raw: Any, parent: Any, matrix: Matrix, around: str, clip: Visible, deep: int, lines: Lines
) -> Iterator[tuple[Any, Matrix, str, Visible]]:
    """Yield the objects of a page or form, each with its matrix, layer and visible part.

    parent  page or form
    matrix  from its coordinates to the displayed page
    around  layer of the form
    clip    visible part of the page or form
    deep    depth of nested forms
    """
    of_page = deep == 0
    count = raw.FPDFPage_CountObjects(parent) if of_page else raw.FPDFFormObj_CountObjects(parent)
    for i in range(count):
        lines.count_entity()
        thing = raw.FPDFPage_GetObject(parent, i) if of_page else raw.FPDFFormObj_GetObject(parent, i)
        layer = _layer(raw, thing) or around
        own = raw.FS_MATRIX()
        if not raw.FPDFPageObj_GetMatrix(thing, ctypes.byref(own)):
            own = raw.FS_MATRIX(1, 0, 0, 1, 0, 0)
        placed = np.array([[own.a, own.b, 0], [own.c, own.d, 0], [own.e, own.f, 1]]) @ matrix
        within = _object_clip(raw, thing, matrix, clip, lines)
        if raw.FPDFPageObj_GetType(thing) != raw.FPDF_PAGEOBJ_FORM:
            yield thing, placed, layer, within
        elif deep == MOST_DEEP:
            lines.left_out[f"forms more than {MOST_DEEP} deep"] += 1
        else:
            yield from _visible_objects(raw, thing, placed, layer, within, deep + 1, lines)


def _object_clip(raw: Any, thing: Any, matrix: Matrix, clip: Visible, lines: Lines) -> Visible:
    """Return the visible part of the object ``thing``: the intersection of ``clip`` and the object's clip paths.

    matrix  from the coordinates of its parent to the displayed page
    """
    own = raw.FPDFPageObj_GetClipPath(thing)
    for number in range(max(0, raw.FPDFClipPath_CountPaths(own))):
        lines.count_entity()
        count = raw.FPDFClipPath_CountPathSegments(own, number)
        segments = (raw.FPDFClipPath_GetPathSegment(own, number, i) for i in range(count))
        clip = clip.cut(_parts(raw, segments, count, matrix))
    return clip


def _layer(raw: Any, thing: Any) -> str:
    """Return the name of the layer (optional content) to which an object belongs, or ""."""
    for i in range(max(0, raw.FPDFPageObj_CountMarks(thing))):
        mark = raw.FPDFPageObj_GetMark(thing, i)
        if _text(lambda *to, mark=mark: raw.FPDFPageObjMark_GetName(mark, *to)) == "OC":
            return _name(raw, mark)
    return ""


def _name(raw: Any, mark: Any) -> str:
    """Return the layer name in a content mark, read as bytes: pdfium's own text function misreads UTF-16."""
    size = ctypes.c_ulong()
    buffer = ctypes.create_string_buffer(512)
    to = ctypes.cast(buffer, ctypes.POINTER(ctypes.c_ubyte))
    if not raw.FPDFPageObjMark_GetParamBlobValue(mark, b"Name", to, len(buffer), ctypes.byref(size)):
        return ""
    return decode(buffer.raw[: min(size.value, len(buffer))])


def _text(get: Any) -> str:
    """Return the text that the pdfium function ``get`` writes into a buffer, in UTF-16."""
    size = ctypes.c_ulong()
    buffer = ctypes.create_string_buffer(512)
    pointer = ctypes.cast(buffer, ctypes.POINTER(ctypes.c_ushort))
    if not get(pointer, len(buffer), ctypes.byref(size)) or size.value > len(buffer):
        return ""
    return buffer.raw[: size.value].decode("utf-16-le", "replace").rstrip("\0")


def _add(raw: Any, path: Any, matrix: Matrix, layer: str, clip: Visible, lines: Lines, *, shown: bool) -> None:
    """Add the visible lines of a path to ``lines``, if it draws dark lines or fills; only ``clip`` is visible."""
    fill, stroke = ctypes.c_int(), ctypes.c_int()
    if not raw.FPDFPath_GetDrawMode(path, ctypes.byref(fill), ctypes.byref(stroke)):
        return
    is_line = bool(stroke.value) and _brightness(raw.FPDFPageObj_GetStrokeColor, path) < PAPER
    is_area = bool(fill.value) and _brightness(raw.FPDFPageObj_GetFillColor, path) < INK
    if not (is_line or is_area):
        if fill.value or stroke.value:
            lines.left_out["light fills and lines"] += 1
        return
    if not lines.wants(layer, shown=shown):
        return
    count = raw.FPDFPath_CountSegments(path)
    parts = _parts(raw, (raw.FPDFPath_GetPathSegment(path, i) for i in range(count)), count, matrix)
    seen = clip.of(parts, filled=is_area)
    if seen != parts:
        lines.left_out["partly or fully outside the page or a clip path"] += 1
    lines.add(layer, seen, filled=is_area, width=_thickness(raw, path, matrix) if is_line and not is_area else 0.0)


def _thickness(raw: Any, path: Any, matrix: Matrix) -> float:
    """Return the thickness of a line, in points; 0 if it is as thin as a pen (up to `PEN`), or unknown."""
    width = ctypes.c_float()
    if not raw.FPDFPageObj_GetStrokeWidth(path, ctypes.byref(width)):
        return 0.0
    thick = width.value * math.sqrt(abs(float(np.linalg.det(matrix[:2, :2]))))
    return thick if PEN < thick <= FARTHEST else 0.0


def _brightness(get: Any, path: Any) -> float:
    """Return the brightness on white paper, from 0 (black) to 1 (white or transparent)."""
    red, green, blue, alpha = (ctypes.c_uint() for _ in range(4))
    if not get(path, *(ctypes.byref(value) for value in (red, green, blue, alpha))):
        return 0.0
    return 1.0 - alpha.value / 255 * (1.0 - (red.value + green.value + blue.value) / 765)


def _parts(raw: Any, segments: Iterable[Any], count: int, matrix: Matrix) -> list[list[tuple[float, float]]]:
    """Return the parts of a path as points (x, y); curves become chords, off by at most `SAG` times their size."""
    parts: list[list[tuple[float, float]]] = []
    if count > MOST_POINTS:
        raise ChildRefused(
            f"one of its lines has {count:,} points, more than {MOST_POINTS:,}, too many for a floor plan; remove it"
        )
    curve: list[tuple[float, float]] = []
    x, y = ctypes.c_float(), ctypes.c_float()
    for segment in segments:
        raw.FPDFPathSegment_GetPoint(segment, ctypes.byref(x), ctypes.byref(y))
        placed = np.array([x.value, y.value, 1.0]) @ matrix
        point = (float(placed[0]), float(placed[1]))
        if not (abs(point[0]) <= FARTHEST and abs(point[1]) <= FARTHEST):
            raise ChildRefused(f"all coordinates of the file must be finite numbers, at most {FARTHEST:.0e}")
        kind = raw.FPDFPathSegment_GetType(segment)
        if kind == raw.FPDF_SEGMENT_MOVETO or not parts:
            parts.append([point])
        elif kind == raw.FPDF_SEGMENT_BEZIERTO:
            curve.append(point)
            if len(curve) == 3:
                parts[-1] += _bezier_points(parts[-1][-1], *curve)
                curve = []
        else:
            parts[-1].append(point)
        if raw.FPDFPathSegment_GetClose(segment):
            parts[-1].append(parts[-1][0])
    return parts


def _bezier_points(*corners: tuple[float, float]) -> list[tuple[float, float]]:
    """Return points of a cubic Bézier curve, without its first; chords are off it by at most `SAG` times its size."""
    a, b, c, d = np.array(corners)
    bend = max(math.hypot(*(a - 2 * b + c)), math.hypot(*(b - 2 * c + d)))  # bounds the distance of chords
    size = float(np.hypot(*np.ptp(np.array(corners), axis=0)))
    pieces = max(1, math.ceil(math.sqrt(0.75 * bend / (SAG * size)))) if size > 0 else 1
    t = np.linspace(0, 1, pieces + 1)[1:, None]
    points = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
    return [(float(x), float(y)) for x, y in points]
