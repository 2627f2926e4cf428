"""What is printed of a person's preference, and of two trajectories that somebody is to choose from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpop.base.text import counted, printable
from hpop.cli.report import number, plain_table, print_wide
from hpop.cli.results import output_errors
from hpop.preference import Preference
from hpop.preference.best import NEAR
from hpop.problems.front import FOR_YOU, Front

MOST_NEAR = 8
MUCH, LITTLE = 0.5, 0.1  # of the range of a cost on the front
SMALL = 0.01  # of the cost itself: so little is a little, whatever the range


def loaded_preference(path: Path | None) -> Preference | None:
    """The preference in a file, if one is given."""
    if path is None:
        return None
    with output_errors(f"cannot read {path}", "give the file that `hpop prefer` wrote"):
        return Preference.load(path)


def print_preference(person: Preference, front: Front, console: Console | None = None) -> None:
    """Print the best row of a front for a person, how sure that is, and the shares of the costs."""
    console = console or Console()
    best = person.best(front)
    asked = f"{person.question}, from {counted(len(person.answers), 'answer')}"
    if person.answers and not person.can_be_seen:
        _say(console, f"no preference can be seen ({asked}): just anything would be answered alike; ask again, or not")
    table = plain_table()
    table.add_column("cost")
    table.add_column("share", justify="right")
    table.add_column("90 of 100 between", justify="right")
    for (name, share), (low, high) in zip(person.weights.items(), person.interval(0.9).values(), strict=True):
        table.add_row(Text(printable(name)), f"{share:.2f}", f"{low:.2f} and {high:.2f}")
    _say(console, f"What counts, as shares of what costs differ by on the front asked about ({asked})")
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
        _say(console, f"nearly as good by what is known (expected regret up to {bound}): {', '.join(others)}{more}")


def pair_table(front: Front, pair: Sequence[int]) -> Table:
    """What two rows cost, side by side, and where they differ, in words."""
    table = plain_table()
    for column in ("", "a", "b"):
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    table.add_column("")
    for one in differences(front, pair):
        table.add_row(Text(printable(one.label)), one.a, one.b, one.words)
    return table


class Difference(NamedTuple):
    """One cost of two rows a and b, as they are printed, and in words which has less of it."""

    name: str
    unit: str
    a: str
    b: str
    words: str

    @property
    def label(self) -> str:
        """The cost with its unit."""
        return self.name if self.unit == "1" else f"{self.name} ({self.unit})"


def differences(front: Front, pair: Sequence[int]) -> list[Difference]:
    """Each cost of two rows, beside one another."""
    found = []
    span = np.ptp(front.costs, axis=0)
    for j, (name, unit) in enumerate(zip(front.names, front.units, strict=True)):
        a, b = (float(front.costs[row, j]) for row in pair)
        quantum = float(front.quanta[j])
        if round((a - b) / quantum) == 0:
            said = "the same"
        else:
            share, part = abs(a - b) / span[j], abs(a - b) / max(abs(a), abs(b))
            much = "a little " if share < LITTLE or part < SMALL else "much " if share > MUCH else ""
            less = f"{number(abs(a - b), quantum)}{'' if unit == '1' else f' {unit}'}"
            said = f"{'a' if a < b else 'b'} has {much}less, by {less}"
        found.append(Difference(name, unit, number(a, quantum), number(b, quantum), said))
    return found


def percent(share: float) -> str:
    """A share in words."""
    return f"{100 * share:.1f} %"


def _say(console: Console, line: str) -> None:
    console.print(Text(printable(line)), highlight=False)
