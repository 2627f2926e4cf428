"""Child process that reads a file of another program's format within limits, and the lines that it collects.

Its input is a line of JSON, ``{"module": .., "options": .., "memory": .., "seconds": ..}``, followed by the bytes of
the file. ``memory`` limits the address space, including the libraries; ``seconds`` is processor time. Its output is a
`ChildAnswer`: words and arrays of numbers, but no object that could run code.

Lines are counted by layer, limited in number, and clipped to visible parts.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

KINDS = ("<f8", "<i8", "|i1")
"""NumPy kinds of the arrays that may be returned."""
DISK = 1024**3
"""Largest temporary file, in bytes: some libraries unpack compressed data into one."""
MODULES = ("bag", "dxf", "pdf", "pieces")


class ChildRefused(Exception):
    """Refusal of a file that is not as expected; the text is for the user."""


class ChildAnswer(NamedTuple):
    """Contents of a file, as a child process returns them.

    words   numbers, texts, lists and mappings, as in JSON
    arrays  arrays by name
    """

    words: dict[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    def packed(self) -> bytes:
        """Return the answer as bytes: a line of JSON, followed by the bytes of the arrays."""
        header = {
            "words": self.words,
            "arrays": [[name, array.dtype.str, list(array.shape)] for name, array in self.arrays.items()],
        }
        bodies = (np.ascontiguousarray(array).tobytes() for array in self.arrays.values())
        return json.dumps(header).encode() + b"\n" + b"".join(bodies)


def unpack(data: bytes) -> ChildAnswer:
    """Return the answer from its bytes; raise `ChildRefused` for a refusal, ValueError for invalid bytes."""
    line, _, body = data.partition(b"\n")
    header = json.loads(line)
    if "refused" in header:
        raise ChildRefused(str(header["refused"]))
    arrays: dict[str, NDArray[Any]] = {}
    begin = 0
    for name, kind, shape in header["arrays"]:
        if kind not in KINDS or min(shape, default=0) < 0:
            raise ValueError(f"{kind} {shape}")
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(body, kind, count, begin).reshape(shape)
        begin += count * np.dtype(kind).itemsize
    return ChildAnswer(header["words"], arrays)


def refusal(text: str) -> bytes:
    """Return a refusal as bytes; ``text`` is for the user."""
    return json.dumps({"refused": text}).encode() + b"\n"


def set_limits(memory: int, seconds: int) -> None:
    """Limit the memory (bytes), processor time (s) and file size (`DISK`) of this process, if the system can do so."""
    try:
        import resource  # missing on some systems
    except ImportError:  # this system has no such limits
        return
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_FSIZE, DISK)):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, hard if kind == resource.RLIMIT_CPU else most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def answer_bytes(asked: dict[str, Any], data: bytes) -> bytes:
    """Return the answer to a request (see the module) about the bytes of a file as bytes, or the refusal."""
    try:
        if asked["module"] not in MODULES:
            raise ValueError(asked["module"])
        module = import_module(f"hpop.apart.{asked['module']}")
        answer: ChildAnswer = module.extract(data, asked["options"])
        return answer.packed()
    except ChildRefused as error:
        return refusal(str(error))
    except MemoryError:
        return refusal(f"reading it takes more than {asked['memory'] / 1e9:.2g} GB of memory; make it smaller")
    except Exception as error:  # libraries may raise any error on an invalid file
        return refusal(
            f"it cannot be read ({type(error).__name__}: {str(error)[:200]}); it may be damaged: export it again"
        )


def serve() -> None:
    """Read the request from standard input, write the answer, and end the process."""
    asked = json.loads(sys.stdin.buffer.readline())
    set_limits(asked["memory"], asked["seconds"])
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # so that output of a library does not get into the answer
    out.write(answer_bytes(asked, sys.stdin.buffer.read()))
    out.flush()
    os._exit(0)  # without clean-up, because a library might hang in it


MOST_POINTS = 500_000
"""Largest number of points of all lines."""
MOST_THINGS = 1_000_000
"""Largest number of entities that are read, including references to blocks or forms."""
MOST_DEEP = 16
"""Largest depth of blocks within blocks."""
FARTHEST = 1e12
"""Largest absolute coordinate, in the drawing's units."""
SAG = 5e-4
"""Largest distance of a curve from its chords, as a share of its size."""


HIDDEN = "on layers that are off or frozen"
"""Note on hidden entities."""
Points = Sequence[tuple[float, float]]
NEAR = 0.01
"""Largest distance beyond a border at which a point still counts as on the border, in the drawing's units."""


class Lines:
    """Collector of the lines and areas of a drawing.

    layers  names of the layers to read, or None for all layers that are shown
    """

    def __init__(self, layers: Sequence[str] | None) -> None:
        self._asked = None if layers is None else {name.casefold() for name in layers}
        self._points: list[tuple[float, float]] = []
        self._starts = [0]
        self._layer: list[int] = []
        self._area: list[int] = []
        self._width: list[float] = []
        self._areas = 0
        self._things = 0
        self._layers: dict[str, int] = {}
        self.counted: Counter[str] = Counter()
        """Number of lines and areas by layer, including layers that are not requested."""
        self.left_out: Counter[str] = Counter()
        self.wide = 0
        """Number of thick lines that are read as areas."""

    def count_entity(self) -> None:
        """Count one more entity of the drawing; raise `ChildRefused` if there are too many."""
        self._things += 1
        if self._things > MOST_THINGS:
            raise ChildRefused(
                f"the drawing has more than {MOST_THINGS:,} entities, too many for a floor plan; remove some entities"
            )

    def wants(self, layer: str, *, shown: bool = True) -> bool:
        """Count an entity of a layer, and return whether to read it.

        It is read if its layer was requested; if no layers were requested, if its layer is on (``shown``).
        """
        self.counted[layer] += 1
        if self._asked is not None:
            return layer.casefold() in self._asked
        if not shown:
            self.left_out[HIDDEN] += 1
        return shown

    def add(
        self,
        layer: str,
        paths: Iterable[Sequence[tuple[float, float]]],
        *,
        filled: bool = False,
        width: float = 0.0,
    ) -> None:
        """Add polylines, each given by its points; if ``filled``, they bound one area together.

        width  thickness of the lines, which have flat ends, in the drawing's units; 0 for pen strokes
        """
        self._areas += filled
        for path in paths:
            if len(path) < 2:
                continue
            self._points += path
            self._starts.append(len(self._points))
            self._layer.append(self._layers.setdefault(layer, len(self._layers)))
            self._area.append(self._areas if filled else 0)
            self._width.append(width)
            if len(self._points) > MOST_POINTS:
                raise ChildRefused(
                    f"the lines of the drawing have more than {MOST_POINTS:,} points, too many for a floor plan; name "
                    "the layers to read, such as those of walls, with the option layers. Lines and areas by layer, up "
                    f"to this point: {counts_text(self.counted)}"
                )

    def answer(self, known: Iterable[str], **words: Any) -> ChildAnswer:
        """Return the collected lines; raise `ChildRefused` if a requested layer is missing.

        Arrays: ``points`` (n, 2) of all lines; ``starts`` (m + 1,), the index of each line's first point. Arrays
        (m,), one number for each line: ``width``, its thickness, 0 for a pen stroke; ``layer``, an index into the word
        ``layers``; ``area``, a number that the lines round one filled area share, 0 for others. Words: names of layers,
        and counts.

        known  names of all layers that the file lists, including layers without lines
        words  further words of the answer
        """
        names = {name.casefold(): name for name in (*known, *self.counted)}
        for name in sorted(self._asked or ()):
            if name not in names:
                near = get_close_matches(name[:100], list(names)[:10_000], n=1)
                hint = f" Did you mean {names[near[0]]!r}?" if near else ""
                raise ChildRefused(
                    f"it has no layer {name[:100]!r}.{hint} Its layers are {counts_text(self.counted) or 'none'}"
                )
        points = np.array(self._points, dtype=np.float64).reshape(-1, 2)
        if not (np.abs(points) <= FARTHEST).all():
            raise ChildRefused(f"all coordinates of the file must be finite numbers, at most {FARTHEST:.0e}")
        words |= {
            "layers": list(self._layers),
            "counted": dict(self.counted.most_common(100)),
            "left_out": dict(self.left_out.most_common(20)),
            "wide": self.wide,
        }
        arrays = {"starts": self._starts, "layer": self._layer, "area": self._area}
        whole = {name: np.asarray(numbers, "<i8") for name, numbers in arrays.items()}
        return ChildAnswer(words, {"points": points, "width": np.asarray(self._width, "<f8"), **whole})


def counts_text(counted: Counter[str] | dict[str, int], most: int = 12) -> str:
    """Return names with their counts as text, the largest count first."""
    several = sorted(counted.items(), key=lambda entry: (-entry[1], entry[0]))
    return ", ".join(f"{name} ({count:,})" for name, count in several[:most]) + ", ..." * (len(several) > most)


@dataclass(frozen=True)
class Visible:
    """Visible part of a drawing: the intersection of a rectangle with areas, in the drawing's coordinates.

    box    x0, y0, x1, y1 of the rectangle
    areas  shapely polygons, for clip paths that are not axis-parallel rectangles
    """

    box: tuple[float, float, float, float]
    areas: tuple[Any, ...] = ()

    def cut(self, parts: Sequence[Points]) -> Visible:
        """Return the intersection with a clip path; it is empty if the path has no area."""
        corners = [part for part in parts if len(part) > 2]
        if len(corners) == 1 and _is_box(corners[0]):
            x0, y0, x1, y1 = self.box
            xs, ys = zip(*corners[0], strict=True)
            return replace(self, box=(max(x0, min(xs)), max(y0, min(ys)), min(x1, max(xs)), min(y1, max(ys))))
        return replace(self, areas=(*self.areas, _area(corners)))

    def of(self, parts: Sequence[Points], *, filled: bool) -> list[Points]:
        """Return the visible part of lines ``parts``, or if ``filled`` of the area that they enclose (even-odd rule).

        An area is returned as its outlines.
        """
        x0, y0, x1, y1 = self.box
        inside = all(x0 - NEAR <= x <= x1 + NEAR and y0 - NEAR <= y <= y1 + NEAR for part in parts for x, y in part)
        if inside and not self.areas:
            return list(parts)
        if x1 <= x0 or y1 <= y0:
            return []
        import shapely  # slow to import

        whole: Any = _area(parts) if filled else shapely.MultiLineString([part for part in parts if len(part) > 1])
        for area in (shapely.box(x0 - NEAR, y0 - NEAR, x1 + NEAR, y1 + NEAR), *self.areas):
            whole = shapely.intersection(whole, area)
        rings: Any = shapely.get_parts(whole)
        if filled:
            rings = shapely.get_rings(rings[shapely.get_type_id(rings) == shapely.GeometryType.POLYGON])
        lines = rings[shapely.length(rings) > 0]
        return [[(x, y) for x, y in shapely.get_coordinates(line).tolist()] for line in lines]


def _is_box(corners: Points) -> bool:
    """Return whether corners (the first may be repeated at the end) form an axis-parallel rectangle."""
    points = list(dict.fromkeys(corners))
    if len(points) != 4:
        return False
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = points
    across = ay == by and bx == cx and cy == dy and dx == ax
    return across or (ax == bx and by == cy and cx == dx and dy == ay)


def _area(parts: Sequence[Points]) -> Any:
    """Return the area that closed lines enclose by the even-odd rule."""
    import shapely  # slow to import

    rings = [shapely.LineString([*part, part[0]]) for part in parts if len(part) > 2]
    return shapely.build_area(shapely.union_all(rings)) if rings else shapely.Polygon()
