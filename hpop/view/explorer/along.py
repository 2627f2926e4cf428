"""Columns of the explorer page along trajectories: camera paths as packed corners, and the rates of criteria.

Trajectories of a front share most of their motions, so the camera's path is computed once for each motion. A trajectory
is then a list of corners; points on straight stretches between corners are left out.

All numbers are whole numbers in one zlib stream, in base64. A column (`Part`) holds the lowest bytes of all its
numbers, then the next bytes, and so on (little-endian): the upper bytes of neighbouring numbers are alike, so the
stream compresses well. Many columns hold differences; ``order`` is the number of times a reader must sum them up. Sums
wrap around at 32 bits, on both sides alike.

**Charts.** Named rows (such as the knee) come first, then others evenly over the front, up to a limit. Pieces are the
short stretches of motions for which :class:`hpop.problems.evaluation.Trace` has rates. Neighbouring pieces of a long
trajectory are merged so that sums, means and worst moments are kept.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.motions import Law, Model, States
from hpop.problems.evaluation import Trace, claimable, criteria_of, trace
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.view.style import label, positions

PIECES = 24  # most straight pieces for a motion with a curved camera path
FEWER = (1, 2, 3, 4, 6, 8, 12)  # smaller numbers of pieces, tried first
BENDS = 2e-3  # m: tolerance between the path and the pieces
PROBES, EXACT = 4, 1e-9  # m: number and tolerance of the points that test a path for straightness
STRAIGHT = 1e-7  # rad: smaller bends are no corners
MILLIMETRES = 1000.0
FARTHEST = 2**31 - 1  # mm


class PathCorners(NamedTuple):
    """Corners of n camera paths, seen from above.

    places   (P, 2) mm from the origin, distinct, in order of first use
    corners  (C,)   indices of the places along the paths, path by path
    counts   (n,)   number of corners of each path, at least one
    heights         m, least and greatest camera height
    """

    places: IntArray
    corners: IntArray
    counts: IntArray
    heights: tuple[float, float]


def millimetres(points: FloatArray, origin: tuple[float, float]) -> IntArray:
    """Convert points (N, 2), m, to whole millimetres from an origin, clipped at 2,000 km."""
    whole: IntArray = np.rint((points - np.array(origin)) * MILLIMETRES).clip(-FARTHEST, FARTHEST).astype(np.int64)
    return whole


def corners(trajectories: Sequence[Trajectory], origin: tuple[float, float]) -> PathCorners:
    """Return the corners of the camera paths of trajectories of one model, in mm from ``origin`` (x, y), m.

    There may be no trajectories.
    """
    if not len(trajectories):
        nothing = np.zeros(0, dtype=np.int64)
        return PathCorners(nothing.reshape(0, 2), nothing, nothing, (np.inf, -np.inf))
    table = MotionTable.of(trajectories)
    points, through, owner = _trajectory_points(table)
    heights = float(points[:, 2].min()), float(points[:, 2].max())
    plane = points[:, :2]
    grid = millimetres(plane, origin)
    through, owner = _selected(through, owner, _moves(grid[through], owner))
    through, owner = _selected(through, owner, _turns(plane[through], owner))
    keys = grid[through, 0] * (2 * FARTHEST + 2) + grid[through, 1]  # within 64 bits
    _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)  # by first appearance: near each other, as paths are
    rank = np.empty(order.size, dtype=np.int64)
    rank[order] = np.arange(order.size)
    counts = np.bincount(owner, minlength=len(trajectories))
    return PathCorners(grid[through[first[order]]], rank[place.reshape(-1)], counts, heights)


def _trajectory_points(table: MotionTable) -> tuple[FloatArray, IntArray, IntArray]:
    """Return all camera points of the motions, and the sequence of these points along each trajectory.

    The points are (G, 3), m. For all trajectories in turn, (T,) indices of points and (T,) numbers of the trajectories.
    """
    ends = positions(table.model.pose("camera", table.states))
    known, counts = [ends], np.zeros(len(table), dtype=np.int64)
    begins: IntArray = np.zeros(len(table), dtype=np.int64)
    size = len(ends)
    for index, law, start, end in table.by_law():
        if not law.varies.intersection(table.model.space.names):  # stands still
            continue
        line = partial(_line, table.model, law)
        bends = _off(line(start, end, PROBES), 1).max(axis=1) > EXACT
        index, start, end = index[bends], start.take(bends), end.take(bends)
        for pieces, found, within in _pieces(line(start, end, PIECES)):
            motions = index[found]
            begins[motions] = size + np.arange(motions.size) * (pieces - 1)
            counts[motions] = pieces - 1
            known.append(within.reshape(-1, 3))
            size += known[-1].shape[0]
    each = counts[table.motions] + 1  # points of a motion: inner ones, and its end
    lengths = np.bincount(table.owner, each, minlength=table.counts.size).astype(np.int64) + 1
    firsts = np.cumsum(lengths) - lengths
    through = np.empty(int(lengths.sum()), dtype=np.int64)
    rest = np.ones(through.size, dtype=bool)
    rest[firsts] = False
    through[firsts] = table.first
    piece = np.arange(int(each.sum())) - np.repeat(np.cumsum(each) - each, each)
    of_motion = np.repeat(table.motions, each)
    through[rest] = np.where(piece < counts[of_motion], begins[of_motion] + piece, table.end[of_motion])
    return np.concatenate(known), through, np.repeat(np.arange(lengths.size), lengths)


def _line(model: Model, law: Law, start: States, end: States, pieces: int) -> FloatArray:
    """Return M camera paths as points (M, pieces + 1, 3), m, at equal shares of each motion from start to end."""
    found = []
    for piece in range(pieces + 1):
        share = np.full(start.size, piece / pieces)
        columns = {
            name: law.interpolate(name, start, end, share) if name in law.varies else getattr(start, name)
            for name in model.space.names
        }
        found.append(positions(model.pose("camera", States(**columns))))
    return np.stack(found, axis=1)


def _off(line: FloatArray, pieces: int) -> FloatArray:
    """Return how far, seen from above, lines (M, N + 1, 3) are from the ones with only ``pieces`` straight pieces.

    The distances are (M, N), m: of each point but the last, to the point of the other line with its index.
    """
    plane, count = line[..., :2], line.shape[1] - 1
    step = count // pieces
    knots = plane[:, ::step]
    share = (np.arange(step) / step)[:, None]
    drawn = knots[:, :-1, None] + share * (knots[:, 1:, None] - knots[:, :-1, None])  # (M, pieces, step, 2)
    x, y = np.moveaxis(drawn.reshape(-1, count, 2) - plane[:, :-1], -1, 0)
    off: FloatArray = np.hypot(x, y)
    return off


def _pieces(line: FloatArray) -> Iterator[tuple[int, IntArray, FloatArray]]:
    """Yield numbers of straight pieces, each with the indices of the lines that it suffices for and their inner points.

    The inner points of m lines are (m, pieces - 1, 3). Each line appears once, at the smallest number of pieces that
    is within tolerance; numbers that suit no line are yielded with empty arrays.

    line  (M, PIECES + 1, 3) m, curved lines
    """
    left = np.arange(len(line))
    for pieces in (*FEWER, PIECES):
        fits = np.ones(left.size, dtype=bool) if pieces == PIECES else _off(line[left], pieces).max(axis=1) < BENDS
        step = PIECES // pieces
        yield pieces, left[fits], line[left[fits], step:PIECES:step]
        left = left[~fits]


def _selected(through: IntArray, owner: IntArray, kept: BoolArray) -> tuple[IntArray, IntArray]:
    """Return ``through`` and ``owner`` (T,), point and path by number, only where the mask ``kept`` (T,) is True."""
    return through[kept], owner[kept]


def _moves(grid: IntArray, owner: IntArray) -> BoolArray:
    """Return a mask (T,) of path points ``grid`` (T, 2) that differ from the point before, or begin their path.

    owner  (T,) number of the path of each point
    """
    kept = np.ones(owner.size, dtype=bool)
    kept[1:] = (owner[1:] != owner[:-1]) | (grid[1:] != grid[:-1]).any(axis=1)
    return kept


def _turns(points: FloatArray, owner: IntArray) -> BoolArray:
    """Return a mask (T,) of path points to keep: ends of a path, bends, and points where the path turns back."""
    kept = np.ones(owner.size, dtype=bool)
    before, after = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    along = (before * after).sum(axis=1)
    inner = (owner[1:-1] == owner[:-2]) & (owner[1:-1] == owner[2:])
    kept[1:-1] = ~inner | (along <= 0.0) | (np.abs(cross) > STRAIGHT * along)
    return kept


Kind = Literal["int32", "int16", "float64"]
Part = tuple[Kind, int, int, int]
"""Description of a packed column: kind, position of its first byte, number of values, and ``order``."""
LEVEL = 9  # compression level, of 9; takes a tenth of a second for a front of thousands


class Packer:
    """Collector of columns of numbers, which are compressed into one text; each column is described by its position."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def integers(self, values: ArrayLike, *, order: int = 0) -> Part:
        """Add a column of whole numbers (N,) within 32 bits, stored as differences taken ``order`` times."""
        return self._add_part("int32", _differences(values, order), order)

    def short(self, values: ArrayLike) -> Part:
        """Add a column of whole numbers (N,) within 16 bits."""
        return self._add_part("int16", values, 0)

    def floats(self, values: ArrayLike) -> Part:
        """Add a column of floats (N,), bit for bit."""
        return self._add_part("float64", values, 0)

    def text(self) -> str:
        """Return all columns, compressed, as base64 text."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), LEVEL)).decode()

    def _add_part(self, kind: Kind, values: ArrayLike, order: int) -> Part:
        data = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
        planes: NDArray[np.uint8] = data.view(np.uint8).reshape(data.size, data.itemsize).T
        part = (kind, self._size, data.size, order)
        self._parts.append(planes.tobytes())
        self._size += data.nbytes
        return part


def _differences(values: ArrayLike, order: int) -> NDArray[np.int32]:
    """Return successive differences (the first value is kept), taken ``order`` times, modulo 2**32."""
    found = np.asarray(values, dtype=np.int64)
    for _ in range(order):
        found = np.diff(found, prepend=0)
    return found.astype(np.uint32).view(np.int32)


MOST_PIECES = 160  # of a trajectory, as many as a screen resolves
STEPS = 2**14 - 1  # resolution of a criterion's largest value, so that differences have 16 bits
ADDS: dict[str, str] = {"time-mean": "mean", "max": "max"}  # all others are sums
TRACES, ONE_IN, MOST = 10, 400, 30  # rows to trace: least number, one per so many rows, most
TICKS = 2**22  # resolution of a duration: exact for pieces of milliseconds, and small differences
THOUSANDTHS = 1000.0  # rad


def traced_rows(front: Front, named: Sequence[int]) -> list[int]:
    """Return the rows that get a chart of rates: the named rows, then others evenly over the front."""
    rows = list(dict.fromkeys(named))
    others = max(0, min(TRACES + len(front) // ONE_IN, MOST, len(front)) - len(rows))
    middles = (np.arange(others) + 0.5) * len(front) / max(1, others)
    return [*rows, *(row for row in dict.fromkeys(middles.astype(int).tolist()) if row not in rows)]


def columns_of(problem: Problem, front: Front) -> list[Criterion | None]:
    """Return the criterion of each column of a front, reported ones included; None if it is no longer registered."""
    known = {criterion.name: criterion for criterion in criteria_of(front)} | claimable(problem)
    return [known.get(name) for name in front.names + front.reported_names]


def traces(
    problem: Problem,
    front: Front,
    columns: Sequence[Criterion | None],
    rows: Sequence[int],
    packer: Packer,
    origin: tuple[float, float],
) -> Iterator[dict[str, Any]]:
    """Yield a dict for JSON for each of the front's ``rows``: times, camera poses, and rates of the criteria.

    Its columns of numbers are added to ``packer``; positions count from ``origin``, m. Rows without motion are skipped.
    """
    criteria = [criterion for criterion in columns if criterion is not None]
    for row in rows:
        if len(front.trajectories[row]):
            yield {"row": row, **_packed_trace(trace(criteria, front.trajectories[row], problem.world), packer, origin)}


def _packed_trace(found: Trace, packer: Packer, origin: tuple[float, float]) -> dict[str, Any]:
    """Return the times, camera positions and headings, and values of the criteria along one trajectory, for JSON."""
    ends = piece_ends(len(found.pieces), MOST_PIECES)
    pose = found.pieces.trajectory.model.pose("camera", found.states)
    x, y, yaw = (np.broadcast_to(column, found.times.shape)[ends] for column in (pose.x, pose.y, pose.yaw))
    places = millimetres(np.stack([x, y], axis=1), origin)
    tick = float(found.times[-1]) / TICKS or 1.0  # s
    several = [_quantised_values(found, column, ends) for column in range(len(found.criteria))]
    return {
        "tick": tick,
        "t": packer.integers(np.rint(found.times[ends] / tick), order=1),
        "x": packer.integers(places[:, 0], order=2),
        "y": packer.integers(places[:, 1], order=2),
        "yaw": packer.integers(np.rint(np.unwrap(yaw) * THOUSANDTHS), order=1),
        "steps": [step for step, _ in several],
        "values": packer.short(np.concatenate([np.zeros(0), *(values for _, values in several)])),
    }


def piece_ends(pieces: int, most: int) -> IntArray:
    """Return the indices (n+1,) at which groups of consecutive pieces begin and end.

    The number of groups is the smaller of ``pieces``, the number of pieces, and ``most``; their sizes are about equal.
    """
    return np.unique(np.linspace(0, pieces, min(pieces, most) + 1).round().astype(np.int64))


def merged_rates(found: Trace, column: int, ends: IntArray) -> FloatArray:
    """Return the rate (m,) of a criterion in each of m groups of consecutive pieces of a trajectory.

    Group i has the pieces from index ``ends[i]`` up to, but without, ``ends[i + 1]``. Its rate is the greatest one of
    its pieces for a criterion that is a maximum, else their mean over time.
    """
    rate, lasts = found.rate[:, column], found.pieces.durations
    if found.criteria[column].aggregate == "max":
        return np.asarray(np.maximum.reduceat(rate, ends[:-1]))
    total, time = np.add.reduceat(rate * lasts, ends[:-1]), np.add.reduceat(lasts, ends[:-1])
    return np.asarray(np.divide(total, time, out=np.zeros_like(total), where=time > 0))


def _quantised_values(found: Trace, column: int, ends: IntArray) -> tuple[float, FloatArray]:
    """Round a criterion's values in merged pieces to multiples of a step; return the step and the multiples (m,).

    The merged pieces lie between the indices ``ends`` (m+1,) of the trace's times. Sums, and criteria of the whole
    trajectory, are given as their growth in each merged piece; means and maxima as their value there.
    """
    if found.criteria[column].aggregate not in ADDS:
        reached = np.concatenate([[0.0], found.running[:, column]])[ends]
        step = _step(reached)
        return step, np.diff(np.rint(reached / step))
    joined = merged_rates(found, column, ends)
    step = _step(joined)
    return step, np.rint(joined / step)


def words(criterion: Criterion) -> str:
    """Return the label of a criterion's rate: cost per second, or the value at the time.

    >>> from hpop.criteria import Clearance, Length, Turns
    >>> words(Length()), words(Turns()), words(Clearance())
    ('m a second', 'count a second', 'shortfall, m at the time')
    """
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    unit = label("", criterion.unit, counts, criterion.quantity).strip(" ()")
    return f"{unit} at the time" if criterion.aggregate in ("time-mean", "max") else f"{unit} a second"


def _step(values: FloatArray) -> float:
    """Return the step size for rounding values (N,), such that the largest of them is `STEPS` steps."""
    largest = float(np.abs(values).max(initial=0.0))
    return largest / STEPS if largest > 0.0 else 1.0
