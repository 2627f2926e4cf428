"""Lines and dark fills of a page of a PDF, by pdfium."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from hpop.apart.answer import Answer, Refused
from hpop.apart.lines import FARTHEST, MOST_DEEP, MOST_POINTS, SAG, Lines

PAPER = 0.9
"""Brightness above which a line is no line: it covers what lies below."""
INK = 0.5
"""Brightness below which a fill is solid: lighter ones colour rooms."""
LAYERLESS = "(no layer)"
Matrix = np.ndarray[Any, np.dtype[np.float64]]


def extract(data: bytes, options: dict[str, Any]) -> Answer:
    """Lines of a page, in points from the lower left corner of the page as it is shown."""
    try:
        import pypdfium2 as pdfium
        from pypdfium2 import raw
    except ImportError as error:
        raise Refused(
            f"PDF drawings are read by pypdfium2, the extra hpop[plans] ({error}); pip install 'hpop[plans]'"
        ) from None
    try:
        document = pdfium.PdfDocument(data)
        pages = len(document)
        if not 1 <= options["page"] <= pages:
            raise Refused(f"it has {pages:,} pages; page must be one of them, got {options['page']}")
        page = document[options["page"] - 1]
    except pdfium.PdfiumError as error:
        raise Refused(f"it is no PDF that can be read ({str(error)[:200]}); has it a password?") from None
    lines = Lines(options["layers"])
    shown = _as_shown(page)
    for thing, matrix, layer in _within(raw, page.raw, shown, LAYERLESS, 0, lines):
        kind = raw.FPDFPageObj_GetType(thing)
        if kind == raw.FPDF_PAGEOBJ_PATH:
            _add(raw, thing, matrix, layer, lines)
        else:
            names = {raw.FPDF_PAGEOBJ_TEXT: "texts", raw.FPDF_PAGEOBJ_IMAGE: "images"}
            lines.left_out[names.get(kind, "shadings and others")] += 1
    return lines.answer((), pages=pages)


def _as_shown(page: Any) -> Matrix:
    """From the page's coordinates to those of the page as it is shown: its lower left corner, and its rotation."""
    left, bottom, right, top = page.get_cropbox()
    width, height = right - left, top - bottom
    to_corner = np.array([[1.0, 0, 0], [0, 1, 0], [-left, -bottom, 1]])
    turned = {
        0: [[1.0, 0, 0], [0, 1, 0], [0, 0, 1]],
        90: [[0.0, -1, 0], [1, 0, 0], [0, width, 1]],
        180: [[-1.0, 0, 0], [0, -1, 0], [width, height, 1]],
        270: [[0.0, 1, 0], [-1, 0, 0], [height, 0, 1]],
    }
    return np.asarray(to_corner @ np.array(turned[page.get_rotation()]))


def _within(
    raw: Any, parent: Any, matrix: Matrix, around: str, deep: int, lines: Lines
) -> Iterator[tuple[Any, Matrix, str]]:
    """Objects of a page, those of forms where these are drawn, each with what places it, and its layer."""
    of_page = deep == 0
    count = raw.FPDFPage_CountObjects(parent) if of_page else raw.FPDFFormObj_CountObjects(parent)
    for i in range(count):
        lines.look()
        thing = raw.FPDFPage_GetObject(parent, i) if of_page else raw.FPDFFormObj_GetObject(parent, i)
        layer = _layer(raw, thing) or around
        own = raw.FS_MATRIX()
        if not raw.FPDFPageObj_GetMatrix(thing, ctypes.byref(own)):
            own = raw.FS_MATRIX(1, 0, 0, 1, 0, 0)
        placed = np.array([[own.a, own.b, 0], [own.c, own.d, 0], [own.e, own.f, 1]]) @ matrix
        if raw.FPDFPageObj_GetType(thing) != raw.FPDF_PAGEOBJ_FORM:
            yield thing, placed, layer
        elif deep == MOST_DEEP:
            lines.left_out[f"forms more than {MOST_DEEP} deep"] += 1
        else:
            yield from _within(raw, thing, placed, layer, deep + 1, lines)


def _layer(raw: Any, thing: Any) -> str:
    """The name of the optional content to which an object belongs; "" where it belongs to none."""
    for i in range(max(0, raw.FPDFPageObj_CountMarks(thing))):
        mark = raw.FPDFPageObj_GetMark(thing, i)
        if _text(lambda *to, mark=mark: raw.FPDFPageObjMark_GetName(mark, *to)) == "OC":
            return _text(lambda *to, mark=mark: raw.FPDFPageObjMark_GetParamStringValue(mark, b"Name", *to))
    return ""


def _text(get: Any) -> str:
    """A text that pdfium writes into a buffer, in UTF-16."""
    size = ctypes.c_ulong()
    buffer = ctypes.create_string_buffer(512)
    pointer = ctypes.cast(buffer, ctypes.POINTER(ctypes.c_ushort))
    if not get(pointer, len(buffer), ctypes.byref(size)) or size.value > len(buffer):
        return ""
    return buffer.raw[: size.value].decode("utf-16-le", "replace").rstrip("\0")


def _add(raw: Any, path: Any, matrix: Matrix, layer: str, lines: Lines) -> None:
    """Add what a path draws, if it draws something dark."""
    fill, stroke = ctypes.c_int(), ctypes.c_int()
    if not raw.FPDFPath_GetDrawMode(path, ctypes.byref(fill), ctypes.byref(stroke)):
        return
    is_line = bool(stroke.value) and _brightness(raw.FPDFPageObj_GetStrokeColor, path) < PAPER
    is_area = bool(fill.value) and _brightness(raw.FPDFPageObj_GetFillColor, path) < INK
    if not (is_line or is_area):
        if fill.value or stroke.value:
            lines.left_out["light fills and lines"] += 1
        return
    if lines.wants(layer):
        lines.add(layer, _parts(raw, path, matrix, lines), filled=is_area)


def _brightness(get: Any, path: Any) -> float:
    """From 0 (black) to 1 (white, or transparent): on white paper."""
    red, green, blue, alpha = (ctypes.c_uint() for _ in range(4))
    if not get(path, *(ctypes.byref(value) for value in (red, green, blue, alpha))):
        return 0.0
    return 1.0 - alpha.value / 255 * (1.0 - (red.value + green.value + blue.value) / 765)


def _parts(raw: Any, path: Any, matrix: Matrix, lines: Lines) -> list[list[tuple[float, float]]]:
    """The parts of a path as points, curves within a share of their size."""
    parts: list[list[tuple[float, float]]] = []
    count = raw.FPDFPath_CountSegments(path)
    if count > MOST_POINTS:
        raise Refused(f"a line of it has {count:,} points; expected a floor plan, at most {MOST_POINTS:,}")
    curve: list[tuple[float, float]] = []
    x, y = ctypes.c_float(), ctypes.c_float()
    for i in range(count):
        segment = raw.FPDFPath_GetPathSegment(path, i)
        raw.FPDFPathSegment_GetPoint(segment, ctypes.byref(x), ctypes.byref(y))
        placed = np.array([x.value, y.value, 1.0]) @ matrix
        point = (float(placed[0]), float(placed[1]))
        if not (abs(point[0]) <= FARTHEST and abs(point[1]) <= FARTHEST):
            raise Refused(f"its coordinates must be finite numbers, at most {FARTHEST:.0e}")
        kind = raw.FPDFPathSegment_GetType(segment)
        if kind == raw.FPDF_SEGMENT_MOVETO or not parts:
            parts.append([point])
        elif kind == raw.FPDF_SEGMENT_BEZIERTO:
            curve.append(point)
            if len(curve) == 3:
                parts[-1] += _flat(parts[-1][-1], *curve)
                curve = []
        else:
            parts[-1].append(point)
        if raw.FPDFPathSegment_GetClose(segment):
            parts[-1].append(parts[-1][0])
    return parts


def _flat(*corners: tuple[float, float]) -> list[tuple[float, float]]:
    """Points of a cubic Bézier curve after its first, so many that chords stay within a share of its size."""
    a, b, c, d = np.array(corners)
    bend = max(math.hypot(*(a - 2 * b + c)), math.hypot(*(b - 2 * c + d)))  # second differences bound the sagitta
    size = float(np.hypot(*np.ptp(np.array(corners), axis=0)))
    pieces = max(1, math.ceil(math.sqrt(0.75 * bend / (SAG * size)))) if size > 0 else 1
    t = np.linspace(0, 1, pieces + 1)[1:, None]
    points = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
    return [(float(x), float(y)) for x, y in points]
