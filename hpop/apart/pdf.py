"""Lines and dark fills of a page of a PDF, by pdfium."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from hpop.apart import pdf_entries
from hpop.apart.answer import Answer, Refused
from hpop.apart.clip import Visible
from hpop.apart.lines import FARTHEST, MOST_DEEP, MOST_POINTS, SAG, Lines

PAPER = 0.9
"""Brightness above which a line is no line: it covers what lies below."""
INK = 0.5
"""Brightness below which a fill is solid: lighter ones colour rooms."""
LAYERLESS = "(no layer)"
PEN = 72 / 25.4
"""Thickness up to which a line is a pen's, 1 mm on paper: what is thicker is drawn as a band."""
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
    unit = pdf_entries.unit(pdfium, document, options["page"] - 1, data)
    hidden = pdf_entries.hidden_layers(document, data)
    to_page, width, height = _as_shown(page, unit)
    visible = Visible((0.0, 0.0, width, height))
    for thing, matrix, layer, clip in _within(raw, page.raw, to_page, LAYERLESS, visible, 0, lines):
        kind = raw.FPDFPageObj_GetType(thing)
        if kind == raw.FPDF_PAGEOBJ_PATH:
            _add(raw, thing, matrix, layer, clip, lines, shown=layer.casefold() not in hidden)
        else:
            names = {raw.FPDF_PAGEOBJ_TEXT: "texts", raw.FPDF_PAGEOBJ_IMAGE: "images"}
            lines.left_out[names.get(kind, "shadings and others")] += 1
    if (notes := raw.FPDFPage_GetAnnotCount(page.raw)) > 0:
        lines.left_out["annotations"] += notes
    return lines.answer((), pages=pages, unit=unit)


def _as_shown(page: Any, unit: float) -> tuple[Matrix, float, float]:
    """From the page's coordinates to points of the page as it is shown, from its lower left corner; and its size."""
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


def _within(
    raw: Any, parent: Any, matrix: Matrix, around: str, clip: Visible, deep: int, lines: Lines
) -> Iterator[tuple[Any, Matrix, str, Visible]]:
    """Objects of a page, those of forms where these are drawn, each with what places it, its layer, and its clip."""
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
        within = _clipped(raw, thing, matrix, clip, lines)
        if raw.FPDFPageObj_GetType(thing) != raw.FPDF_PAGEOBJ_FORM:
            yield thing, placed, layer, within
        elif deep == MOST_DEEP:
            lines.left_out[f"forms more than {MOST_DEEP} deep"] += 1
        else:
            yield from _within(raw, thing, placed, layer, within, deep + 1, lines)


def _clipped(raw: Any, thing: Any, matrix: Matrix, clip: Visible, lines: Lines) -> Visible:
    """What is visible of an object: the clip around it and its own paths, in the coordinates of what holds it."""
    own = raw.FPDFPageObj_GetClipPath(thing)
    for number in range(max(0, raw.FPDFClipPath_CountPaths(own))):
        lines.look()
        count = raw.FPDFClipPath_CountPathSegments(own, number)
        segments = (raw.FPDFClipPath_GetPathSegment(own, number, i) for i in range(count))
        clip = clip.cut(_parts(raw, segments, count, matrix))
    return clip


def _layer(raw: Any, thing: Any) -> str:
    """The name of the optional content to which an object belongs; "" where it belongs to none."""
    for i in range(max(0, raw.FPDFPageObj_CountMarks(thing))):
        mark = raw.FPDFPageObj_GetMark(thing, i)
        if _text(lambda *to, mark=mark: raw.FPDFPageObjMark_GetName(mark, *to)) == "OC":
            return _name(raw, mark)
    return ""


def _name(raw: Any, mark: Any) -> str:
    """The name in a mark; its bytes are asked for, since pdfium takes a text in UTF-16 for one in UTF-8."""
    size = ctypes.c_ulong()
    buffer = ctypes.create_string_buffer(512)
    to = ctypes.cast(buffer, ctypes.POINTER(ctypes.c_ubyte))
    if not raw.FPDFPageObjMark_GetParamBlobValue(mark, b"Name", to, len(buffer), ctypes.byref(size)):
        return ""
    return pdf_entries.decoded(buffer.raw[: min(size.value, len(buffer))])


def _text(get: Any) -> str:
    """A text that pdfium writes into a buffer, in UTF-16."""
    size = ctypes.c_ulong()
    buffer = ctypes.create_string_buffer(512)
    pointer = ctypes.cast(buffer, ctypes.POINTER(ctypes.c_ushort))
    if not get(pointer, len(buffer), ctypes.byref(size)) or size.value > len(buffer):
        return ""
    return buffer.raw[: size.value].decode("utf-16-le", "replace").rstrip("\0")


def _add(raw: Any, path: Any, matrix: Matrix, layer: str, clip: Visible, lines: Lines, *, shown: bool) -> None:
    """Add what a path draws within its clip, if it draws something dark."""
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
        lines.left_out["in part or whole outside of the page or of a clip path"] += 1
    lines.add(layer, seen, filled=is_area, width=_thickness(raw, path, matrix) if is_line and not is_area else 0.0)


def _thickness(raw: Any, path: Any, matrix: Matrix) -> float:
    """How thick a line is drawn, in points; 0 for what a pen draws."""
    width = ctypes.c_float()
    if not raw.FPDFPageObj_GetStrokeWidth(path, ctypes.byref(width)):
        return 0.0
    thick = width.value * math.sqrt(abs(float(np.linalg.det(matrix[:2, :2]))))
    return thick if PEN < thick <= FARTHEST else 0.0


def _brightness(get: Any, path: Any) -> float:
    """From 0 (black) to 1 (white, or transparent): on white paper."""
    red, green, blue, alpha = (ctypes.c_uint() for _ in range(4))
    if not get(path, *(ctypes.byref(value) for value in (red, green, blue, alpha))):
        return 0.0
    return 1.0 - alpha.value / 255 * (1.0 - (red.value + green.value + blue.value) / 765)


def _parts(raw: Any, segments: Iterable[Any], count: int, matrix: Matrix) -> list[list[tuple[float, float]]]:
    """The parts of a path of some segments as points, curves within a share of their size."""
    parts: list[list[tuple[float, float]]] = []
    if count > MOST_POINTS:
        raise Refused(f"a line of it has {count:,} points; expected a floor plan, at most {MOST_POINTS:,}")
    curve: list[tuple[float, float]] = []
    x, y = ctypes.c_float(), ctypes.c_float()
    for segment in segments:
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
