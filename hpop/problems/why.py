"""Explanations: why no path of a front passes somewhere, or has less of a cost, with the numbers that decide."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import real
from hpop.base.registry import planners
from hpop.base.text import shown, some
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, UnknownName, did_you_mean
from hpop.planners.base import PlannerSpec, edge_objectives, make_planner
from hpop.planners.graphs.passing import Passage, passing_query
from hpop.planners.judgement import trusted
from hpop.planners.needs import people_move
from hpop.planners.spending import Exhausted, Limits, Spending
from hpop.problems.front import Front, Point
from hpop.problems.named_rows import named_rows
from hpop.problems.places import passage_of
from hpop.problems.problem import Problem
from hpop.problems.solving import front as front_of
from hpop.runtime.status import Status

if TYPE_CHECKING:
    from hpop.planners.base import Planner
    from hpop.planners.graphs.family import GraphFamily

LESS = re.compile(r"(?:fewer|less)\s+(.+)", re.IGNORECASE)
HURRY = "hurry"
WHOLE = 1e-6  # quanta by which a cost may differ from a whole number of them through errors of floating point
OTHERS = "paths that were not searched may be better"


@dataclass(frozen=True, eq=False)
class WhyNot:
    """Answer to the question why a front does not pass somewhere, or has no path with less of a cost.

    sentence  the answer in words
    best      the best path that satisfies the condition, a point of ``front``; None if there is none
    row       row of the front with which it is compared; None without a path
    numbers   costs of the best path less those of the row, by criterion, both evaluated again
    exact     whether the paths that satisfy the condition are all that are optimal on the searched graph
    through   the passage in words: "left of the statue"; "" without one
    front     front of the paths that satisfy the condition
    rows      rows of the front whose costs such paths have
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
    """Explain why a front does not pass somewhere, or has no path with less of a cost: by the best path that does.

    A path that passes is searched on the graph of the front's planner, with the passage as a constraint. The result is
    exact if that planner is an exact search on a graph and no person moves.

    Parameters
    ----------
    region : name of a zone, position (x, y), corners of a polygon, two positions (a line), or a shape of shapely, m
    through : passage in words: "left of the statue", "between the statue and the bench"
    wish : "fewer turns", "less exposure", "hurry" (less duration), or upper bounds of costs by name, ``{"turns": 3}``
    than : row with which the best path is compared, by number or name. Default: the row that is at least as good in
        every cost, with the least difference; for a wish in words the knee
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
    limit = None if wish is None else _Limit.of(wish, front, front.knee().index if row is None else row)
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
    exact   whether all that are optimal on the searched graph are known
    reason  why there is no path, "" if there is one
    """

    front: Front
    exact: bool
    reason: str = ""


def _passing(problem: Problem, front: Front, passage: Passage, spec: PlannerSpec | None) -> _Found:
    """Return the front of the paths that pass; if they cannot be searched, the rows of the front that pass."""
    planner = _planner_of(front) if spec is None else make_planner(spec)
    family = None if planner is None else planner.graph_of_drives
    if planner is None or family is None or people_move(problem) or planner.max_detour is not None:
        passes = np.array([passage.holds(trajectory) for trajectory in front.trajectories])
        return _Found(
            replace(front[passes], certificate=f"rows of the front that pass {passage.words}; {OTHERS}"), False
        )
    found = _searched(problem, passage, planner, family)
    if set(found.front.names) != set(front.names):
        raise OptionError(
            f"the planner must minimise the costs of the front, {', '.join(front.names)}, got "
            f"{', '.join(found.front.names)}; give the planner that made the front"
        )
    return found


def _planner_of(front: Front) -> Planner | None:
    """Return the planner that found a front's first point, with the options of its graph; None without a graph."""
    for origin in front.provenance:
        name = origin.get("planner")
        options: tuple[str, ...] = planners[name].graph_options if isinstance(name, str) and name in planners else ()
        if options:
            return make_planner({cast(str, name): {o: origin[o] for o in options if o in origin}})
    return None


def _searched(problem: Problem, passage: Passage, planner: Planner, family: GraphFamily) -> _Found:
    """Return the front of the paths that pass, by an exact search on the graph of a family."""
    kept = problem.keeping(planner.margin)
    spending = Spending(Limits.of(planner.budget()))
    objectives = edge_objectives(problem.criteria, planner.name)
    try:
        query = passing_query(family.query(kept, objectives, spending), passage)
        candidates = query.exact(planner.name, spending.left())
    except Exhausted as stop:
        raise OptionError(f"the planner's limit ended before the search: {stop}; give more time or memory") from None
    if family.is_judged and len(candidates.trajectories):
        candidates = trusted(candidates, kept, planner.name)
    found = front_of(problem, candidates)
    if not all(map(passage.holds, found.trajectories)):
        found = replace(found, certificate=f"NOT VALID: a path does not pass, please report ({found.certificate})")
    reason = query.space.what_separates(query.start, query.goals) if candidates.status is Status.NO_PATH else ""
    return _Found(found, candidates.status.is_final, reason)


@dataclass(frozen=True)
class _Limit:
    """Upper bounds of costs that a wish sets.

    words      the wish, as the end of a sentence's subject: "with fewer turns"
    bounds     largest value of each cost by name; exclusive if there is a ``reference``
    reference  row of the front that has the bound's value, if the wish is in words
    """

    words: str
    bounds: dict[str, float]
    reference: int | None = None

    @classmethod
    def of(cls, wish: str | Mapping[str, float], front: Front, row: int) -> _Limit:
        """Return the bounds of a wish; words mean less of a cost than the given row of the front has."""
        if isinstance(wish, str):
            match = LESS.fullmatch(wish.strip())
            if match is None and wish.strip().lower() != HURRY:
                near = did_you_mean(wish, [HURRY, *(f"fewer {name}" for name in front.names)])
                raise OptionError(
                    f"a wish must be 'hurry', or 'fewer' or 'less' with a cost ({', '.join(front.names)}), or bounds "
                    f"of costs by name, got {shown(wish)}.{near}"
                )
            name = _cost("duration" if match is None else match.group(1), front)
            more = "fewer" if name == "turns" else "less"
            return cls(f"{more} {_spoken(name)}", {name: front[row].costs[name]}, row)
        bounds = {
            _cost(name, front): float(real(f"the wish for {name}", most, 0, np.inf)) for name, most in wish.items()
        }
        if not bounds:
            raise OptionError("a wish must bound a cost, such as {'turns': 3}, got none")
        parts = (f"at most {most:.4g} {_unit(name, front)}".rstrip() for name, most in bounds.items())
        return cls(" and ".join(parts), bounds)

    def met(self, front: Front) -> BoolArray:
        """Return which rows (n,) of a front meet the bounds."""
        met = np.ones(len(front), np.bool_)
        for name, bound in self.bounds.items():
            j = front.names.index(name)
            slack = _noise(front)[:, j]
            met &= (
                front.costs[:, j] < bound - slack if self.reference is not None else front.costs[:, j] <= bound + 1e-9
            )
        return met


def _cost(name: str, front: Front) -> str:
    """Return the name of a cost of the front that a user gives; UnknownName if it has none."""
    for known in front.names:
        if known.replace("_", " ") == str(name).strip().lower().replace("_", " "):
            return known
    raise UnknownName(
        f"there is no cost {shown(name)} to wish for.{did_you_mean(name, front.names)} The front has the costs "
        f"{', '.join(front.names)}; for another cost, plan with that criterion as well"
    )


def _noise(front: Front) -> FloatArray:
    """Return by how much (n, k) the search may have rounded each cost of each row: up to a quantum for each edge.

    A cost that is a whole number of quanta in all rows, such as turns, is not rounded.
    """
    edges = [origin.get("edges") or len(t) for origin, t in zip(front.provenance, front.trajectories, strict=True)]
    counts = front.costs / front.quanta
    whole = (np.abs(counts - np.rint(counts)) <= WHOLE).all(axis=0)
    return np.where(whole, 0.25, np.maximum(np.array(edges, np.float64), 1.0)[:, None]) * front.quanta


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
    limit: _Limit | None

    @property
    def able(self) -> Front:
        """Front of the paths that satisfy the condition."""
        return self.found.front

    def answer(self, row: int | None) -> WhyNot:
        """Return the answer, compared with a row of the front; None to choose the row."""
        if not len(self.able):
            return self._answer(f"{self._none()}{self._doubt('another path may')}")
        costs, base = self._columns, self.front.costs
        noise = _noise(self.able)[:, None] + _noise(self.front)[None]  # (a, n, k)
        more = costs[:, None] - base[None]
        equal: BoolArray = np.asarray((np.abs(more) <= noise).all(axis=2))
        worse: BoolArray = (
            np.asarray((more >= -noise).all(axis=2)) & ~equal
        )  # the row is as good in each cost, and better in one
        spread = np.ptp(np.concatenate([costs, base]), axis=0)
        share = np.divide(more, spread, out=np.zeros_like(more), where=spread > 0.0)
        loss = np.maximum(share, 0.0).sum(axis=2)
        on = equal.any(axis=1) & ~worse.any(axis=1)
        if row is not None:
            best = int(np.lexsort((share[:, row].sum(axis=1), loss[:, row]))[0])
        elif on.any():
            best = int(np.argmin(np.where(on, loss[:, self.front.knee().index], np.inf)))
            row = int(np.flatnonzero(equal[best])[0])
        else:
            pairs = np.where(worse, loss, np.inf) if worse.any() else loss
            best, row = (int(i) for i in np.unravel_index(np.argmin(pairs), pairs.shape))
        rows = tuple(np.flatnonzero(equal[on].any(axis=0)).tolist())
        point, numbers = self.able[best], self._numbers(best, row)
        order = np.argsort(-np.abs(share[best, row]), kind="stable")
        differing = [self.front.names[j] for j in order if abs(more[best, row, j]) > noise[best, row, j]]
        if not differing:
            sentence = self._on_front(rows, row)
        else:
            dominating = np.where(worse[best], loss[best], np.inf)
            better = None if not worse[best].any() else int(np.argmin(dominating))
            end = self._place(rows, row, better, never=bool((worse | equal).any(axis=1).all()))
            sentence = f"{self._subject} takes {self._amounts(differing, numbers)} than row {row}; {end}."
        return self._answer(sentence + self._doubt("other paths may be better"), point, row, numbers, rows)

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
        """Return the rows of the front that satisfy the condition, or whose costs a path has that does, as a clause."""
        passage = self.passage
        own = [i for i in rows if passage is None or passage.holds(self.front.trajectories[i])]
        listed = some([str(i) for i in own or rows])
        noun = "row" if len(own or rows) == 1 else "rows"
        if passage is None:
            return f"{noun} {listed}"
        if own:
            return f"{noun} {listed} {'passes' if len(own) == 1 else 'pass'} there"
        return f"a path with the costs of {noun} {listed} passes there"

    def _place(self, rows: tuple[int, ...], row: int, better: int | None, *, never: bool) -> str:
        """Return what the comparison with the whole front says, as a clause.

        better  row that is as good as the best path in each cost and better in one, or None
        never   whether each path that satisfies the condition is matched by a row
        """
        if rows:
            return f"it is on the front: {self._passing_rows(rows)}"
        if not never:
            return "no row of the front is as good in each cost"
        other = "" if better is None or better == row else f": row {better} is as good in each cost, and better in one"
        return f"it is never better{other}"

    def _amounts(self, differing: Sequence[str], numbers: Mapping[str, float]) -> str:
        """Return the two decisive differences in words, the larger shares of the front's ranges first."""
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
        """Return the subject of the sentence."""
        limit = "" if self.limit is None else f" with {self.limit.words}"
        return f"A path{limit}" if self.passage is None else f"Passing {self.passage.words}{limit}"

    def _none(self) -> str:
        """Return the sentence for no path that satisfies the condition."""
        if self.passage is None:
            assert self.limit is not None
            reference = self.limit.reference
            return f"No path has {self.limit.words}{'' if reference is None else f' than row {reference}'}."
        limit = "" if self.limit is None else f" with {self.limit.words}"
        reason = f": {self.found.reason}" if self.found.reason else ""
        return f"No path passes {self.passage.words}{limit}{reason}."

    def _doubt(self, what: str) -> str:
        """Return the words that say so if not all paths that satisfy the condition are known."""
        return "" if self.found.exact else f" Not all paths were searched: {what}."

    def _amount(self, name: str, number: float) -> str:
        """Return a difference of a cost in words, such as "2 turns more"."""
        value = f"{abs(number):.2g}" if abs(number) < 10 else f"{abs(number):.0f}"
        noun = "turn" if (name, value) == ("turns", "1") else _unit(name, self.front)
        return f"{value} {noun} {'more' if number > 0 else 'less'}"


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _unit(name: str, front: Front) -> str:
    """Return the unit and the name of a cost in words; the unit alone for a length or a duration."""
    unit = front.units[front.names.index(name)]
    return unit if name in ("length", "duration") else _spoken(name) if unit == "1" else f"{unit} {_spoken(name)}"
