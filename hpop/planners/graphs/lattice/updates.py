"""A lattice in a world that has changed: free states, arcs and costs away from the change are taken from before."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hpop.base.arrays import BoolArray, IntArray, copied
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import lacking
from hpop.planners.graphs.arcs import Arcs
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.objectives import quantised
from hpop.world import World

TURNED = 1.1  # of a robot's reach: its turns are covered by hulls that are a little larger
SLACK = 1e-3  # m
TRIED = 64  # arcs whose costs show what a criterion reads of a world
OF_GROUND = frozenset({"obstruction", "obstruction_field"})  # methods of a world that ask its ground alone


def update(before: StateLattice, after: World, criteria: Sequence[Criterion]) -> StateLattice:
    """Return a lattice in a changed world, which then keeps all that the change leaves as it was.

    States and arcs are checked again where the change may reach them; costs are computed again for those arcs, and for
    all arcs by criteria that read of the world what changed. All other values are those of the world before, so the
    result equals a lattice that is built anew. Where nothing was kept, or the extent has changed, nothing is taken.
    """
    lattice = replace(before, world=after)
    known = {name: before.kept_part(name) for name in ("clear", "free", "arcs")}
    if before.key is None or known["arcs"] is None or before.world.bounds != after.bounds:
        return lattice
    within = TURNED * max(part.reach for part in before.model.platform) + _longest(before) + SLACK
    near = _near(before, lattice, within)
    part = replace(lattice, kept=_near(before, lattice, within + _longest(before) + SLACK))
    lattice.keep_part("clear", _frozen(np.where(near, part.clear, before.clear)))
    if known["free"] is not None:
        lattice.keep_part("free", _frozen(np.where(near[:, :, None], part.free, before.free)))
    arcs, taken = _joined(before, part, lattice, near)
    lattice.keep_part("arcs", arcs)
    lattice.keep_part("rechecked", int(arcs.heads.size - taken.size))
    away = ~near[lattice.cells][_tails(arcs) // lattice.width]
    for criterion in criteria:
        name = lattice.name_of(criterion)
        counts = None if name is None else before.kept_part(name)
        if counts is not None and not _reads_change(criterion, lattice, before.world):
            column = np.zeros(arcs.heads.size, np.int64)
            column[away] = counts[taken]
            for rows, motions in lattice.motions_of(np.flatnonzero(~away)):
                column[rows] = quantised(motion_costs(criterion, motions), criterion)
            lattice.keep_part(name, _frozen(column.astype(np.min_scalar_type(int(column.max(initial=0))))))
    return lattice


def _longest(lattice: StateLattice) -> float:
    """Return the length, m, of the longest step."""
    return lattice.step * max(math.hypot(*step) for step in lattice.headings.steps)


def _near(before: StateLattice, after: StateLattice, within: float) -> BoolArray:
    """Mark positions (rows, columns) where a robot may meet something else than before within a distance, m."""
    rows, columns = (index.ravel() for index in np.indices(before.shape))
    x, y = before.position(rows, columns)
    return after.collision.differs(before.collision, x, y, within).reshape(before.shape)


def _joined(before: StateLattice, part: StateLattice, lattice: StateLattice, near: BoolArray) -> tuple[Arcs, IntArray]:
    """Return arcs of positions near a change, by a part of the lattice, and all others, by their places before."""
    old = ~near[before.cells][_tails(before.arcs) // before.width]
    new = near[part.cells][_tails(part.arcs) // part.width]
    sources = [(before, np.flatnonzero(old)), (part, np.flatnonzero(new))]
    tails = np.concatenate([_renumbered(of, lattice, _tails(of.arcs)[places]) for of, places in sources])
    heads = np.concatenate([_renumbered(of, lattice, of.arcs.heads[places].astype(np.int64)) for of, places in sources])
    kinds = np.concatenate([of.arcs.kinds[places] for of, places in sources])
    order = np.argsort(tails, kind="stable")
    start = np.zeros(lattice.size + 1, np.int64)
    np.cumsum(np.bincount(tails, minlength=lattice.size), out=start[1:])
    return Arcs(start, heads[order].astype(np.int32), kinds[order]).frozen(), sources[0][1]


def _tails(arcs: Arcs) -> IntArray:
    return np.repeat(np.arange(arcs.start.size - 1), np.diff(arcs.start))


def _renumbered(of: StateLattice, lattice: StateLattice, ids: IntArray) -> IntArray:
    """Return the ids in a lattice of states (N,) of another one with the same grid."""
    place, station = np.divmod(ids, of.width)
    return np.asarray(lattice.number[of.cells][place] * lattice.width + station)


def _frozen(array: Any) -> Any:
    array.setflags(write=False)
    return array


# What a criterion reads of a world


class _WatchedWorld(World):
    """A stand-in for a world that notes which of its attributes are read."""

    def __getattribute__(self, name: str) -> Any:
        """Note the attribute and return that of the world itself."""
        own = object.__getattribute__(self, "__dict__")
        if name.startswith("__") or "watched" not in own:
            return object.__getattribute__(self, name)
        own["reads"].add(name)
        return getattr(own["watched"], name)


def _reads_change(criterion: Criterion, lattice: StateLattice, before: World) -> bool:
    """Return whether a criterion reads of a lattice's world anything that differs from the world before."""
    after, reads = lattice.world, set[str]()
    if lacking(criterion.requires, lattice.model, after):
        return True
    watched = copied(after.stand_in(_WatchedWorld), watched=after, reads=reads)
    size = lattice.arcs.heads.size
    tried = np.unique(np.linspace(0, size - 1, min(size, TRIED)).astype(np.int64))
    try:
        for _, motions in lattice.motions_of(tried):
            motion_costs(criterion, replace(motions, world=watched))
    except Exception:  # a criterion of a plugin may do with a world what a stand-in does not bear
        return True
    return any(_differs(name, before, after) for name in reads - {"contents"})


def _differs(name: str, before: World, after: World) -> bool:
    """Return whether an attribute of two worlds differs; of most methods it is not known, so they do."""
    if name in OF_GROUND:
        return before.ground is not after.ground
    return bool(getattr(before, name) != getattr(after, name))
