"""Explanations: why no path of a front passes somewhere, or has less of a cost, with the numbers that decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.registry import planners
from hpop.base.text import some
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError
from hpop.planners.base import PlannerSpec, edge_objectives, make_planner
from hpop.planners.graphs.passing import Passage, passing_query, timed_passing_query
from hpop.planners.judgement import trusted
from hpop.planners.needs import people_move
from hpop.planners.spending import Exhausted, Limits, Spending
from hpop.problems.conditions import CostLimit, passage_of, spoken
from hpop.problems.front import Front, Point
from hpop.problems.named_rows import named_rows
from hpop.problems.problem import Problem
from hpop.problems.solving import front as front_of
from hpop.runtime.limits import Status

if TYPE_CHECKING:
    from hpop.planners.base import Planner
    from hpop.planners.graphs.family import GraphFamily
    from hpop.planners.objectives import Objectives

OF_TIME = ("clock", "hold", "arrive_by", "margin")  # planner options of time, in the provenance of a plan
SAME = 1e-3  # share of a cost up to which rounding may hide a difference
NONE = -1
PAIRS = 10**6  # pairs of a path and a row that are compared at once
WHOLE = 1e-6  # quanta by which a cost may differ from a whole number of them through errors of floating point
OTHERS = "paths that were not searched may be better"


@dataclass(frozen=True, eq=False)
class WhyNot:
    """Answer to the question why a front does not pass somewhere, or has no path with less of a cost.

    sentence  the answer in words
    best      the best path that satisfies the condition, a point of ``front``; None if there is none
    row       row of the given front with which it is compared; None without a path
    numbers   costs of the best path less those of the row, by criterion, both evaluated again
    exact     whether ``front`` has all optimal paths that satisfy the condition, on the searched graph
    through   the passage in words: "left of the statue"; "" without one
    front     front of the paths that satisfy the condition
    rows      rows of the given front whose costs a path of ``front`` has, too
    """

    sentence: str
    best: Point | None
    row: int | None
    numbers: dict[str, float]
    exact: bool
    through: str
    front: Front
    rows: tuple[int, ...] = ()

    def __str__(self) -> str:
        return self.sentence


@checked_arguments
def why_not(
    problem: Problem,
    front: Front,
    region: Any = None,
    *,
    through: str | None = None,
    wish: str | Mapping[str, float] | None = None,
    than: int | str | None = None,
    planner: PlannerSpec | None = None,
) -> WhyNot:
    """Explain why no path of a front passes somewhere, or has less of a cost: compare it with the best path that does.

    Paths that pass are searched on the graph of the front's planner, with the passage as a constraint. If this cannot
    be done, only rows of the front are compared, and ``exact`` of the answer is False.

    Parameters
    ----------
    region : name of a zone, position (x, y), corners of a polygon, two positions (a line), or a shape of shapely, m
    through : passage in words: "left of the statue", "between the statue and the bench"
    wish : "fewer turns", "less exposure", "hurry" (less duration), or upper bounds of costs by name, ``{"turns": 3}``
    than : row with which the best path is compared, by number or name. Default: a row that is at least as good in
        every cost, the one with the least difference; the knee if there is none, and for a wish in words
    planner : planner that searches, whose graph may be built already. Default: the planner of the front

    Raises QueryError for a place that cannot be used, UnknownName for an unknown cost, OptionError for other arguments.
    """
    if (region is None) + (through is None) == 0:
        raise OptionError("give region or through, not both: each says where a path shall pass")
    if region is None and through is None and wish is None:
        raise OptionError("give region, through or wish: where a path shall pass, or which cost shall be less")
    if not len(front):
        raise OptionError(f"the front has no path to compare with: {front.certificate:.400}")
    row = None if than is None else named_rows(front, [than])[0].number
    passage = None if region is through is None else passage_of(problem, through if region is None else region)
    limit = None if wish is None else CostLimit.of(wish, front, front.knee().index if row is None else row)
    if limit is not None and row is None and limit.reference is not None:
        row = limit.reference
    if passage is None:
        found = _Found(front, front.status == Status.COMPLETE and ": exact on " in front.certificate)
    else:
        found = _passing(problem, front, passage, planner)
    if limit is not None:
        found = found._replace(front=found.front[limit.met(found.front)])
    return _Comparison(problem, front, found, passage, limit).answer(row)


class _Found(NamedTuple):
    """Paths that satisfy a condition.

    front   their front
    exact   whether the front has all such paths that are optimal on the searched graph
    reason  why there is no path, "" if there is one
    off     largest difference between evaluated costs and those of the search, by name; 0 for names that are missing
    """

    front: Front
    exact: bool
    reason: str = ""
    off: Mapping[str, float] = MappingProxyType({})


def _passing(problem: Problem, front: Front, passage: Passage, spec: PlannerSpec | None) -> _Found:
    """Search the paths that pass, and return the optimal ones; if this cannot be done, the front's rows that pass."""
    if spec is None:
        several = (planner_of_point(origin) for origin in front.provenance)
        planner = next((planner for planner in several if planner is not None), None)
    else:
        planner = make_planner(spec)
    family = None if planner is None else planner.graph_of_drives
    if planner is not None and family is not None and (family.has_clock(problem) or not people_move(problem)):
        objectives = edge_objectives(problem.criteria, planner.name)
        is_toured = people_move(problem) and problem.tour is not None
        names = {criterion.name for criterion in (*objectives.optimised, *objectives.filters)}
        if names == set(front.names) and not is_toured:
            return _searched(problem, passage, planner, family, objectives)
    words = f"rows of the front that pass {passage.words}; {OTHERS}"
    return _Found(replace(front[passage.holds(front.trajectories)], certificate=words), exact=False)


def planner_of_point(origin: Mapping[str, Any]) -> Planner | None:
    """Return the planner that found a point, given the point's provenance, with its options for graph and time.

    None for a planner without a graph that can be built again.
    """
    name = origin.get("planner")
    options: tuple[str, ...] = planners[name].graph_options if isinstance(name, str) and name in planners else ()
    chosen = {option: origin[option] for option in (*options, *OF_TIME) if option in origin}
    return make_planner({cast(str, name): chosen}) if options else None


def _searched(
    problem: Problem, passage: Passage, planner: Planner, family: GraphFamily, objectives: Objectives
) -> _Found:
    """Search the optimal paths that pass on a planner's graph, which its family builds, and return them."""
    kept = problem.keeping(planner.margin)
    spending = Spending(Limits.of(planner.budget()))
    try:
        if people_move(problem):
            *_, built = family.toured_graphs(kept, objectives, spending)
            query = timed_passing_query(built, passage, objectives, problem, planner.time_options)
        else:
            query = passing_query(family.query(kept, objectives, spending), passage)
        candidates = query.exact(planner.name, spending.left())
    except Exhausted as stop:
        raise OptionError(f"the planner's limit ended before the search: {stop}; give more time or memory") from None
    if family.is_judged and len(candidates.trajectories):
        candidates = trusted(candidates, kept, planner.name)
    found, reason = front_of(problem, candidates), ""
    if candidates.status is Status.NO_PATH:
        space, timing = query.space, query.timing
        reason = space.what_separates(query.start, query.goals) if timing is None else timing.what_blocks(query)
    if not passage.holds(found.trajectories).all():
        found = replace(found, certificate=f"NOT VALID: a path does not pass, please report ({found.certificate})")
    names = [criterion.name for criterion in candidates.objectives]
    off = dict(zip(names, candidates.tolerance.max(axis=0, initial=0.0).tolist(), strict=True))
    return _Found(found, candidates.status.is_final, reason, off)


@dataclass(frozen=True, eq=False)
class _Matches:
    """For each of some paths (a,), rows of a front that are at least as good; NONE if there is none.

    equal   (a,)  first row with the costs of the path
    better  (a,)  row that is as good as the path in each cost and better in one, with the least loss
    loss    (a,)  loss of the path against that row: the sum of its weighted costs beyond those of the row
    rows    (n,)  mask of the rows whose costs a path has
    """

    equal: IntArray
    better: IntArray
    loss: FloatArray
    rows: BoolArray

    @classmethod
    def of(
        cls, costs: FloatArray, base: FloatArray, off: FloatArray, same: FloatArray, weights: FloatArray
    ) -> _Matches:
        """Compare the costs (a, k) of paths with those (n, k) of a front, in blocks that limit the memory.

        off   (k,)  a cost that is less than the row's by at most this counts as no less: it may be rounding
        same  (k,)  a cost that differs from the row's by at most this counts as equal
        weights  (k,)  of the costs in the loss
        """
        equal, better = np.full(len(costs), NONE), np.full(len(costs), NONE)
        loss, rows = np.zeros(len(costs)), np.zeros(len(base), np.bool_)
        block = max(1, PAIRS // len(base))
        for begin in range(0, len(costs), block):
            part = slice(begin, begin + block)
            more = costs[part, None] - base[None]
            alike = np.all(np.abs(more) <= same, axis=2)
            worse = np.all(more >= -off, axis=2) & ~alike  # the row is better, up to rounding
            losses = np.where(worse, np.maximum(weights * more, 0.0).sum(axis=2), np.inf)
            equal[part] = np.where(alike.any(axis=1), alike.argmax(axis=1), NONE)
            better[part] = np.where(worse.any(axis=1), losses.argmin(axis=1), NONE)
            loss[part] = losses.min(axis=1)
            rows |= alike.any(axis=0)
        return cls(equal, better, loss, rows)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Comparison of a front with the paths that satisfy a condition.

    found    these paths
    passage  where they pass; None for a wish alone
    limit    bounds of their costs, or None
    """

    problem: Problem
    front: Front
    found: _Found
    passage: Passage | None
    limit: CostLimit | None

    @property
    def able(self) -> Front:
        """Front of the paths that satisfy the condition."""
        return self.found.front

    def answer(self, row: int | None) -> WhyNot:
        """Return the answer, compared with a row of the front; None to choose the row."""
        if not len(self.able):
            return self._answer(f"{self._none()}{self._doubt('another one may')}")
        costs, base, off = self._columns, self.front.costs, self._off
        same = np.minimum(off, SAME * np.abs(base).max(axis=0))
        spread = np.ptp(np.concatenate([costs, base]), axis=0)
        weights = np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > 0.0)
        found = _Matches.of(costs, base, off, same, weights)
        on, worse = found.equal != NONE, found.better != NONE
        against = self.front.knee().index if row is None else row
        share = weights * (costs - base[against])  # (a, k)
        loss = np.maximum(share, 0.0).sum(axis=1)
        if row is not None or not (on.any() or worse.any()):
            best, row = int(np.lexsort((share.sum(axis=1), loss))[0]), against
        elif on.any():
            best = int(np.argmin(np.where(on, loss, np.inf)))
            row = int(found.equal[best])
        else:
            best = int(np.argmin(np.where(worse, found.loss, np.inf)))
            row = int(found.better[best])
        rows = tuple(np.flatnonzero(found.rows).tolist())
        point, numbers, more = self.able[best], self._numbers(best, row), costs[best] - base[row]
        wished = np.isin(self.front.names, [] if self.limit is None else [*self.limit.bounds])
        order = np.lexsort((-np.abs(weights * more), ~wished))
        differing = [self.front.names[j] for j in order if abs(more[j]) > same[j]]
        if not differing:
            sentence = self._on_front(rows, row)
        else:
            better = int(found.better[best]) if worse[best] else None
            end = self._place(rows, row, better, never=bool((on | worse).all()))
            sentence = f"{self._subject} takes {self._amounts(differing, numbers)} than row {row}; {end}."
        return self._answer(sentence + self._doubt("other paths may be better"), point, row, numbers, rows)

    @property
    def _off(self) -> FloatArray:
        """Largest difference (k,) of two evaluated costs that may be due to the rounding of costs in the search.

        For a cost that is a whole number of quanta in all rows, such as turns, it is a quarter of a quantum.
        """
        front, every = self.front, np.concatenate([self._columns, self.front.costs])
        counts = every / front.quanta
        whole = (np.abs(counts - np.rint(counts)) <= WHOLE).all(axis=0)
        off = np.array([2.0 * self.found.off.get(name, 0.0) for name in front.names])
        return np.where(whole, 0.25 * front.quanta, np.maximum(off, front.quanta))

    def _numbers(self, best: int, row: int) -> dict[str, float]:
        """Return the costs of a path less those of a row of the front, by name, both evaluated again."""
        known = {c.name: c for each in self.problem.criteria for c in (each.integral or each, each)}
        both = [self.able.trajectories[best], self.front.trajectories[row]]
        mine, other = trajectory_costs([known[name] for name in self.front.names], both, self.problem.world)
        return dict(zip(self.front.names, (mine - other).tolist(), strict=True))

    def _on_front(self, rows: tuple[int, ...], row: int) -> str:
        """Return the sentence for a best path that has the costs of a row of the front."""
        if self.passage is None:
            return f"Row {row} is a path{self._subject.removeprefix('A path')}."
        return f"{self._subject} is on the front: {self._passing_rows(rows)}."

    def _passing_rows(self, rows: tuple[int, ...]) -> str:
        """Return a clause that names rows: "row 4 passes there", or "a path with the costs of row 4 passes there".

        For a wish alone, which names no place, it is only "row 4".

        rows  rows with the costs of a path that satisfies the condition
        """
        passage = self.passage
        passes = None if passage is None else passage.holds(self.front.trajectories)
        own = [i for i in rows if passes is None or passes[i]]
        listed = some([str(i) for i in own or rows])
        noun = "row" if len(own or rows) == 1 else "rows"
        if passage is None:
            return f"{noun} {listed}"
        if own:
            return f"{noun} {listed} {'passes' if len(own) == 1 else 'pass'} there"
        return f"a path with the costs of {noun} {listed} passes there"

    def _place(self, rows: tuple[int, ...], row: int, better: int | None, *, never: bool) -> str:
        """Return the end of the sentence, such as "it is never better": the front compared with the allowed paths.

        An allowed path satisfies the user's condition. The sentence describes the best one.

        rows    rows of the front with the same costs as an allowed path
        row     row with which the best allowed path is compared
        better  row that dominates the best allowed path (as good in each cost, better in one), or None
        never   whether, for each allowed path, some row is at least as good in each cost
        """
        if rows:
            return f"it is on the front: {self._passing_rows(rows)}"
        if not never:
            return "no row of the front is as good in each cost"
        other = "" if better is None or better == row else f": row {better} is as good in each cost, and better in one"
        return f"it is never better{other}"

    def _amounts(self, differing: Sequence[str], numbers: Mapping[str, float]) -> str:
        """Return the differences of the first two ``differing`` costs in words, and how many other costs differ."""
        first, *others = (self._amount(name, numbers[name]) for name in differing[:2])
        signs = [numbers[name] > 0.0 for name in differing[:2]]
        words = " ".join([first, *(f"{'and' if signs[0] == signs[-1] else 'but'} {other}" for other in others)])
        rest = len(differing) - 2
        return words if rest <= 0 else f"{words} (and {'another cost differs' if rest == 1 else f'{rest} other costs'})"

    def _answer(
        self,
        sentence: str,
        best: Point | None = None,
        row: int | None = None,
        numbers: dict[str, float] | None = None,
        rows: tuple[int, ...] = (),
    ) -> WhyNot:
        through = "" if self.passage is None else self.passage.words
        return WhyNot(sentence, best, row, numbers or {}, self.found.exact, through, self.able, rows)

    @property
    def _columns(self) -> FloatArray:
        """Costs (a, k) of the paths that satisfy the condition, in the order of the front's names."""
        return self.able.costs[:, [self.able.names.index(name) for name in self.front.names]]

    @property
    def _subject(self) -> str:
        """Subject of the sentence, such as "Passing left of the statue with fewer turns"."""
        limit = "" if self.limit is None else f" with {self.limit.words}"
        return f"A path{limit}" if self.passage is None else f"Passing {self.passage.words}{limit}"

    def _none(self) -> str:
        """Return the sentence that says that no path satisfies the condition, and why."""
        reference = None if self.limit is None else self.limit.reference
        limit = (
            "" if self.limit is None else f"{self.limit.words}{'' if reference is None else f' than row {reference}'}"
        )
        none = "No path" if self.found.exact else "No path that was found"
        if self.passage is None:
            return f"{none} has {limit}."
        reason = f": {self.found.reason}" if self.found.reason else ""
        return f"{none} passes {self.passage.words}{f' with {limit}' if limit else ''}{reason}."

    def _doubt(self, what: str) -> str:
        """Return " Not all paths were searched: ..." if the answer is not exact, else ""."""
        return "" if self.found.exact else f" Not all paths were searched: {what}."

    def _amount(self, name: str, number: float) -> str:
        """Return a difference of a cost in words, such as "2 turns more"."""
        value = f"{abs(number):.2g}" if abs(number) < 10 else f"{abs(number):.0f}"
        more, unit = "more" if number > 0 else "less", self.front.units[self.front.names.index(name)]
        if name == "turns":
            return f"{value} turn{'' if value == '1' else 's'} {more}"
        own = "" if name in ("length", "duration") else f" {spoken(name)}"
        return f"{value} {more}{own}" if unit == "1" else f"{value} {unit} {more}{own}"
