"""Convert the paths that a search found to a planner's candidates: trajectories, costs, certificate and provenance.

Text about what a search guarantees is called a claim; it becomes part of the certificate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import index_of_role
from hpop.planners.base import Candidates, Deferred
from hpop.runtime.limits import Status
from hpop.search import ParetoPaths

if TYPE_CHECKING:
    from hpop.planners.graphs.query import Query
    from hpop.search.timed.graph import TimedPaths
    from hpop.trajectories.trajectory import Trajectory

COARSE = 0.01  # share of a cost's largest value on a front: if rounding may change a cost by more, a note warns of it

ROUNDED = "edge costs rounded to their quanta"
OFF = "paths off this graph may be better"
SHARE = "this stage's share of the time"


@dataclass(frozen=True, eq=False)
class Plans:
    """The n paths of a search as trajectories with costs, for searches with and without time steps.

    planned       (n, k)  costs as the search added them up, in the units of the criteria
    tolerance     (n, k)  largest allowed differences between re-evaluated and planned costs
    trajectories  function that builds the trajectories with the given indices (r,)
    provenance    n dicts, one per path: how it was planned
    claim         text to append to the claim of the search
    notes, stats  notes for the user and statistics, to add to those of the candidates
    """

    planned: FloatArray
    tolerance: FloatArray
    trajectories: Callable[[IntArray], tuple[Trajectory, ...]]
    provenance: tuple[dict[str, Any], ...]
    claim: str = ""
    notes: tuple[str, ...] = ()
    stats: Mapping[str, Any] = field(default_factory=dict)


def assemble(
    name: str,
    query: Query,
    paths: ParetoPaths | TimedPaths,
    claim: str,
    *,
    provenance: Sequence[Mapping[str, Any]] | None = None,
    notes: Sequence[str] = (),
    stats: Mapping[str, Any] | None = None,
    reason: str = "",
) -> Candidates:
    """Return the paths that a search found for a query as the candidates of the planner ``name``.

    Parameters
    ----------
    claim : what the search guarantees for these paths, as text
    provenance : additional provenance entries for each path, beside the options of the graph
    notes, stats : additional notes for the user, and statistics
    reason : why there is no path, as text, if the caller knows; otherwise the query finds the reason
    """
    objectives, space = query.objectives, query.space
    plans = query.plans(paths, {"planner": name, **space.options}, provenance)
    blocked = (reason or query.what_blocks(paths),) if paths.status is Status.NO_PATH else ()
    count = len(plans.planned)
    return Candidates(
        objectives=objectives.optimised,
        trajectories=Deferred(count, plans.trajectories) if count else (),
        planned=plans.planned,
        tolerance=plans.tolerance,
        status=paths.status,
        certificate=f"{name}: {claim}{plans.claim}{objectives.certificate}",
        provenance=plans.provenance,
        notes=(*objectives.notes, *query.notes, *plans.notes, *blocked, *notes),
        filters=objectives.filters,
        stats={
            "planner": name,
            "states": space.size,
            "edges": query.graph.arcs,
            "build_seconds": query.build_seconds,
            **(stats or {}),
            **plans.stats,
            "bounds_seconds": paths.stats.seconds_bounds,
            "search_seconds": paths.stats.seconds_search,
        },
    )


def static_plans(
    query: Query, paths: ParetoPaths, common: Mapping[str, Any], own: Sequence[Mapping[str, Any]] | None
) -> Plans:
    """Convert the paths of a search without moving people to trajectories with costs, tolerances and provenance.

    The provenance of each path consists of the entries of ``common``, its number of edges, and its item in ``own``, if
    given.
    """
    space, edges = query.space, paths.lengths

    def trajectories(rows: IntArray) -> tuple[Trajectory, ...]:
        return space.trajectories_through(*paths.through(rows))

    # A sum has one rounding error for each edge, a maximum only one.
    adds_up = np.array([criterion.aggregate != "max" for criterion in query.objectives.optimised])
    rounds = np.where(adds_up, np.maximum(edges, 1)[:, None], 1)
    planned, tolerance = paths.costs * query.quanta, rounds * query.quanta
    missed = index_of_role("stops_missed", query.objectives.optimised)
    if missed is not None:  # a trajectory may pass a stop that its path skips
        tolerance[:, missed] += planned[:, missed]
    counts: dict[str, int] = {}
    if not space.is_checked:
        counts = {"edges_checked": paths.stats.arcs_checked, "edges_blocked": paths.stats.arcs_blocked}
        counts |= {"rounds": paths.stats.rounds}
    return Plans(
        planned=planned,
        tolerance=tolerance,
        trajectories=trajectories,
        provenance=_path_provenance(common, edges.tolist(), own),
        notes=tuple(_rounding_notes(query, paths, rounds)),
        stats=counts,
    )


def _path_provenance(
    common: Mapping[str, Any], edges: Sequence[int], own: Sequence[Mapping[str, Any]] | None
) -> tuple[dict[str, Any], ...]:
    """Return the provenance dict of each path: ``common`` entries, its number of ``edges``, and its item in ``own``.

    If ``own`` is None, paths with equal provenance share one dict.
    """
    if own is not None:
        return tuple({**common, "edges": count, **each} for count, each in zip(edges, own, strict=True))
    alike = {count: {**common, "edges": count} for count in set(edges)}
    return tuple(alike[count] for count in edges)


def _rounding_notes(query: Query, paths: ParetoPaths, rounds: IntArray) -> list[str]:
    """Return a warning for each cost whose rounding error on a path may exceed a hundredth of its largest value.

    The largest value is that of the paths found. Costs with the quantum 1, such as counts, get no warning.

    rounds  (n, k)  how often each cost is rounded along each path
    """
    if not len(paths):
        return []
    error = rounds.max(axis=0) * query.quanta
    size = np.maximum(np.ptp(paths.costs, axis=0), paths.costs.max(axis=0)) * query.quanta
    return [
        f"{criterion.name} of each edge is rounded to {criterion.quantum:g} {criterion.unit}, so that a path may be "
        f"off by {off:.3g}: that is coarse for this front; declare a smaller quantum"
        for criterion, off, whole in zip(query.objectives.optimised, error, size, strict=True)
        if off > COARSE * whole > 0.0 and criterion.quantum != 1.0
    ]


def search_stats(paths: ParetoPaths | TimedPaths, gap: float) -> dict[str, Any]:
    """Return the statistics of a search by name: method, numbers of labels (partial paths), memory and gap.

    gap  upper bound on how much better missing points may be, relative (0.1 for 10 %); None in the statistics if it is
         infinite
    """
    stats = paths.stats
    return {
        "method": stats.method,
        "labels_generated": stats.labels_generated,
        "labels_expanded": stats.labels_expanded,
        "labels_open": stats.labels_open,
        "peak_memory": stats.peak_memory,
        "gap": gap if math.isfinite(gap) else None,
    }


def checked_edges_text(query: Query, paths: ParetoPaths | TimedPaths) -> str:
    """Return text for a claim: how many edges the search checked for collisions; "" if all were checked before."""
    if query.space.is_checked:
        return ""
    stats = paths.stats
    return (
        f"; {stats.arcs_checked:,} of {query.graph.arcs:,} edges were checked in {stats.rounds} "
        f"round{'s' if stats.rounds != 1 else ''}, "
        f"{stats.arcs_blocked:,} of them blocked; edges on no front were not checked"
    )


# Claims


class SearchOutcome(Protocol):
    """Result of any search: its status, its number of paths, and its gap.

    The gap is an upper bound, relative (0.1 for 10 %), on how much better paths may be that are missing.
    """

    @property
    def status(self) -> Status: ...

    @property
    def gap(self) -> float: ...

    def __len__(self) -> int: ...


def search_claim(
    paths: SearchOutcome,
    where: str,
    rounded: str = ROUNDED,
    *,
    eps: float = 0.0,
    tolerance: Mapping[str, float] | None = None,
    optimal: str = "every point is optimal",
    gap: float | None = None,
    stage: bool = False,
) -> str:
    """Return, as text for a certificate, what an exact search guarantees for its paths.

    The text depends on whether the search ended early, and on the errors that were allowed: ``eps``, relative, and
    ``tolerance``, absolute, by name of a cost.

    Parameters
    ----------
    where : graph and criteria, as text
    rounded : how costs were rounded, as text
    optimal : what holds for each returned path if the search ended early, as text
    gap : bound on how much better missing paths may be, if it is smaller than the gap of ``paths``
    stage : whether a later stage follows; a time limit is then described as this stage's share of the time
    """
    factor = precision_text(eps, tolerance or {})
    if not paths.status.is_final:
        each = f"points are within {factor} of optimal" if factor else optimal
        each = each if len(paths) else "the search itself found none"
        ended = SHARE if stage and paths.status is Status.TIME_LIMIT else paths.status
        missing = gap_text(paths.gap if gap is None else gap, tolerance or {})
        return f"incomplete ({ended}): {each} on {where}, others are missing{missing}"
    if factor:
        covered = f"every optimal cost vector on {where} is covered within {factor}"
        return f"{covered}; {OFF}, points need not be optimal themselves; {rounded}"
    return f"exact on {where}; {OFF}; {rounded}"


def claim_with_known_paths(paths: SearchOutcome, where: str, rounded: str = ROUNDED) -> str:
    """Return, as text for a certificate, what a search guarantees that began with paths known from before.

    where, rounded  graph and criteria, and how costs were rounded, as text
    """
    if paths.status.is_final:
        return f"exact on {where}; {OFF}; {rounded}"
    return (
        f"incomplete ({paths.status}): known paths and paths found on {where}, points need not be optimal, others "
        f"are missing{gap_text(paths.gap, {})}"
    )


def precision_text(eps: float, tolerance: Mapping[str, float]) -> str:
    """Return the allowed errors of a search as text, such as "a factor 1.01 and 2 in turns"; "" for an exact search."""
    return " and ".join(([f"a factor {1 + eps:g}"] if eps else []) + _tolerance_texts(tolerance))


def gap_text(gap: float, tolerance: Mapping[str, float]) -> str:
    """Return text for a claim: how much better than the returned points a missing point may be at most.

    >>> gap_text(0.1, {"turns": 2.0})
    '; for each of them, a point here is at most 10 % worse in every cost, besides 2 in turns'
    """
    if not math.isfinite(gap):
        return "; how much better they may be is not known"
    worse = f"; for each of them, a point here is at most {_percent(gap)} % worse in every cost"
    amounts = " and ".join(_tolerance_texts(tolerance))
    return f"{worse}, besides {amounts}" if amounts else worse


def _tolerance_texts(tolerance: Mapping[str, float]) -> list[str]:
    return [f"{value:g} in {name}" for name, value in tolerance.items() if value]


def _percent(gap: float) -> str:
    """Return a share as text in percent, rounded up to two significant digits.

    >>> _percent(0.1), _percent(0.1201), _percent(1.0), _percent(12.31), _percent(0.0), _percent(0.00012)
    ('10', '13', '100', '1,300', '0', '0.012')
    """
    if gap == 0.0:
        return "0"
    digit = 10.0 ** (math.floor(math.log10(100 * gap)) - 1)
    percent = math.ceil(100 * gap / digit - 1e-6) * digit
    return f"{percent:,.0f}" if percent >= 10 else f"{percent:.2g}"


def memory_limit_notes(paths: ParetoPaths | TimedPaths) -> list[str]:
    """Return a note with advice if a search stopped at its memory limit; otherwise []."""
    if paths.status is not Status.MEMORY_LIMIT:
        return []
    made, waiting = paths.stats.labels_generated, paths.stats.labels_open
    return [
        f"memory limit: {made:,} labels (partial paths) were generated, {waiting:,} of them still open; raise "
        "max_memory, or give eps, a larger step or fewer criteria"
    ]
