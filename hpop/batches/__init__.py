"""Batches: many problems, solved by several planners on several workers, with all results in one Parquet data set.

Here is the summary of a batch: statuses, planning times, front sizes and hypervolumes of each planner.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.batches.results import COST, Results
from hpop.batches.running import batch
from hpop.frontier import default_reference, hypervolume
from hpop.runtime.limits import Status

__all__ = ["PlannerSummary", "Results", "batch", "summaries", "summary_lines"]


@dataclass(frozen=True, eq=False)
class PlannerSummary:
    """Statistics of one planner over the cases that it was given.

    planner  label
    counts   number of cases by status: "complete", "no path", "error", a limit, ...
    seconds  (n,) planning time of the cases without an error, s
    points   (n,) front sizes of these cases; 0 if no path was found
    shares   (p,) hypervolume of the planner's front divided by that of the joint front of all planners; one for each
             problem that was given to several planners and solved by at least one
    """

    planner: str
    counts: dict[str, int]
    seconds: FloatArray
    points: FloatArray
    shares: FloatArray

    @property
    def cases(self) -> int:
        """Number of cases given to this planner."""
        return sum(self.counts.values())


@dataclass(eq=False)
class _ProblemFronts:
    """Fronts that several planners found for one problem.

    names     of the criteria
    costs     rows of costs by planner
    planners  labels of all planners that were given the problem
    """

    names: tuple[str, ...] = ()
    costs: dict[str, list[list[float]]] = field(default_factory=lambda: defaultdict(list))
    planners: set[str] = field(default_factory=set)


@checked_arguments
def summaries(results: Results) -> list[PlannerSummary]:
    """Return the statistics of each planner in a batch, in the order in which planners first appear."""
    counts: dict[str, dict[str, int]] = {}
    seconds: dict[str, list[float]] = defaultdict(list)
    points: dict[str, list[float]] = defaultdict(list)
    problems: dict[str, _ProblemFronts] = defaultdict(_ProblemFronts)
    for table in results.tables():
        names = [name for name in table.column_names if name.startswith(COST)]
        columns = {name: table[name].to_pylist() for name in (*_NEEDED, *names)}
        for row, planner in enumerate(columns["planner"]):
            of = counts.setdefault(planner, defaultdict(int))
            if columns["row"][row] in (None, 0):
                of[columns["status"][row]] += 1
                if columns["error"][row] is None:
                    seconds[planner].append(columns["seconds"][row])
                    points[planner].append(columns["points"][row] or 0)
            problem = problems[columns["problem"][row]]
            problem.planners.add(planner)
            if columns["row"][row] is not None:
                here = tuple(name for name in names if columns[name][row] is not None)
                problem.names = problem.names or here
                if here == problem.names:
                    problem.costs[planner].append([columns[name][row] for name in here])
    shares = _hypervolume_shares(problems.values())
    return [
        PlannerSummary(p, dict(of), np.array(seconds[p]), np.array(points[p]), np.array(shares[p]))
        for p, of in counts.items()
    ]


_NEEDED = ("planner", "row", "status", "error", "seconds", "points", "problem")


def _hypervolume_shares(problems: Any) -> dict[str, list[float]]:
    """Return, by planner, its share of the joint hypervolume of each problem that several planners were given."""
    shares: dict[str, list[float]] = defaultdict(list)
    for problem in problems:
        if len(problem.planners) < 2 or not problem.costs:
            continue
        joint = np.concatenate([np.array(rows) for rows in problem.costs.values()])
        reference = default_reference(joint)
        whole = hypervolume(joint, reference)
        for planner in problem.planners:
            rows = problem.costs.get(planner)
            shares[planner].append(hypervolume(rows, reference) / whole if rows else 0.0)
    return shares


@checked_arguments
def summary_lines(found: Sequence[PlannerSummary]) -> list[str]:
    r"""Return the statistics as the lines of a text table.

    >>> numbers = np.array([1.0, 2.0]), np.array([3.0, 9.0]), np.array([1.0, 0.5])
    >>> print(*summary_lines([PlannerSummary("lattice", {"complete": 2, "error": 1}, *numbers)]), sep="\n")
    planner  cases    solved  no path  errors  seconds (median, 90 %)   points (median)   hypervolume (mean share)
    lattice      3         2        0       1              1.5     1.9               6.0                     75.0 %
    """
    width = max(len("planner"), *(len(each.planner) for each in found))
    lines = [
        f"{'planner':{width}}  cases    solved  no path  errors  seconds (median, 90 %)   points (median)   "
        "hypervolume (mean share)"
    ]
    for each in found:
        solved = int(np.count_nonzero(each.points))
        none, errors = each.counts.get(Status.NO_PATH, 0), each.counts.get("error", 0)
        median, most = _quantiles(each.seconds)
        share = "" if not each.shares.size else f"{100 * each.shares.mean():.1f} %"
        lines.append(
            f"{each.planner:{width}}  {each.cases:5}  {solved:8}  {none:7}  {errors:6}  {median:>15} {most:>7}   "
            f"{_quantiles(each.points)[0]:>15}   {share:>24}"
        )
    return lines


def _quantiles(numbers: FloatArray) -> tuple[str, str]:
    """Return the median and the 90 % quantile as text; "" for no numbers."""
    if not numbers.size:
        return "", ""
    median, most = np.quantile(numbers, [0.5, 0.9])
    return f"{median:.3g}" if median < 1 else f"{median:.1f}", f"{most:.3g}" if most < 1 else f"{most:.1f}"


def remaining_text(seconds: float) -> str:
    """Return an estimate of the remaining time as the end of a sentence; "" for nan.

    >>> remaining_text(math.nan), remaining_text(12.2), remaining_text(83), remaining_text(7300)
    ('', ', about 12 s left', ', about 1:23 min left', ', about 2:01 h left')
    """
    if math.isnan(seconds):
        return ""
    whole = round(seconds)
    if whole < 60:
        return f", about {whole} s left"
    if whole < 3600:
        return f", about {whole // 60}:{whole % 60:02} min left"
    return f", about {whole // 3600}:{whole % 3600 // 60:02} h left"
