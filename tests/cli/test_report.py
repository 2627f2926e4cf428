"""Printed tables: a readable choice of a long front, and planned beside executed costs."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

import hpop
from hpop.cli.report import (
    MOST_ROWS,
    MostRows,
    contributions,
    marks,
    number,
    print_contributions,
    print_front,
    shown_rows,
)
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory

ROBOT = hpop.DifferentialDrive(radius=0.2)
WORLD = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 5, 4))
STAY = Trajectory.from_poses(ROBOT, [(1, 1, 0)])


def front_of(costs: list[list[float]], names: tuple[str, ...] = ("turns", "length"), **more: object) -> hpop.Front:
    """Return a front with these costs, of trajectories that stay in place."""
    declared = {"units": ["1" if n == "turns" else "m" for n in names], "quanta": [1e-6] * len(names)}
    return hpop.Front.of(
        costs, [STAY] * len(costs), names=names, status="complete", certificate="as given", **(declared | more)
    )  # type: ignore[arg-type]


def arc(n: int) -> hpop.Front:
    """Return a front of n points on a quarter circle."""
    angles = np.linspace(0, math.pi / 2, n)
    return front_of(np.column_stack([1 - np.sin(angles), 1 - np.cos(angles)]).tolist())


def printed(front: hpop.Front, width: int = 80, **more: object) -> str:
    asked = Problem(WORLD, ROBOT, (1, 1, 0), (4, 1, 0), ["turns", "length"])
    console = Console(file=io.StringIO(), width=width)
    print_front(asked, front, console, **more)  # type: ignore[arg-type]
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_a_cost_whose_name_reads_like_its_opposite_says_what_it_measures() -> None:
    """The table adds what is measured; the cost keeps its registered name, which `--at-most` and `--least` take."""
    costs, names = [[0.0, 2.0, 1.0]], ("clearance", "passing_distance", "length")
    text = printed(front_of(costs, names, groups=["R", "C", "C"]))
    assert text.count("(shortfall, m)") == 2
    also = {"reported": [[0.5]], "reported_names": ("openness",), "reported_units": ("1",)}
    assert "(unseen share)" in printed(front_of(costs, names, groups=["R", "C", "C"], **also))
    assert "passing_distance" in text
    assert "shortfall" not in printed(front_of(costs, names))  # a table of costs from elsewhere has no groups


def front_part(text: str) -> str:
    return next(part for part in text.split("\n\n") if part.strip().startswith("The front"))


def table_rows(text: str) -> list[list[str]]:
    """Cells of the rows of the table of the front."""
    lines = front_part(text).splitlines()
    below = next(i for i, line in enumerate(lines) if set(line.strip()) == {"─"}) + 1
    return [line.split() for line in lines[below:] if line.split()[0].isdigit() and " of " not in line]


def test_a_short_front_is_shown_whole() -> None:
    text = printed(arc(MOST_ROWS))
    assert [row[0] for row in table_rows(text)] == [str(i) for i in range(MOST_ROWS)]
    assert "trajectories shown" not in text


def test_a_long_front_is_shown_by_a_choice_and_one_line_says_where_the_rest_is() -> None:
    text = printed(arc(1000), saved=Path("here/front.json"))
    assert len(table_rows(text)) == MOST_ROWS
    assert "..." not in text
    assert f"{MOST_ROWS} of 1,000 trajectories shown" in text
    assert "here/front.json" in text


def test_the_choice_is_spread_over_the_front() -> None:
    """On an arc, no two neighbours shown are farther apart than the farthest-point rule allows: twice the optimum."""
    front = arc(1000)
    rows = shown_rows(front, MostRows(MOST_ROWS))
    apart = np.linalg.norm(np.diff(front.costs[rows], axis=0), axis=1)
    assert apart.max() <= 2 * (math.pi / 2) / (MOST_ROWS - 1)


@given(st.lists(st.tuples(*[st.integers(0, 9)] * 3), min_size=1, max_size=60), st.integers(1, 12))
def test_marked_rows_are_always_shown_and_rows_are_in_order(points: list[tuple[int, ...]], most: int) -> None:
    front = front_of([list(map(float, p)) for p in points], names=("a", "b", "c"))
    rows = shown_rows(front, MostRows(most))
    assert rows == sorted(set(rows))
    assert set(marks(front)) <= set(rows) or len(rows) == len(front)
    assert len(rows) <= max(most, len(marks(front)))
    assert len(rows) >= min(most, len(front))


def test_the_knee_and_the_best_of_each_criterion_are_marked() -> None:
    front = front_of([[0.0, 10.0], [1.0, 2.0], [5.0, 1.5], [9.0, 1.0]])
    assert marks(front) == {0: ["least turns"], 1: ["knee"], 3: ["least length"]}
    rows = table_rows(printed(front))
    assert [row[3:] for row in rows] == [["least", "turns"], ["knee"], [], ["least", "length"]]


def test_costs_are_shown_with_their_units() -> None:
    text = printed(front_of([[3.0, 41.29117]], quanta=[1.0, 1e-6]))
    assert table_rows(text)[0][:3] == ["0", "3", "41.291"]
    head = front_part(text).split("─")[0]
    assert "turns" in head
    assert "(m)" in head
    assert "(1)" not in head


def test_no_two_rows_look_as_if_one_dominated_the_other() -> None:
    """Lengths that differ in the fifth decimal; those that differ by less than a quantum are the same."""
    front = front_of([[1.0, 5.00003, 2.0], [2.0, 5.00002, 2.0], [3.0, 5.00001, 2.0 + 1e-8]], names=("a", "b", "c"))
    rows = table_rows(printed(front))
    assert [row[2:4] for row in rows] == [["5.00003", "2.000"], ["5.00002", "2.000"], ["5.00001", "2.000"]]


@pytest.mark.parametrize("k", [2, 3, 4, 6])
def test_no_mark_and_no_cost_is_cut_at_80_columns(k: int) -> None:
    names = ("exposure", "turns", "length", "duration", "rotation", "clearance")[:k]
    costs = (12345.678 + np.eye(k) * -1.5).tolist()
    text = printed(front_of(costs, names=names))
    assert "…" not in text
    assert all(f"least {name}" in text for name in names)
    assert text.count("12345.678") == k * (k - 1)
    if k <= 4:
        assert max(map(len, text.splitlines())) <= 80


def test_planned_costs_stand_beside_executed_ones() -> None:
    """4 m: planned at 1 m/s in 4 s, executed from rest to rest with 1 m/s² in 5 s."""
    asked = Problem(WORLD, ROBOT, (0.5, 3, 0), (4.5, 3, 0), ["length", "duration"])
    front = asked.solve(step=1.0)
    console = Console(file=io.StringIO(), width=80)
    print_front(asked, front, console)
    rows = [line.split() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    assert [row[1:4] for row in rows if "planned" in row[1:2]] == [["planned", "4.000", "4.000"]]
    assert [row for row in rows if "executed" in row[:1]] == [["executed", "4.000", "5.000"]]


def test_executed_costs_have_the_duration_and_the_integral_that_was_minimised() -> None:
    """4 m past an obstacle: the mean is the integral divided by the duration, as planned and as executed."""
    problem = Problem(WORLD, ROBOT, (0.5, 3, 0), (4.5, 3, 0), ["obstruction"])
    console = Console(file=io.StringIO(), width=80)
    print_front(problem, problem.solve(step=1.0), console)
    rows = [line.split() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    planned = next([float(cell) for cell in row[2:5]] for row in rows if row[1:2] == ["planned"])
    executed = next([float(cell) for cell in row[1:4]] for row in rows if row[:1] == ["executed"])
    assert [planned[2], executed[2]] == [4.0, 5.0]  # at 1 m/s; from rest to rest with 1 m/s²
    for mean, integral, duration in (planned, executed):
        assert integral / duration == pytest.approx(mean, abs=2e-4)  # three decimals of the integral
        assert mean > 0


def test_an_empty_front_prints_its_notes_and_its_status() -> None:
    empty = front_of([], runs=[{"notes": ["no path: a wall"], "planner": "lattice", "search_seconds": 1.5}])
    text = printed(empty, verbose=True)
    assert "note: no path: a wall" in text
    assert "lattice: search 1.50 s" in text
    assert "0 trajectories; status: complete" in text


def test_names_from_a_file_are_printed_as_they_are() -> None:
    runs = [{"notes": ["[bold]"], "planner": "[/x]", "tried": 1}]
    text = printed(front_of([[1.0]], names=("[/red]",), runs=runs), verbose=True)
    assert "[/red]" in text
    assert "note: [bold]" in text
    assert "[/x]: tried 1" in text


@pytest.mark.parametrize(
    ("value", "quantum", "text"),
    [(3.0, 1.0, "3"), (0.0, 1e-6, "0"), (41.29117, 1e-6, "41.291"), (0.01234567, 1e-6, "0.01235")],
)
def test_numbers_are_written_for_people(value: float, quantum: float, text: str) -> None:
    assert number(value, quantum) == text


# What several planners added


def by(planner: str, costs: list[list[float]], **more: object) -> hpop.Front:
    """Return a front of one planner, with trajectories of its own."""
    stay = [Trajectory.from_poses(ROBOT, [(1, 1, 0)]) for _ in costs]
    return hpop.Front.of(
        costs,
        stay,
        **({"names": ("a", "b"), "units": ("1", "m"), "quanta": (1e-6, 1e-6)} | more),  # type: ignore[arg-type]
        status="complete",
        certificate="as given",
        provenance=[{"planner": planner}] * len(costs),
    )


def last(fronts: list[hpop.Front]) -> list[list[int]]:
    return fronts[-1].integers.tolist()


def test_the_hypervolume_before_and_after_each_planner_by_hand() -> None:
    """Ideal (0, 0), nadir (10, 2): scaled, the ends cover .21 of [0, 1.1]², with the middle .46."""
    ends, middle = by("first", [[0.0, 2.0], [10.0, 0.0]]), by("second", [[5.0, 1.0]])
    first, second = contributions(["first", "second"], [ends, ends | middle])
    assert (first.planner, first.points, first.found) == ("first", 2, 2)
    assert (second.planner, second.points, second.found) == ("second", 1, 3)
    assert (first.before, first.after, second.before, second.after) == pytest.approx((0, 0.21, 0.21, 0.46))


@given(st.lists(st.lists(st.tuples(*[st.integers(0, 9)] * 3), min_size=1, max_size=6), min_size=1, max_size=4))
def test_the_front_never_gets_worse_and_every_point_comes_from_somewhere(found: list[list[tuple[int, ...]]]) -> None:
    names = [f"p{i}" for i in range(len(found))]
    declared = {"names": ("a", "b", "c"), "units": ("1",) * 3, "quanta": (1.0,) * 3}
    fronts: list[hpop.Front] = []
    for name, points in zip(names, found, strict=True):
        new = by(name, [list(map(float, p)) for p in points], **declared)
        fronts.append(fronts[-1] | new if fronts else new)
    rows = contributions(names, fronts)
    assert all(row.after >= row.before - 1e-12 for row in rows)
    assert rows[-1].after > 0
    first = [next(i for i, front in enumerate(fronts) if row in front.integers.tolist()) for row in last(fronts)]
    assert [row.points for row in rows] == [first.count(i) for i in range(len(names))]


def test_a_point_found_again_is_the_merit_of_the_first() -> None:
    """The front keeps, of equal points, the one whose provenance is first in the alphabet: here the second's."""
    early, late = by("z", [[1.0, 1.0], [9.0, 0.0]]), by("a", [[1.0, 1.0], [0.0, 5.0]])
    assert [row.points for row in contributions(["z", "a"], [early, early | late])] == [2, 1]


def test_a_run_that_counted_nothing_has_no_line_of_counts() -> None:
    runs = [{"notes": [], "planner": "silent"}, {"notes": [], "planner": "busy", "programs": 2}]
    text = printed(front_of([], runs=runs), verbose=True)
    assert "busy: programs 2" in text
    assert "silent" not in text


def test_a_planner_that_runs_twice_is_told_apart() -> None:
    coarse, fine = by("same", [[1.0, 1.0]]), by("same", [[0.0, 2.0], [2.0, 0.0]])
    rows = contributions(["same", "same"], [coarse, coarse | fine])
    assert [row.points for row in rows] == [1, 2]


def test_the_table_has_the_scale_of_all_its_fronts() -> None:
    """Costs from -5 to 10 and from -1 to 2; scaled (1/3, 1), (2/3, 2/3), (1, 1/3), then (0, 2/3) and (2/3, 0)."""
    few, more = by("first", [[0.0, 2.0], [5.0, 1.0], [10.0, 0.0]]), by("second", [[5.0, -1.0], [-5.0, 1.0]])
    first, second = contributions(["first", "second"], [few, few | more])
    assert first.after == pytest.approx(0.1 / 3 + (1.1 - 2 / 3) / 3 + 0.1 * (1.1 - 1 / 3))
    assert second.after == pytest.approx(2 / 3 * (1.1 - 2 / 3) + (1.1 - 2 / 3) * 1.1)


def test_a_criterion_that_became_constant_still_counts() -> None:
    """A cost that is the same all over the fronts is shifted, not scaled."""
    worse, best = by("first", [[1.0, 4.0]]), by("second", [[1.0, 2.0]])
    first, second = contributions(["first", "second"], [worse, worse | best])
    assert (first.points, second.points) == (0, 1)
    assert first.after == pytest.approx(1.1 * 0.1)
    assert second.after == pytest.approx(1.1 * 1.1)


def test_no_scale_is_made_of_rounding() -> None:
    """The first cost is .3 everywhere, the others are scaled (0, 1), (1, 0) and (.5, .25)."""
    declared = {"names": ("a", "b", "c"), "units": ("1",) * 3, "quanta": (1e-6,) * 3}
    wide = by("first", [[0.3, 0.0, 2.0], [0.1 + 0.2, 1.0, 0.0]], **declared)
    best = by("second", [[0.3, 0.5, 0.5]], **declared)
    _, second = contributions(["first", "second"], [wide, wide | best])
    assert second.after == pytest.approx(1.1 * (0.5 * 0.1 + 0.5 * 0.85 + 0.1 * 1.1))


def test_what_is_printed_of_several_planners() -> None:
    ends, middle = by("first", [[0.0, 2.0], [10.0, 0.0]]), by("[second]", [[5.0, 1.0]])
    console = Console(file=io.StringIO(), width=80)
    print_contributions(["first", "[second]", "third"], [ends, ends | middle], console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    rows = [line.split() for line in text.splitlines()]
    assert ["first", "2", "0.0000", "0.2100", "2"] in rows
    assert ["[second]", "1", "0.2100", "0.4600", "3"] in rows
    assert "third was not run" in text
    silent = Console(file=io.StringIO())
    print_contributions(["first"], [ends], silent)
    assert silent.file.getvalue() == ""  # type: ignore[attr-defined]


def test_a_hypervolume_that_would_take_minutes_is_left_out() -> None:
    rng = np.random.default_rng(0)
    points = rng.random((300, 7))
    points /= np.linalg.norm(points, axis=1)[:, None]
    names = tuple("abcdefg")
    front = by("one", points.tolist(), names=names, units=("1",) * 7, quanta=(1e-6,) * 7)
    console = Console(file=io.StringIO(), width=80)
    print_contributions(["one", "two"], [front, front | front], console)
    assert [line.split()[:4] for line in console.file.getvalue().splitlines() if line.startswith("one")] == [  # type: ignore[attr-defined]
        ["one", str(len(front)), "0.0000", "-"]
    ]


def test_a_front_of_several_planners_says_who_found_what() -> None:
    both = by("first", [[0.0, 2.0], [10.0, 0.0]]) | by("second", [[5.0, 1.0]])
    assert "planned by: first 2, second 1" in printed(front_of(both.costs.tolist(), provenance=both.provenance))
    assert "planned by" not in printed(arc(3))
