"""Output of ``hpop pick`` and ``hpop prefer``: the picked trajectory, a preference, and two trajectories compared."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpop.base.text import counted, printable
from hpop.cli.page_words import words_of
from hpop.cli.report import number, plain_table, print_wide
from hpop.cli.results import output_errors
from hpop.criteria.base import quantity_of
from hpop.errors import OptionError, UnknownName
from hpop.frontier import FrontError, UnknownColumnError, choices
from hpop.frontier.choices import ColumnCondition
from hpop.preference import Preference
from hpop.preference.posterior import NEAR
from hpop.problems.front import FOR_YOU, Front, Point
from hpop.problems.named_rows import named_rows

REPORTED = " (reported)"


@dataclass(frozen=True)
class Picked:
    """Point of a front, with the reason for picking it."""

    point: Point
    why: str


def picked(
    front: Front,
    at_most: Mapping[str, float],
    *,
    least: Sequence[str] = (),
    wish: Mapping[str, float] | None = None,
    row: int | None = None,
    preference: Preference | None = None,
) -> Picked:
    """Pick a point of a front by row, least costs, wish or preference, by default the knee; return it with the reason.

    at_most     upper bounds of costs: only points within them are considered, unless ``row`` is given
    least       names of costs to minimise; later ones break ties
    wish        values of costs; the point nearest to them is picked
    preference  of a person; the point that is best for this person is picked

    Raises OptionError or UnknownName if no point can be picked.
    """
    if not len(front):
        raise OptionError(f"the front has no trajectories to pick from; its search ended with {front.status!r}")
    try:
        if row is not None:
            return Picked(named_rows(front, [row])[0].point, f"row {row}, as asked")
        asked = [ColumnCondition.of(name, f"<={bound!r}") for name, bound in at_most.items()]
        rows = np.flatnonzero(choices.met(front, asked))
        if not rows.size:
            raise OptionError(f"no trajectory to pick with {choices.in_words(front, asked)}; raise --at-most")
        part = front.where({name: f"<={bound!r}" for name, bound in at_most.items()}) if at_most else front
        if least:
            point, why = part.lexicographic(least), f"the least {', then '.join(least)}"
            why += " of those found" * bool({*least} & {*front.evaluated})
        elif wish:
            words = ", ".join(f"{name} {value:g}" for name, value in wish.items())
            point, why = part.nearest(wish), f"nearest to {words}"
        elif preference is not None:
            best = preference.best(part)
            point, why = (
                best.point,
                f"best for you ({preference.question}), probability {best.probability[best.row]:.2f}",
            )
        else:
            point, why = part.knee(), "the knee, a compromise: the deepest point of the front's bend"
    except UnknownColumnError as error:
        if reported := re.search(r"'(\w+)' is only reported", str(error)):
            raise UnknownName(
                f"{reported[1]} is reported, not minimised: take --wish {reported[1]}=0, which finds the point nearest "
                f"to this value, or one of the columns {', '.join(front.names)}; or plan a front that minimises it"
            ) from None
        hint = "; --also NAME adds a criterion to these" * ("has no column" in str(error))
        raise UnknownName(f"{error}{hint}") from None
    except (FrontError, IndexError) as error:
        raise OptionError(str(error)) from None
    among = f", among the {rows.size:,} with {choices.in_words(front, asked)}" if asked else ""
    return Picked(front[int(rows[point.index])], why + among)


def print_picked(front: Front, choice: Picked, console: Console | None = None, *, saved: Path) -> None:
    """Print the picked trajectory, the reason, and its costs beside the least and greatest costs on the front."""
    console = console or Console()
    point, trajectory = choice.point, choice.point.trajectory
    lasts = f"{trajectory.duration:.1f} s as planned, {trajectory.execution().duration:.1f} s executed"
    _say(console, f"picked trajectory {point.index} of {len(front):,} in {saved} (counted from 0): {choice.why}")
    table = Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("")
    for heading in ("picked", "least", "most", "unit"):
        table.add_column(heading, justify="left" if heading == "unit" else "right", no_wrap=True)
    columns = [*zip(front.names, front.units, front.costs.T, front.quanta.tolist(), strict=True)]
    reported = zip(front.reported_names, front.reported_units, front.reported.T, strict=True)
    columns += [(f"{name}{REPORTED}", unit, values, 1e-6) for name, unit, values in reported]
    for name, unit, values, quantum in columns:
        cells = [number(float(value), quantum) for value in (values[point.index], values.min(), values.max())]
        what = quantity_of(name.removesuffix(REPORTED), front.groups)
        words = ", ".join(part for part in (what, "" if unit == "1" else unit) if part)
        table.add_row(Text(printable(name)), *cells, Text(printable(words)))
    console.print(table)
    planner = point.provenance.get("planner")
    _say(console, f"planned by {planner}; {lasts}" if planner else lasts)
    _say(console, f"certificate of the front, which `hpop show` checks: {front.certificate}")


def _say(console: Console, line: str) -> None:
    console.print(Text(printable(line)), highlight=False)


MOST_NEAR = 8
MUCH, LITTLE = 0.5, 0.1  # shares of a cost's range on the front: differences that are "much" and "a little"
SMALL = 0.01  # share of the cost itself: a smaller difference is "a little", whatever the range


def loaded_preference(path: Path | None) -> Preference | None:
    """Load the preference of a person from a file; return None for None."""
    if path is None:
        return None
    with output_errors(f"cannot read {path}", "give the file that `hpop prefer` wrote"):
        return Preference.load(path)


def print_preference(person: Preference, front: Front, console: Console | None = None) -> None:
    """Print the best trajectory for a person, the probability that it is best, and the weights of the costs."""
    console = console or Console()
    best = person.best(front)
    asked = f"{person.question}, from {counted(len(person.answers), 'answer')}"
    if person.answers and not person.can_be_seen:
        _say(console, f"no preference can be seen ({asked}): random answers would look the same; ask more questions")
    table = plain_table()
    table.add_column("cost")
    table.add_column("share", justify="right")
    table.add_column("90 of 100 between", justify="right")
    for (name, share), (low, high) in zip(person.weights.items(), person.interval(0.9).values(), strict=True):
        table.add_row(Text(printable(name)), f"{share:.2f}", f"{low:.2f} and {high:.2f}")
    _say(console, f"Weights of the costs, each scaled to its range on the front of the questions ({asked})")
    print_wide(console, table)
    costs = ", ".join(
        f"{name} {number(value, quantum)}{'' if unit == '1' else f' {unit}'}"
        for (name, value), unit, quantum in zip(best.point.costs.items(), front.units, front.quanta, strict=True)
    )
    _say(console, f"{FOR_YOU}: trajectory {best.row}, {costs}")
    sure = f"the best one with probability {best.probability[best.row]:.2f}"
    _say(console, f"{sure}; on average {percent(best.regret)} of the range short of the best one (expected regret)")
    if len(best.near) > 1:
        others = [str(row) for row in best.near[1 : MOST_NEAR + 1]]
        more = f" and {len(best.near) - 1 - MOST_NEAR} more" * (len(best.near) - 1 > MOST_NEAR)
        bound = percent(best.regret + NEAR)
        _say(console, f"nearly as good (expected regret up to {bound}): {', '.join(others)}{more}")


def pair_table(front: Front, pair: Sequence[int]) -> Table:
    """Return a table that compares the costs of two rows of a front, with each difference in words."""
    table = plain_table()
    for column in ("", "a", "b"):
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    table.add_column("")
    for cost in differences(front, pair):
        table.add_row(Text(printable(cost.label)), cost.a, cost.b, cost.words)
    return table


class Difference(NamedTuple):
    """One cost of two trajectories a and b: both values as text, and the difference in words."""

    name: str
    unit: str
    a: str
    b: str
    words: str

    @property
    def label(self) -> str:
        """Return the name of the cost with its unit."""
        return self.name if self.unit == "1" else f"{self.name} ({self.unit})"


def differences(front: Front, pair: Sequence[int], language: str = "en") -> list[Difference]:
    """Compare two rows of a front: return the two values of each cost, and their difference in words."""
    found, texts = [], words_of(language)
    span = np.ptp(front.costs, axis=0)
    for j, (name, unit) in enumerate(zip(front.names, front.units, strict=True)):
        a, b = (float(front.costs[row, j]) for row in pair)
        quantum = float(front.quanta[j])
        if round((a - b) / quantum) == 0:
            said = texts.say("same")
        else:
            share, part = abs(a - b) / span[j], abs(a - b) / max(abs(a), abs(b))
            less = "less_little" if share < LITTLE or part < SMALL else "less_much" if share > MUCH else "less"
            amount = f"{texts.number(number(abs(a - b), quantum))}{'' if unit == '1' else f' {unit}'}"
            said = texts.say(less, which="a" if a < b else "b", amount=amount)
        of_a, of_b = (texts.number(number(value, quantum)) for value in (a, b))
        found.append(Difference(texts.cost(name), unit, of_a, of_b, said))
    return found


def percent(share: float) -> str:
    """Format a share as a percentage."""
    return f"{100 * share:.1f} %"
