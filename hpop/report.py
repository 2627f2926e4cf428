"""What the command line prints: the progress of a search, the front as a table, what there is to choose from."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress as Bar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from hpop import registry
from hpop.criteria.base import Criterion, trajectory_costs
from hpop.front import Front
from hpop.frontier import Point
from hpop.problem import Problem
from hpop.status import Progress, ProgressCallback

MOST_ROWS = 30
GROUPS = {"P": "performance", "C": "comfort", "R": "robot", "O": "others"}


@contextmanager
def progress_bar() -> Iterator[ProgressCallback]:
    """A line on the terminal that follows a search: stage, labels, front, memory, time."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def update(progress: Progress) -> None:
            counts = f"  {progress.labels:,} labels, {progress.open:,} open, front {progress.front:,}"
            memory = f", {progress.memory / 1e6:,.0f} MB"
            bar.update(task, description=progress.stage + (counts + memory if progress.labels else ""))

        yield update


def marked(front: Front) -> dict[str, Point[Any]]:
    """The points worth a name: the knee and the best in each criterion."""
    if not len(front):
        return {}
    best = {f"least {name}": front.best(name) for name in front.names}
    return {"knee": front.knee(), **best}


def print_front(problem: Problem, front: Front, console: Console | None = None) -> None:
    """Print the front, the executed costs of the marked trajectories, the notes and the certificate."""
    console = console or Console()
    for note in (*problem.world.notes, *front.notes):
        console.print(f"note: {note}", highlight=False, markup=False)
    if len(front):
        console.print(_front_table(front))
        console.print(_executed_table(problem, front))
    for run in front.runs:
        numbers = (f"{_words(key)} {_amount(value)}" for key, value in run.items() if isinstance(value, int | float))
        console.print(f"{run.get('planner', 'planner')}: {', '.join(numbers)}", highlight=False)
    console.print(f"{len(front)} optimal trajectories; status: {front.status}", highlight=False)
    console.print(f"certificate: {front.certificate}", highlight=False, markup=False)


def _words(key: str) -> str:
    return key.replace("_", " ")


def _amount(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:.2f}"


def _header(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} ({unit})"


def _front_table(front: Front) -> Table:
    names: dict[int, list[str]] = {}
    for label, point in marked(front).items():
        names.setdefault(point.index, []).append(label)
    table = Table(title="The front: no trajectory is better in one cost and no worse in the others")
    table.add_column("#", justify="right")
    for name, unit in zip(front.names, front.units, strict=True):
        table.add_column(_header(name, unit), justify="right")
    for name, unit in zip(front.reported_names, front.reported_units, strict=True):
        table.add_column(f"{_header(name, unit)}, reported", justify="right", style="dim")
    table.add_column("marked")
    rows = _rows_to_print(len(front), sorted(names))
    for before, row in zip([-1, *rows], rows, strict=False):
        if row > before + 1:
            table.add_row("...", *[""] * (len(front.names) + len(front.reported_names)), f"{row - before - 1} more")
        values = [*front.costs[row], *front.reported[row]]
        quanta = [*front.quanta, *[1e-6] * len(front.reported_names)]
        cells = [number(value, quantum) for value, quantum in zip(values, quanta, strict=True)]
        table.add_row(str(row), *cells, ", ".join(names.get(row, [])), style="bold" if row in names else None)
    return table


def _rows_to_print(size: int, marked_rows: Sequence[int]) -> list[int]:
    """All rows of a short front; of a long one the marked and some in between, the last always."""
    if size <= MOST_ROWS:
        return list(range(size))
    spread = np.linspace(0, size - 1, max(2, MOST_ROWS - len(marked_rows))).astype(int).tolist()
    return sorted({*spread, *marked_rows})


def _executed_table(problem: Problem, front: Front) -> Table:
    """Planned beside executed costs: what the planning law adds up, and what real speed ramps make of it."""
    table = Table(title="Planned and executed (real speed ramps)")
    table.add_column("trajectory")
    for criterion in problem.criteria:
        table.add_column(_header(criterion.name, criterion.unit), justify="right")
    for label, point in marked(front).items():
        both = [point.item, point.item.execution()]
        planned, executed = trajectory_costs(problem.criteria, both, problem.world)
        cells = [
            f"{number(p, c.quantum)} / {number(e, c.quantum)}"
            for p, e, c in zip(planned, executed, problem.criteria, strict=True)
        ]
        table.add_row(f"{label} (#{point.index})", *cells)
    return table


def number(value: float, quantum: float) -> str:
    """A cost as a person reads it: whole where it counts, else four significant digits at least to 0.001.

    >>> number(3.0, 1.0), number(41.29117, 1e-6), number(0.01234567, 1e-6)
    ('3', '41.291', '0.01235')
    """
    if quantum >= 1.0:
        return f"{value:.0f}"
    return f"{value:.4g}" if 0 < abs(value) < 0.1 else f"{value:.3f}"


def print_criteria(console: Console | None = None) -> None:
    """Print the registered criteria by group."""
    table = Table(title="Criteria, all minimised")
    for column in ("group", "name", "unit", "adds up by", "requires", "parameters", "what it is"):
        table.add_column(column)
    known: list[type[Criterion]] = sorted(
        registry.criteria.values(), key=lambda c: (list(GROUPS).index(str(c.group)), str(c.name))
    )
    for cls in known:
        table.add_row(
            f"{cls.group} {GROUPS[str(cls.group)]}",
            str(cls.name),
            str(cls.unit),
            str(cls.aggregate),
            ", ".join(cast_words(cls.requires)),
            _fields(cls),
            _first_line(cls),
        )
    (console or Console()).print(table)


def cast_words(words: Any) -> tuple[str, ...]:
    """A declared tuple of words as one."""
    return tuple(str(word) for word in words)


def print_planners(console: Console | None = None) -> None:
    """Print the registered planners and their options."""
    table = Table(title="Planners")
    for column in ("name", "options", "what it finds"):
        table.add_column(column)
    for name, cls in registry.planners.items():
        table.add_row(name, _fields(cls), _first_line(cls))
    (console or Console()).print(table)


def _fields(cls: Any) -> str:
    return ", ".join(f"{field.name}={field.default!r}" for field in dataclasses.fields(cls))


def _first_line(cls: type) -> str:
    return (cls.__doc__ or "").strip().split("\n")[0]
