"""Explanations: the best paths through a place are those of an enumeration, and sentences say what the numbers say."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString

import hpop
from hpop.errors import QueryError
from hpop.problems.verify import verify

Walk = tuple[tuple[int, int], ...]
ROBOT = hpop.DifferentialDrive(radius=0.2)
LONGEST = 9  # moves of an enumerated walk
SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1))


@cache
def drawn(seed: int) -> tuple[hpop.Problem, set[tuple[int, int]], tuple[int, int]]:
    """Return a problem on a grid of 4 x 3 positions, of which some are blocked; its free positions, and its goal."""
    rng = np.random.default_rng(seed)
    cells = [(x, y) for x in range(4) for y in range(3)]
    blocked = {cells[i] for i in rng.choice(len(cells), 2, replace=False).tolist()} - {(0, 1), (3, 1)}
    boxes = [shapely.box(x - 0.4, y - 0.4, x + 0.4, y + 0.4) for x, y in sorted(blocked)]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-0.5, -0.5, 3.5, 2.5))
    problem = hpop.Problem(world, ROBOT, (0, 1, 0), (3, 1, None), ["turns", "length", "rotation"])
    return problem, set(cells) - blocked, (3, 1)


def walks(free: set[tuple[int, int]], goal: tuple[int, int]) -> Iterator[Walk]:
    """Yield all walks of at most `LONGEST` moves from (0, 1) to the goal, also those that come back to a position."""
    stack: list[Walk] = [((0, 1),)]
    while stack:
        walk = stack.pop()
        if walk[-1] == goal:
            yield walk
        if len(walk) <= LONGEST:
            x, y = walk[-1]
            stack += [(*walk, (x + dx, y + dy)) for dx, dy in SIDES if (x + dx, y + dy) in free]


def paid(walk: Walk) -> tuple[float, float, float]:
    """Return turns, length and rotation of a walk that begins with heading 0."""
    headings = [0, *(SIDES.index((b[0] - a[0], b[1] - a[1])) for a, b in pairwise(walk))]
    quarters = [min((b - a) % 4, (a - b) % 4) for a, b in pairwise(headings)]
    return float(np.count_nonzero(quarters)), float(len(walk) - 1), sum(quarters) * np.pi / 2


def undominated(costs: set[tuple[float, ...]]) -> set[tuple[float, ...]]:
    return {c for c in costs if not any(o != c and all(a <= b for a, b in zip(o, c, strict=True)) for o in costs)}


def rounded(costs: Any) -> set[tuple[float, ...]]:
    return {tuple(row) for row in np.round(costs, 6).tolist()}


def passes(walk: Walk, place: shapely.Geometry) -> bool:
    """Return whether a walk comes to a region, or crosses a line an odd number of times."""
    if isinstance(place, LineString):
        pairs = pairwise(walk)
        return sum(LineString(pair).intersects(place) for pair in pairs) % 2 == 1
    return shapely.MultiPoint(walk).union(LineString(walk) if len(walk) > 1 else shapely.Point()).intersects(place)


def place_of(seed: int) -> shapely.Geometry:
    """Return a line between positions of the grid, or a region of less than a cell."""
    rng = np.random.default_rng(seed + 100)
    if seed % 2:
        x, (low, high) = (
            rng.integers(0, 3) + rng.choice([0.3, 0.6]),
            sorted(rng.choice([-0.45, 0.45, 1.45, 2.45], 2, replace=False)),
        )
        return LineString([(x, low), (x + 0.05, high)])
    x, y = rng.uniform(0.0, 3.0), rng.uniform(0.0, 2.0)
    return shapely.box(x - 0.3, y - 0.3, x + 0.3, y + 0.3)


@pytest.mark.parametrize("seed", range(24))
def test_the_best_paths_through_a_place_are_those_of_all_walks(seed: int) -> None:
    problem, free, goal = drawn(seed // 2)
    place = place_of(seed)
    front = problem.solve("lattice", step=1.0, headings=4)
    every = {paid(walk): None for walk in walks(free, goal)}
    if not every:
        assert not len(front)
        return
    assert rounded(front.costs) == rounded(list(undominated(set(every))))
    able = undominated({paid(walk) for walk in walks(free, goal) if passes(walk, place)})
    solid = shapely.union_all([obstacle.polygon for obstacle in problem.world.obstacles])
    if problem.world.extent.difference(solid).intersection(place).is_empty:
        with pytest.raises(QueryError, match="wholly blocked"):
            front.why_not(place, problem=problem)
        return
    answer = front.why_not(place, problem=problem)
    assert answer.exact
    assert rounded(answer.front.costs) == rounded([*able]) if able else answer.best is None
    assert verify(problem, answer.front) == []
    if answer.best is None:
        assert answer.sentence.startswith(f"No path passes {answer.through}: ")
        return
    assert {i for i, row in enumerate(front.costs) if rounded([row]) <= rounded([*able])} == set(answer.rows)
    assert answer.row is not None
    told, compared = (problem.evaluate(t) for t in (answer.best.trajectory, front[answer.row].trajectory))
    assert answer.numbers == pytest.approx({name: told[name] - compared[name] for name in front.names})
    if answer.rows:
        assert "on the front" in answer.sentence
    else:
        assert min(answer.numbers.values()) >= -1e-9
        assert answer.sentence.endswith(f"than row {answer.row}; it is never better.")
