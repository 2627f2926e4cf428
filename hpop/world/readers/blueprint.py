"""Find parts of a blueprint image that are no walls, such as lettering and specks, and regions closed to the robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.text import counted
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.geometry.shapes import Raster, rotate

DARK, LIGHT = 0.25, 0.9
"""Brightness below which a pixel is dark, and above which it is light."""
EDGE = 2
"""Distance, pixels, from an obstacle within which grey is the edge of the obstacle, blurred by smoothing or JPEG."""
LEAST = 4
"""Least size, pixels, of a grey area that a note mentions."""
TOLD = 3
"""Number of areas or words that a note describes one by one."""
LETTER = 2.0
"""Largest side of a letter on a plan, m."""
LINE = 5
"""Least height, pixels, of the tallest letter of a word."""
WORD = 3
"""Least number of letters of a word."""
SPARE = 2.0
"""Factor between the area of the largest letter and the proposed limit, if no other obstacle is between the two."""
MOST_SPECKS = 20_000
"""Largest number of obstacles among which lettering is searched; more are noise."""
LABELS = 8
"""Bytes per pixel while connected pixels are numbered and examined."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green and blue in the relative luminance of sRGB."""
ROWS = 1_000_000
"""Pixels that are counted together."""

_ROUND = np.ones((3, 3), dtype=bool)  # a pixel and its eight neighbours, as lines may be connected at corners
THIN = 3
"""Largest thickness of a line, pixels, that may be a door swing rather than a wall."""
WALLS = 0.5
"""Least share of dark pixels in thick walls for which thin lines are suspicious; else all walls are thin lines."""
ROOM = 1.0
"""Area, m², of a part of the free space that counts as a room."""
MOST = 1_000
"""Largest thickness, pixels, below which lines are removed."""


class Specks(NamedTuple):
    """Groups of connected pixels; row i of the arrays describes group i.

    area    (n,)    int     pixels
    boxes   (n, 4)  int     first row, first column, last row + 1, last column + 1
    """

    area: IntArray
    boxes: IntArray


def without_specks(raster: Raster, smallest: float) -> tuple[BoolArray, str]:
    """Return cells (H, W) without obstacles smaller than ``smallest``, m², and a note on what was removed."""
    cells, square = raster.cells, raster.resolution**2
    labels, count = numbered(cells, _ROUND)
    area = areas_of(labels, count)
    small = area * square < smallest
    small[0] = False
    left = np.count_nonzero(small)
    note = f"{left:,} obstacles smaller than {smallest:g} m² are left out"
    if left:
        note += f", {area[small].sum() * square:.3g} m² in all, the largest {area[small].max() * square:.3g} m²"
    others = np.flatnonzero(~small)[1:]
    stay = []
    for number in others[np.argsort(area[others], kind="stable")][:TOLD].tolist():
        r0, c0, r1, c1 = _box(labels == number)
        x, y = raster.to_world((c0 + c1) / 2, (r0 + r1) / 2)
        stay.append(f"{area[number] * square:.3g} m² at ({x:.2f}, {y:.2f})")
    return cells & ~small[labels], f"{note}; the smallest that stay are {', '.join(stay)}" if stay else note


def closed_from(raster: Raster, inside: tuple[float, float]) -> tuple[BoolArray, str]:
    """Return all cells (H, W) that are solid or cannot be reached from a point (x, y), m, and a note on their area.

    A cell is connected to its four neighbours that share a side, so a line of pixels that touch at corners is closed.
    Raises MapError for a point in an obstacle or beyond the image.
    """
    rows, columns = raster.cells.shape
    x, y = rotate(inside[0] - raster.origin[0], inside[1] - raster.origin[1], -raster.origin[2])
    row, column = math.floor(y / raster.resolution), math.floor(x / raster.resolution)
    where = f"inside ({inside[0]:g}, {inside[1]:g})"
    if not (0 <= row < rows and 0 <= column < columns):
        raise MapError(f"{where} is not on the image, which is {_size(rows, columns, raster)}. Move the point.")
    if raster.cells[row, column]:
        raise MapError(f"{where} is in an obstacle; expected a point in free space. Move it, or change threshold.")
    labels, _ = numbered(~raster.cells, None)
    reached = labels == labels[row, column]
    closed = np.count_nonzero(~reached) - np.count_nonzero(raster.cells)
    note = f"{closed * raster.resolution**2:.4g} m² that cannot be reached from {where} are solid"
    if reached[[0, -1]].any() or reached[:, [0, -1]].any():
        note += "; the reached region extends to the edge of the image, so the plan is open there"
    return ~reached, note


def greys(shade: NDArray[np.uint8], dark: BoolArray, threshold: float, raster: Raster) -> Iterator[str]:
    """Yield notes on pixels that are neither dark nor light, and on grey areas that count as free.

    shade  (H, W)  brightness from 0 to 255, row 0 at the bottom
    dark   (H, W)  the obstacles
    """
    grey = (shade >= round(255 * DARK)) & (shade <= round(255 * LIGHT))
    count, solid = np.count_nonzero(grey), np.count_nonzero(grey & dark)
    if not count:
        return
    share = f"{count:,} of {grey.size:,} pixels ({100 * count / grey.size:.2g} %)"
    yield (
        f"{share} are neither dark nor light (brightness from {DARK} to {LIGHT}): {solid:,} below the threshold "
        f"{threshold:g} are obstacles, {count - solid:,} are free"
    )
    from scipy import ndimage  # slow to import

    apart = grey & ~ndimage.maximum_filter(dark, 2 * EDGE + 1)
    labels, found = numbered(apart, _ROUND)
    area = areas_of(labels, found)
    area[0] = 0
    large = np.flatnonzero(area >= LEAST)
    if not large.size:
        return
    told = []
    brightest = 0
    for number in large[np.argsort(-area[large], kind="stable")][:TOLD].tolist():
        cells = labels == number
        shades = shade[cells]
        brightest = max(brightest, int(shades.max()))
        r0, c0, r1, c1 = _box(cells)
        x, y = raster.to_world((c0 + c1) / 2, (r0 + r1) / 2)
        size = _size(r1 - r0, c1 - c0, raster)
        told.append(f"{size} at ({x:.2f}, {y:.2f}), brightness {shades.mean() / 255:.2f}")
    said = "; ".join(told) + f"; and {len(large) - TOLD:,} smaller" * (len(large) > TOLD)
    enough = math.ceil(100 * (brightest + 1) / 255) / 100
    yield (
        f"{counted(len(large), 'grey area')} away from the edges of obstacles count{'s' * (len(large) == 1)} as free: "
        f"{said}. To make all grey areas obstacles, give threshold: {enough:g}"
    )


def contrast(colours: FloatArray, alpha: FloatArray | None) -> FloatArray:
    """Return the contrast (h, W) of pixels against white paper: (1 - Y) / (1 + Y) with their relative luminance Y.

    This is Michelson's contrast. Y is the weighted sum of the linear red, green and blue of sRGB (IEC 61966-2-1).

    colours  (h, W, channels)  sRGB from 0 to 1; one channel is grey
    alpha    (h, W)            opacity on white paper; None for opaque pixels
    """
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    luminance = linear[..., 0] if colours.shape[-1] == 1 else linear @ LUMINANCE
    if alpha is not None:
        luminance = luminance * alpha + (1.0 - alpha)
    return np.asarray((1.0 - luminance) / (1.0 + luminance))


def contrasts_of(cells: BoolArray, drawn: BoolArray, percent: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], str]:
    """Return the contrast (H, W), %, of solid cells from that of the drawn obstacles among them, and a note on these.

    The highest contrast of an obstacle within :data:`EDGE` pixels counts: blurred edges have that of the inside. Other
    solid cells, such as closed areas far behind a wall, have 100.
    """
    from scipy import ndimage  # slow to import

    limits.hold(READING, 0, 3 * drawn.size)
    found = ndimage.maximum_filter(np.where(drawn, percent, 0).astype(np.uint8), 2 * EDGE + 1)
    of_obstacles = found[drawn]
    if not of_obstacles.size:
        return np.full(drawn.shape, 100, dtype=np.uint8), "there are no obstacles whose colours could set a contrast"
    low, middle, high = (of_obstacles.min(), np.median(of_obstacles), of_obstacles.max())
    return np.where(drawn | (cells & (found > 0)), found, 100).astype(np.uint8), (
        f"obstacles have the contrast of their colours against white, {low / 100:.2f} to {high / 100:.2f} (median "
        f"{middle / 100:.2f}; black has 1): a weight in optic_flow"
    )


def lettering(raster: Raster) -> Iterator[str]:
    """Yield a note on obstacles that look like lettering: lines of small specks of similar height, close together."""
    labels, count = numbered(raster.cells, _ROUND)
    if count > MOST_SPECKS:
        yield (
            f"there are {count:,} obstacles, more than a building has: smallest_obstacle: "
            f"{9 * raster.resolution**2:.2g} (m²) leaves out those of less than nine pixels"
        )
        return
    from scipy import ndimage  # slow to import

    area = areas_of(labels, count)[1:]
    found = ndimage.find_objects(labels)
    boxes = np.array([[r.start, c.start, r.stop, c.stop] for r, c in found], dtype=np.int64).reshape(-1, 4)
    sides = (boxes[:, 2:] - boxes[:, :2]) * raster.resolution
    small = np.flatnonzero((sides <= LETTER).all(axis=1))
    some = Specks(area[small], boxes[small])
    words = [*_words(some, turned=False), *_words(some, turned=True)]
    letters = np.unique(np.concatenate(words)) if words else np.zeros(0, dtype=np.int64)
    if not letters.size:
        return
    largest = int(some.area[letters].max())
    others = np.count_nonzero(area <= largest) - letters.size
    if np.count_nonzero(area <= SPARE * largest) - letters.size == others:  # letters that touch count as one letter
        largest = math.floor(SPARE * largest)
    places = []
    for word in words[:TOLD]:
        r0, c0 = some.boxes[word, :2].min(axis=0).tolist()
        r1, c1 = some.boxes[word, 2:].max(axis=0).tolist()
        x, y = raster.to_world((c0 + c1) / 2, (r0 + r1) / 2)
        places.append(f"({x:.2f}, {y:.2f})")
    enough = _rounded_up((largest + 0.5) * raster.resolution**2)
    yield (
        f"{letters.size:,} specks look like lettering, in {len(words):,} word{'s' * (len(words) > 1)} at "
        f"{', '.join(places)}{', ...' * (len(words) > TOLD)}, and are obstacles. To leave them "
        f"out{f', and {others:,} others as small' * bool(others)}, give smallest_obstacle: {enough:g} (m²)"
    )


def _words(specks: Specks, *, turned: bool) -> list[IntArray]:
    """Return, for each word, the indices in ``specks`` of its letters; words run horizontally, or upward if ``turned``.

    Letters of a word are close together and of similar height.
    """
    r0, c0, r1, c1 = specks.boxes.T if not turned else specks.boxes[:, [1, 0, 3, 2]].T
    if not len(r0):
        return []
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.csgraph import connected_components  # slow to import

    height = r1 - r0
    reach = 0.4 * height  # half of a gap: letters whose widened boxes meet are neighbours
    boxes = shapely.box(c0 - reach, r0, c1 + reach, r1)
    a, b = shapely.STRtree(boxes).query(boxes)
    overlap = np.minimum(r1[a], r1[b]) - np.maximum(r0[a], r0[b])
    alike = np.maximum(height[a], height[b]) <= 2.5 * np.minimum(height[a], height[b])
    joined = (a < b) & alike & (overlap >= 0.5 * np.minimum(height[a], height[b]))
    links = coo_array((np.ones(joined.sum()), (a[joined], b[joined])), shape=(len(r0), len(r0)))
    _, word = connected_components(links, directed=False)
    order = np.argsort(word, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(word[order])) + 1)
    return [
        group
        for group in groups
        if len(group) >= WORD
        and height[group].max() >= LINE
        and np.ptp(c0[group]) > np.ptp(r0[group])
        and np.ptp(specks.area[group]) > 0.1 * specks.area[group].max()  # chairs and columns are alike
    ]


def numbered(cells: BoolArray, structure: BoolArray | None) -> tuple[NDArray[np.int32], int]:
    """Assign numbers from 1 to groups of connected cells; return the numbers (H, W), 0 for False, and their count.

    ``structure`` is `_ROUND` to connect cells that touch at corners, and None to connect only those that share a side.
    """
    from scipy import ndimage  # slow to import

    limits.hold(READING, 0, LABELS * cells.size)
    labels = np.empty(cells.shape, dtype=np.int32)
    return labels, int(ndimage.label(cells, structure, output=labels))


def areas_of(labels: NDArray[np.int32], count: int) -> IntArray:
    """Return the number of cells with each label from 0 to ``count``, (count + 1,); label 0 marks False cells.

    Labels are counted in blocks of rows, to bound memory.
    """
    step = max(1, ROWS // labels.shape[1])
    area = np.zeros(count + 1, dtype=np.int64)
    for top in range(0, labels.shape[0], step):
        area += np.bincount(labels[top : top + step].ravel(), minlength=count + 1)
    return area


def _box(cells: BoolArray) -> list[int]:
    """Return the bounding box of the True cells: first row, first column, last row + 1, last column + 1."""
    rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    return [int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1]


def _size(rows: int, columns: int, raster: Raster) -> str:
    return f"{columns * raster.resolution:.3g} x {rows * raster.resolution:.3g} m"


def _rounded_up(value: float) -> float:
    """Return a number rounded up to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.6g}")


def without_lines(raster: Raster, thinnest: float) -> tuple[BoolArray, str]:
    """Return cells (H, W) without obstacles thinner than ``thinnest``, m, and a note on the removed pixels.

    The ends of thin lines at thick walls stay, see `_thick`.
    """
    pixels = min(MOST, math.ceil(thinnest / raster.resolution - 1e-9))
    thick = _thick(raster.cells, pixels)
    removed = np.count_nonzero(raster.cells) - np.count_nonzero(thick)
    square = raster.resolution**2
    return (
        thick,
        f"lines thinner than {thinnest:g} m are left out: {removed:,} pixels, {removed * square:.3g} m²",
    )


def closing(raster: Raster) -> Iterator[str]:
    """Yield a note on lines between rooms that are thinner than the walls; they may be the swings of doors."""
    cells = raster.cells
    thick = _thick(cells, THIN + 1)
    thin = cells & ~thick
    if not thin.any() or np.count_nonzero(thick) < WALLS * np.count_nonzero(cells):
        return
    from scipy import ndimage  # slow to import

    lines, count = numbered(thin, _ROUND)
    if count > MOST_SPECKS:
        return
    rooms, found = numbered(~cells, None)
    large = areas_of(rooms, found) * raster.resolution**2 >= ROOM
    large[0] = False
    pairs = np.unique(np.concatenate([*_beside(lines, rooms, large)]), axis=0)
    numbers, beside = np.unique(pairs[:, 0], return_counts=True)
    parting = numbers[beside > 1]
    if not parting.size:
        return
    boxes = ndimage.find_objects(lines)
    places = []
    for number in parting[:TOLD].tolist():
        rows, columns = boxes[number - 1]
        x, y = raster.to_world((columns.start + columns.stop) / 2, (rows.start + rows.stop) / 2)
        places.append(f"({x:.2f}, {y:.2f})")
    thickness = (THIN + 1) * raster.resolution
    yield (
        f"{counted(parting.size, 'line')} of up to {THIN * raster.resolution:.2g} m close passages, thinner than the "
        f"walls, at {', '.join(places)}{', ...' * (parting.size > TOLD)}: swings of doors, or windows. "
        f"thinnest_obstacle: {thickness:.3g} (m) leaves out all such lines"
    )


def _beside(lines: NDArray[np.int32], rooms: NDArray[np.int32], large: BoolArray) -> Iterator[NDArray[np.int32]]:
    """Yield pairs (n, 2): the number of a line, and the number of a large room that it touches."""
    for a, b in (
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
    ):
        for line, room in ((lines[a], rooms[b]), (lines[b], rooms[a])):
            both = (line > 0) & large[room]
            yield np.unique(np.stack([line[both], room[both]], axis=1), axis=0)


def _thick(cells: BoolArray, pixels: int) -> BoolArray:
    """Return the obstacle cells (H, W) in squares of ``pixels`` x ``pixels`` obstacle cells, and those near to one.

    Near is up to ``pixels`` // 2 cells away along each axis, which keeps the corners of rotated walls.
    """
    if pixels <= 1:
        return cells
    from scipy import ndimage  # slow to import

    limits.hold(READING, 0, 3 * cells.size)
    found = cells.astype(np.uint8)
    for axis in (0, 1):  # beyond the image its edge is repeated
        found = ndimage.minimum_filter1d(found, pixels, axis=axis, mode="nearest")
    even = -1 if pixels % 2 == 0 else 0  # shifts even squares back to their least pixels
    for axis in (0, 1):
        found = ndimage.maximum_filter1d(found, pixels, axis=axis, mode="constant", cval=0, origin=even)
    near = ndimage.maximum_filter(found, 2 * (pixels // 2) + 1)  # keeps the corners of rotated walls
    return np.asarray(cells & (near > 0))
