"""Update a cached lattice after the world changed: only states, arcs and costs near the change are computed again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, copied, marked
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import lacking
from hpop.planners.graphs.arcs import MOVE, Arcs
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.objectives import motion_quanta
from hpop.search import Graph, machinery
from hpop.world import World
from hpop.world.geometry.cells import changed_boxes
from hpop.world.occupancy import take_over

Ids = NDArray[np.int32]
TURNED = 1.1  # factor on the robot's radius, as turns are checked by slightly larger hulls
SLACK = 1e-3  # m: safety margin of distances
TRIED = 512  # number of arcs on which the attributes of the world that a criterion reads are recorded
SMOOTHED = 3.0  # field cells: a changed sample affects the field up to two cells along each axis, less than this away
RIGID = 1e-9  # m: if its distance from the base's axis varies by less, the camera does not move in the base


def update(before: StateLattice, after: World, criteria: Sequence[Criterion]) -> StateLattice:
    """Return the lattice in a changed world, and fill the cache of that world with what is still valid.

    before    lattice in the world before the change
    after     the changed world
    criteria  criteria whose costs are updated

    States and arcs near the change are checked for collisions again, and the costs of these arcs are computed again. If
    a criterion reads a changed attribute of the world, its costs are computed again for all arcs that the change may
    affect. All other values are copied, so the result equals a lattice built anew. Nothing is copied if nothing was
    cached, or if the extent of the map has changed.
    """
    lattice = replace(before, world=after)
    cached = {name: before.cached_part(name) for name in ("clear", "free", "arcs")}
    if before.key is None or cached["arcs"] is None or before.world.bounds != after.bounds:
        return lattice
    take_over(before.world, after)
    within = TURNED * max(part.reach for part in before.model.platform) + _longest_step(before) + SLACK
    kept = _near_changes(before, lattice, within + _longest_step(before) + SLACK)
    part, near = replace(lattice, kept=kept), _near_changes(before, lattice, within, among=kept)
    lattice.cache_part("clear", _as_read_only(np.where(near, part.clear, before.clear)))
    if cached["free"] is not None:
        lattice.cache_part("free", _as_read_only(np.where(near[:, :, None], part.free, before.free)))
    arcs, origin = _arcs_after_change(before, part, lattice, near)
    lattice.cache_part("arcs", arcs)
    is_new = origin < 0
    lattice.cache_part("rechecked", int(is_new.sum()))
    changed = is_new.copy()  # arcs that are new, or have new costs
    for criterion in criteria:
        name = lattice.cache_name(criterion)
        counts = None if name is None else before.cached_part(name)
        affected = None if counts is None else _affected_arcs(criterion, before, lattice)
        if counts is not None and affected is not None:
            changed |= affected
            column = counts.take(origin, mode="clip")  # new arcs get a wrong cost here, which is replaced below
            for rows, motions in lattice.motions_of(np.flatnonzero(is_new | affected)):
                costs = motion_quanta(motions, [criterion])[:, 0]
                needed = np.min_scalar_type(int(costs.max(initial=0)))
                column = column.astype(np.promote_types(column.dtype, needed), copy=False)
                column[rows] = costs
            lattice.cache_part(name, _as_read_only(column))
    _take_over_graph(before, lattice, criteria, near, changed)
    return lattice


def _take_over_graph(
    before: StateLattice, lattice: StateLattice, criteria: Sequence[Criterion], near: BoolArray, changed: BoolArray
) -> None:
    """Cache the search graph of the changed lattice, reusing what was precomputed for unchanged positions.

    For each position, a search precomputes groups of turns. Nothing is done if the old search graph is not cached.

    before   lattice before the change
    near     (rows, columns)  mask of the positions near the change
    changed  (m,)  mask of the arcs that are new, or have new costs
    """
    names = tuple(before.cache_name(criterion) for criterion in criteria)
    graph: Graph | None = None if None in names else before.cached_part(("graph", names))
    if graph is None or not lattice.costed(criteria):
        return
    count = np.append(0, np.cumsum(changed))
    is_same = ~near[lattice.cells] & (np.diff(count[lattice.arcs.start[:: lattice.width]]) == 0)
    place = np.where(is_same, before.number[lattice.cells], -1)[:, None]
    nodes = np.where(place < 0, -1, place * lattice.width + np.arange(lattice.width))
    machinery.changed_turns.take_over_groups(graph, lattice.graph(criteria), nodes.ravel())


def _longest_step(lattice: StateLattice) -> float:
    """Return the length, m, of the longest step along any heading."""
    return lattice.step * max(math.hypot(*step) for step in lattice.headings.steps)


def _near_changes(
    before: StateLattice, after: StateLattice, within: float, among: BoolArray | None = None
) -> BoolArray:
    """Return the positions near which collisions may differ between two worlds, as a mask (rows, columns).

    before, after  the lattice in the two worlds
    within         m  distance from a position within which differences count
    among          (rows, columns)  mask of the positions to test; None for all
    """
    near = np.ones(before.shape, dtype=np.bool_) if among is None else among.copy()
    rows, columns = marked(near)
    near[rows, columns] = after.collision.differs(before.collision, *before.position(rows, columns), within)
    return near


def _arcs_after_change(
    before: StateLattice, part: StateLattice, lattice: StateLattice, near: BoolArray
) -> tuple[Arcs, IntArray]:
    """Return the arcs of the lattice in the changed world, and the old index (m,) of each arc, -1 for a new one.

    Near the change, arcs are checked again; elsewhere the old arcs are used.

    before   lattice before the change
    part     part of the lattice near the change, in the changed world
    lattice  whole lattice in the changed world
    near     (rows, columns)  mask of the positions near the change
    """
    from hpop.planners.graphs.lattice.loops import splice  # numba: on first use

    is_new, width = near[lattice.cells], lattice.width
    place = np.where(is_new, part.number[lattice.cells], before.number[lattice.cells])  # number in `part` or `before`
    degrees = np.empty((place.size, width), np.int64)
    first = np.empty(place.size, np.int64)
    for source, rows in ((before, ~is_new), (part, is_new)):
        degrees[rows] = np.diff(source.arcs.start).reshape(-1, width)[place[rows]]
        first[rows] = source.arcs.start[place[rows] * width]
    start = np.append(0, np.cumsum(degrees.ravel()))
    size = int(start[-1])
    heads, kinds, origin = np.empty(size, np.int32), np.empty(size, np.uint8), np.empty(size, np.int64)
    sources = [column for of in (before, part) for column in (of.arcs.heads, of.arcs.kinds, _new_ids(of, lattice))]
    splice(first, degrees.sum(axis=1), is_new, *sources, heads, kinds, origin)
    return Arcs(start, heads, kinds).frozen(), origin


def _new_ids(of: StateLattice, lattice: StateLattice) -> Ids:
    """Return the number in ``lattice`` (n,) of each state of another lattice ``of`` on the same grid.

    The number is negative if ``lattice`` does not have the state.
    """
    number = lattice.number[of.cells].astype(np.int32)
    ids = number[:, None] * lattice.width + np.arange(lattice.width, dtype=np.int32)
    return ids.ravel().astype(np.int32, copy=False)


def _as_read_only(array: Any) -> Any:
    array.setflags(write=False)
    return array


# Find out which attributes of a world a criterion reads: its costs are still valid if none of these has changed


class _WatchedWorld(World):
    """World that records which of its attributes are read, and for which radii :meth:`World.obstruction` is called.

    All values are those of another world, ``watched``.
    """

    def __getattribute__(self, name: str) -> Any:
        """Record the name of the attribute, and return its value in the watched world."""
        own = object.__getattribute__(self, "__dict__")
        if name.startswith("__") or "watched" not in own:
            return object.__getattribute__(self, name)
        own["reads"].add(name)
        value = getattr(own["watched"], name)
        return _recording(value, own["radii"]) if name == "obstruction" else value


def _recording(obstruction: Callable[..., Any], radii: set[float]) -> Callable[..., Any]:
    def recorded(pose: Any, radius: float) -> Any:
        radii.add(float(radius))
        return obstruction(pose, radius)

    return recorded


def _affected_arcs(criterion: Criterion, before: StateLattice, lattice: StateLattice) -> BoolArray | None:
    """Return which arcs (m,) may have other costs by a criterion after the change; None if all arcs may.

    Costs can differ only if the criterion reads an attribute of the world that has changed. For criteria of hpop, a
    sample of arcs shows which attributes it reads. A user's criterion may read others on other arcs, so all of its
    costs may be affected.
    """
    world, after = before.world, lattice.world
    if not type(criterion).__module__.startswith("hpop.") or lacking(criterion.requires, lattice.model, after):
        return None
    name = ("reads", lattice.cache_name(criterion))
    read = before.cached_part(name) if _same_content(world, after) else None
    if read is None:
        read = _attributes_read(criterion, lattice)
    if read is None:
        return None
    lattice.cache_part(name, read)
    reads, radii = set(read[0]), read[1]
    if world.ground is after.ground:
        reads -= {"obstruction", "obstruction_field"}
    if any(getattr(world, name) != getattr(after, name) for name in reads - {"obstruction"}):
        return None
    if "obstruction" not in reads:
        return np.zeros(lattice.arcs.heads.size, dtype=np.bool_)
    return _seeing_change(lattice, world, max(radii))


def _same_content(before: World, after: World) -> bool:
    """Return whether two worlds share one content object, or both have no people, objects and zones."""
    contents = [world.content for world in (before, after)]
    return contents[0] is contents[1] or not any(content.present or content.zones for content in contents)


def _attributes_read(criterion: Criterion, lattice: StateLattice) -> tuple[frozenset[str], frozenset[float]] | None:
    """Evaluate a criterion on a sample of arcs and return which attributes of the world it reads.

    Also returns the radii, m, with which it calls :meth:`World.obstruction`. None if the evaluation fails.
    """
    reads, radii = set[str](), set[float]()
    watched = copied(lattice.world.stand_in(_WatchedWorld), watched=lattice.world, reads=reads, radii=radii)
    size = lattice.arcs.heads.size
    tried = np.unique(np.linspace(0, size - 1, min(size, TRIED)).astype(np.int64))
    try:
        for _, motions in lattice.motions_of(tried):
            motion_costs(criterion, replace(motions, world=watched))
    except Exception:  # a plugin's criterion may use the world in a way that the stand-in does not support
        return None
    return frozenset(reads - {"contents", "field"}), frozenset(radii)  # a field is one of the fields, read too


def _seeing_change(lattice: StateLattice, before: World, radius: float) -> BoolArray | None:
    """Return on which arcs (m,) the obstruction around the camera may have changed; None if on all arcs.

    radius  m  of the ball around the camera; the obstruction is the fraction of it that is inside obstacles
    """
    rasters, aside = (before.raster, lattice.world.raster), _camera_aside(lattice)
    if None in rasters or aside is None or before.obstacles or lattice.world.obstacles:
        return None
    boxes = changed_boxes(*rasters)  # type: ignore[arg-type]  # none is None
    if boxes is None or before.outside_is_obstacle != lattice.world.outside_is_obstacle:
        return None
    cell = max(raster.resolution for raster in rasters if raster is not None)
    within = radius + SMOOTHED * cell + aside + SLACK
    x, y = lattice.position(*lattice.cells)
    away = np.full(x.size, np.inf)
    for x0, y0, x1, y1 in boxes:
        across, up = np.maximum(np.maximum(x0 - x, x - x1), 0), np.maximum(np.maximum(y0 - y, y - y1), 0)
        away = np.minimum(away, np.hypot(across, up))
    degrees = np.diff(lattice.arcs.start).reshape(-1, lattice.width).sum(axis=1)
    near, farther = (np.repeat(away <= reach, degrees) for reach in (within, within + _longest_step(lattice)))
    affected: BoolArray = near | (farther & (lattice.arcs.kinds == MOVE))
    return affected


def _camera_aside(lattice: StateLattice) -> float | None:
    """Return the distance, m, of the camera from the base's vertical axis; None if it varies."""
    states = lattice.stations.states
    camera, base = (lattice.model.pose(body, states) for body in ("camera", "base"))
    aside = np.hypot(camera.x - base.x, camera.y - base.y)
    return float(aside.max()) if np.ptp(aside) <= RIGID else None
