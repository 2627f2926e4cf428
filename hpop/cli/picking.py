"""Which trajectory of a front is picked on the command line, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpop.base.text import printable
from hpop.cli.report import number
from hpop.errors import OptionError, UnknownName
from hpop.frontier import FrontError, UnknownColumnError, conditions
from hpop.frontier.conditions import Condition
from hpop.preference import Preference
from hpop.problems.front import Front, Point


@dataclass(frozen=True)
class Picked:
    """A point of a front, and the reason in words."""

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
    """The point that ``front.where(...)`` and its ``lexicographic``, ``nearest``, ``select``, ``knee`` give, or a row.

    Raises OptionError and UnknownName where there is none.
    """
    if not len(front):
        raise OptionError(f"the front has no trajectories to pick from; its search ended with {front.status!r}")
    try:
        if row is not None:
            return Picked(front[row], f"row {row}, as asked")
        asked = [Condition.of(name, f"<={bound!r}") for name, bound in at_most.items()]
        rows = np.flatnonzero(conditions.met(front, asked))
        if not rows.size:
            raise OptionError(f"no trajectory to pick: asked for {conditions.in_words(front, asked)}")
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
            point, why = part.knee(), "the knee, a compromise: deepest below the extremes"
    except UnknownColumnError as error:
        hint = "; on the command line --wish NAME=NUMBER does that" * ("only reported" in str(error))
        raise UnknownName(f"{error}{hint}") from None
    except (FrontError, IndexError) as error:
        raise OptionError(str(error)) from None
    among = f", among the {rows.size:,} with {conditions.in_words(front, asked)}" if asked else ""
    return Picked(front[int(rows[point.index])], why + among)


def print_picked(front: Front, choice: Picked, console: Console | None = None, *, saved: Path) -> None:
    """Print which trajectory it is and why, and its costs beside the least and the most of the front."""
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
    columns += [(f"{name} (reported)", unit, values, 1e-6) for name, unit, values in reported]
    for name, unit, values, quantum in columns:
        cells = [number(float(value), quantum) for value in (values[point.index], values.min(), values.max())]
        table.add_row(Text(printable(name)), *cells, Text("" if unit == "1" else printable(unit)))
    console.print(table)
    planner = point.provenance.get("planner")
    _say(console, f"planned by {planner}; {lasts}" if planner else lasts)
    _say(console, f"certificate of the front, which `hpop show` checks: {front.certificate}")


def _say(console: Console, line: str) -> None:
    console.print(Text(printable(line)), highlight=False)
