"""Output of the command line: the front as a table, contributions of planners, and the end of a search."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpop.base.arrays import FloatArray, distinct
from hpop.base.text import printable
from hpop.criteria import make_criterion
from hpop.criteria.base import quantity_of
from hpop.criteria.costs import trajectory_costs
from hpop.frontier import hypervolume, representative
from hpop.frontier.choices import Preferring
from hpop.frontier.choosing import differing
from hpop.frontier.points import JOINT
from hpop.motions.laws import SPEED
from hpop.planners.objectives import integral_of
from hpop.problems.evaluation import criteria_of
from hpop.problems.front import Front
from hpop.problems.named_rows import visit_order
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory

MOST_ROWS = 20
MOST_DIGITS = 7  # most digits added to distinguish costs
WORDS = "what these words mean: `hpop explain certificate`, knee, exposure and so on (docs/glossary.md)"
BOX = 1.1  # side of the box of scaled costs in which hypervolumes are measured
MOST_MEASURED = {4: 20_000, 5: 4_000, 6: 1_000, 7: 100}  # most points of a hypervolume, by number of costs


def marks(front: Front, preference: Preferring | None = None) -> dict[int, list[str]]:
    """Return the labels of marked rows, such as "knee", by row number."""
    names: dict[int, list[str]] = {}
    for label, point in front.named(preference).items():
        names.setdefault(point.index, []).append(label)
    return names


def print_front(
    problem: Problem,
    front: Front,
    console: Console | None = None,
    *,
    saved: Path = Path("front.json"),
    verbose: bool = False,
    preference: Preferring | None = None,
    most: MostRows | None = None,
) -> None:
    """Print notes, the front, planned and executed costs of its marked trajectories, the status and the certificate.

    Parameters
    ----------
    saved : file with the whole front, named in the output
    verbose : whether to print statistics of the search
    preference : a person's preference; the best trajectory for that person is marked "for you"
    most : number of rows of the table, and how they are chosen; by default 20 rows that differ most
    """
    console = console or Console()

    def say(line: str) -> None:
        console.print(Text(printable(line)), highlight=False)

    if not problem.target.listed:
        say(f"goal: {problem.target}")
    decides = [f"{name} is the same for every trajectory and decides nothing here" for name in front.inactive]
    for note in (*problem.world.notes, *front.notes, *decides):
        say(f"note: {note}")
    if len(front):
        names = marks(front, preference)
        most = most or MostRows(MOST_ROWS)
        rows = shown_rows(front, most, names)
        console.print()
        say("The front: no trajectory is better than another one in one cost and no worse in the others")
        print_wide(console, _front_table(front, rows, names))
        if problem.tour is not None:
            stops = ", ".join(f"{i} {name}" for i, name in enumerate(problem.tour.names, 1))
            say(f"stops, in the order of visits: {stops}")
        if len(rows) < len(front):
            chosen = "marked or with the largest joint hypervolume" if most.represent else "those that differ most"
            say(f"{len(rows)} of {len(front):,} trajectories shown, {chosen}; all are in {saved}")
        console.print()
        say("The marked trajectories as planned and as executed (real speed ramps)")
        print_wide(console, _executed_table(problem, front, names))
        console.print()
    for run in front.runs if verbose else ():
        finite = {k: v for k, v in run.items() if isinstance(v, int | float) and abs(v) <= sys.float_info.max}
        if finite:
            say(f"{run.get('planner', 'planner')}: {', '.join(map(_counted, finite.keys(), finite.values()))}")
    origins = Counter(str(origin.get("planner")) for origin in front.provenance)
    if len(origins) > 1:
        say(f"planned by: {', '.join(f'{name} {count:,}' for name, count in sorted(origins.items()))}")
    say(f"{how_many(front)}; status: {front.status}")
    say(f"certificate: {front.certificate}")
    say(WORDS)


@dataclasses.dataclass(frozen=True)
class Contribution:
    """Contribution of one planner to the joint front of several planners.

    points  number of points of the final joint front that this planner found first
    found   number of points of the joint front of this planner and all planners before it
    before  hypervolume of the joint front of the planners before this one, 0 for the first
    after   hypervolume of the joint front with this planner; NaN if it would take minutes to compute
    """

    planner: str
    points: int
    found: int
    before: float
    after: float


def contributions(planners: Sequence[str], fronts: Sequence[Front]) -> list[Contribution]:
    """Return the contribution of each planner; ``fronts[i]`` is the joint front of planners 0 to i.

    For hypervolumes, costs are scaled over all fronts together.
    """
    known: set[tuple[int, ...]] = set()
    last = set(map(tuple, fronts[-1].integers.tolist()))
    points = []
    for front in fronts:
        new = set(map(tuple, front.integers.tolist())) - known
        points.append(len(new & last))
        known |= new
    volumes = [0.0, *_hypervolumes(fronts, fronts)]
    return [
        Contribution(name, points[i], len(front), volumes[i], volumes[i + 1])
        for i, (name, front) in enumerate(zip(planners, fronts, strict=False))
    ]


def _hypervolumes(fronts: Sequence[Front], scale: Sequence[Front]) -> list[float]:
    """Return the hypervolume of each front, with reference point 1.1 and costs scaled to [0, 1] over ``scale``.

    ``scale`` are fronts; a cost that is constant in them is only shifted. The result is NaN if it would take minutes to
    compute.
    """
    scale = [front for front in scale if len(front)]
    if not scale:
        return [0.0] * len(fronts)
    names = scale[0].names
    if len(names) > 3 and max(map(len, fronts)) > MOST_MEASURED.get(len(names), 0):
        return [math.nan] * len(fronts)
    costs, integers = (np.concatenate([getattr(front, each) for front in scale]) for each in ("costs", "integers"))
    ideal = costs.min(axis=0)
    same = np.ptp(integers, axis=0) == 0  # in whole quanta, so that rounding makes no scale
    span = np.where(same, 1.0, costs.max(axis=0) - ideal)
    reference = np.full(len(names), BOX)
    return [hypervolume((front.costs - ideal) / span, reference) if len(front) else 0.0 for front in fronts]


class StageLines:
    """Printer of one line for each front of a running search, so that a user sees the front grow.

    The line has the time, the number of trajectories and the hypervolume. Costs are scaled so that the first front with
    points has ideal 0 and nadir 1; the reference point is 1.1. So the hypervolume of an improved front is never
    smaller. The first front differs from run to run, so the line says that the scale is that of this run's first front.
    A hypervolume above that of a box with side 1.1, as after a first front of a few close points, is printed as
    "beyond" the scale.
    """

    def __init__(self) -> None:
        self.last: Front | None = None
        self.first: Front | None = None
        self._began = perf_counter()

    def __call__(self, front: Front) -> None:
        """Print a line for a front."""
        alone = self.last is None and front.status == Status.COMPLETE  # no other front to compare it with
        self.last = front
        if self.first is None or not len(self.first):
            self.first = front
        (volume,) = [math.nan] if alone else _hypervolumes([front], [self.first])
        planner = front.runs[-1].get("planner", "planner")
        size = "beyond" if volume > BOX ** len(front.names) else f"{volume:.4f} in"
        measured = "" if math.isnan(volume) else f", hypervolume {size} the scale of this run's first front"
        line = f"{perf_counter() - self._began:.2f} s  {planner}: {how_many(front)}{measured}, {front.status}"
        sys.stdout.write(f"{printable(line)}\n")  # plain text, so that the live progress line is not broken


def how_many(front: Front) -> str:
    """Return the number of trajectories as text, such as "2 trajectories"."""
    return f"{len(front):,} {'trajectory' if len(front) == 1 else 'trajectories'}"


def print_contributions(planners: Sequence[str], fronts: Sequence[Front], console: Console | None = None) -> None:
    """Print how much each of several planners added to the front; print nothing for one planner."""
    if len(planners) < 2 or not fronts:
        return
    console = console or Console()
    table = plain_table()
    table.add_column("planner", no_wrap=True)
    for column in ("first to\nfind", "hypervolume\nbefore", "hypervolume\nafter", "front\nafter"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in contributions(planners, fronts):
        volumes = ("-" if math.isnan(volume) else f"{volume:.4f}" for volume in (row.before, row.after))
        cells = (f"{row.points:,}", *volumes, f"{row.found:,}")
        table.add_row(Text(printable(row.planner)), *cells)
    console.print("\nWhat each planner added (hypervolume in the scale of all these fronts)")
    print_wide(console, table)
    for name in planners[len(fronts) :]:
        console.print(Text(printable(f"{name} was not run")), highlight=False)


def _counted(key: str, value: float) -> str:
    """Format a statistic of a run, which may be a count, seconds or bytes.

    >>> _counted("search_seconds", 0.0912), _counted("peak_memory", 14_383_600), _counted("edges", 440_878)
    ('search 0.09 s', 'peak memory 14 MB', 'edges 440,878')
    >>> _counted("missed", 0.1 + 0.2)
    'missed 0.3'
    """
    words = key.replace("_", " ")
    if key.endswith("_seconds"):
        return f"{words.removesuffix(' seconds')} {value:.2f} s"
    if key.endswith("memory"):
        return f"{words} {value / 1e6:,.0f} MB"
    return f"{words} {value:,.4g}" if isinstance(value, float) and abs(value) < 1000 else f"{words} {value:,.0f}"


def print_wide(console: Console, table: Table) -> None:
    """Print a table in full width; a narrower terminal wraps its lines."""
    width = console.width
    console.width = max(width, console.measure(table, options=console.options.update(max_width=10_000)).maximum)
    console.print(table, crop=False)
    console.width = width


def plain_table() -> Table:
    """Return an empty table with the layout of all tables of the command line."""
    return Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))


def header(name: str, unit: str, what: str = "") -> Text:
    """Return the header of a column: name over unit; ``what`` says what it measures, if its name does not."""
    below = ", ".join(part for part in (what, "" if unit == "1" else unit) if part)
    return Text(f"{printable(name)}\n({printable(below)})" if below else printable(name))


def headers(front: Front) -> list[Text]:
    """Return the headers of a front's costs."""
    columns = zip(front.names, front.units, front.groups, strict=True)
    return [header(name, unit, quantity_of(name, [group])) for name, unit, group in columns]


def _labels(names: Sequence[str]) -> Text:
    """Return labels as text, one on each line."""
    return Text("\n".join(map(printable, names)))


def _front_table(front: Front, rows: Sequence[int], names: Mapping[int, Sequence[str]]) -> Table:
    """Return the table of a front: row number, costs, reported values, speeds, order of stops, and labels."""
    table = plain_table()
    table.add_column("#", justify="right")
    for words in headers(front):
        table.add_column(words, justify="right", no_wrap=True)
    for name, unit in zip(front.reported_names, front.reported_units, strict=True):
        words = Text("reported\n") + header(name, unit, quantity_of(name, front.groups))
        table.add_column(words, justify="right", style="dim", no_wrap=True)
    if is_tour := any("visits" in front.provenance[row] for row in rows):
        table.add_column("stops", no_wrap=True)
    models = [front.trajectories[row].model for row in rows[:1]]
    if has_speeds := any(each.speed_classes or each.paces for each in models):
        table.add_column("speeds" if any(each.paces for each in models) else "speeds\n(m/s)", no_wrap=True)
    table.add_column("marked", no_wrap=True)
    costs, reported = front.costs[rows].T, front.reported[rows].T
    columns = [numbers(column, quantum) for column, quantum in zip(costs, front.quanta, strict=True)]
    columns += [[number(value, 1e-6) for value in column] for column in reported.tolist()]
    for row, *cells in zip(rows, *columns, strict=True):
        order = [visit_order(front, row)] if is_tour else []
        order += [driven_speeds(front.trajectories[row])] if has_speeds else []
        table.add_row(str(row), *cells, *order, _labels(names.get(row, [])), style="bold" if row in names else None)
    return table


def driven_speeds(trajectory: Trajectory) -> str:
    """Return the speeds, m/s, among which a plan chose, such as "0.5 1"; for a speed profile "up to 0.9"; "-" for none.

    For a robot that chooses among laws, such as an arm, the kinds of motion that it chooses follow: "reach_0.5".
    """
    model, none = trajectory.model, np.zeros(1)
    chosen = {kind for pace in model.paces for kind in pace.values()}
    speeds = distinct(getattr(trajectory.states, SPEED, none)) if model.speed_classes else none
    driven = [f"{speed:g}" for speed in speeds.tolist() if speed > 0.0]
    driven = driven if len(driven) <= len(model.speed_classes) else [f"up to {speeds.max():.3g}"]
    return " ".join([*driven, *sorted(chosen.intersection(trajectory.kinds))]) or "-"


class MostRows(NamedTuple):
    """Number of rows of a table.

    number     number of rows; marked rows are printed even if they are more
    represent  whether ``number`` rows are chosen for their joint hypervolume, and the marked ones added; else the
               marked rows and those that differ most from them, ``number`` in all
    """

    number: int
    represent: bool = False


def shown_rows(front: Front, most: MostRows, marked: Iterable[int] = ()) -> list[int]:
    """Return the rows to print, rising: all rows of a front of at most ``most.number``, else as in MostRows."""
    if len(front) <= most.number:
        return list(range(len(front)))
    always = {*marks(front), *marked}
    if most.represent:
        return sorted(always.union(representative(front.integers, most.number).tolist()))
    return sorted(differing(front.costs, most.number, always=sorted(always)))


def _executed_table(problem: Problem, front: Front, names: Mapping[int, Sequence[str]]) -> Table:
    """Return a table of planned and executed costs of the marked rows; executed costs include speed ramps.

    It also has the duration, and the integrals over time that the search minimised in the place of means.
    """
    table = plain_table()
    table.add_column("#", justify="right")
    table.add_column("costs")
    criteria = [*problem.criteria, *criteria_of(front)]
    integrals = [integral_of(each) for each in problem.criteria if each.aggregate == "time-mean"]
    more = [*integrals, make_criterion("duration")]
    more = [each for each in more if each.name not in {known.name for known in criteria}]
    criteria += [each for each in more if each.name in (*front.names, "duration")]
    for criterion in criteria:
        table.add_column(header(criterion.name, criterion.unit, criterion.quantity), justify="right", no_wrap=True)
    table.add_column("marked", no_wrap=True)
    for row, labels in sorted(names.items()):
        pair = [front.trajectories[row], front.trajectories[row].execution()]
        for word, costs in zip(("planned", "executed"), trajectory_costs(criteria, pair, problem.world), strict=True):
            cells = [number(cost, c.quantum) for cost, c in zip(costs, criteria, strict=True)]
            first = word == "planned"
            table.add_row(str(row) if first else "", word, *cells, _labels(labels) if first else "")
    return table


def is_complete(front: Front) -> bool:
    """Return whether every planner of a front has found all that it can find, or has shown that no path exists."""
    return set(front.status.split(JOINT)) <= {Status.COMPLETE, Status.NO_PATH}


def why_nothing(status: str) -> str:
    """Return the reason why a front has no points, with advice, for a status such as "time limit"."""
    ways: dict[str, str] = {
        Status.TIME_LIMIT: "raise time_limit (s), or make the graph smaller (a larger step, fewer samples)",
        Status.LABEL_LIMIT: "raise max_labels, or make the graph smaller (a larger step, fewer samples)",
        Status.MEMORY_LIMIT: "raise max_memory (bytes), or make the graph smaller (a larger step, fewer samples)",
        Status.POINT_LIMIT: "raise max_points",
        Status.RUN_LIMIT: "raise the planner's number of runs, or change its seed",
        Status.NO_PATH: "the notes say what is in the way",
        Status.COMPLETE: "the notes say why candidates were dropped; try another planner, such as 'lattice'",
    }
    return ". ".join(f"{part}: {ways[part]}" if part in ways else part for part in status.split(JOINT))


def numbers(values: FloatArray, quantum: float) -> list[str]:
    """Format each cost of a column by :func:`number`, with up to six more digits until costs a quantum apart differ.

    The texts may have different numbers of decimals, because costs below 0.1 get significant digits.

    >>> numbers(np.array([41.29117, 41.29132, 3.0]), 1e-6), numbers(np.array([3.0, 3.0000001]), 1e-6)
    (['41.2912', '41.2913', '3.0000'], ['3.000', '3.000'])
    >>> numbers(np.array([3.0, 0.0123456, 0.05, 1e-9]), 1e-6)
    ['3.000', '0.01235', '0.05', '0']
    """
    kinds = len(distinct(np.rint(values / quantum)))
    for more in range(MOST_DIGITS):
        texts = [number(value, quantum, more) for value in values.tolist()]
        if len({float(text) for text in texts}) >= kinds:
            break
    return texts


def number(value: float, quantum: float, more: int = 0) -> str:
    """Format a cost: 0 below half a quantum, whole if its quantum is 1 or more, else three decimals plus ``more``.

    Values below 0.1 get four significant digits plus ``more`` instead.

    >>> number(3.0, 1.0), number(41.29117, 1e-6), number(0.01234567, 1e-6), number(3e-8, 1e-6)
    ('3', '41.291', '0.01235', '0')
    """
    if abs(value) < 0.5 * quantum:
        return "0"
    if quantum >= 1.0:
        return f"{value:.0f}"
    return f"{value:.{4 + more}g}" if 0 < abs(value) < 0.1 else f"{value:.{3 + more}f}"
