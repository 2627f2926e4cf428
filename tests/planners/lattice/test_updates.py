"""A changed world: an updated lattice equals one that is built anew, and takes from before what did not change."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.planners.graphs.lattice import LatticeGraph
from hpop.planners.objectives import edge_objectives
from hpop.runtime.limits import Budget
from hpop.search import Graph
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from hpop.world import Person, World
from hpop.world.content.content import Zone

EXTENT = shapely.box(0, 0, 9, 6)
CRITERIA = ("exposure", "clearance", "hall_zones", "turns", "length")
ROUND = hpop.DifferentialDrive(radius=0.25)
LONG = hpop.DifferentialDrive(footprint=((0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.4, -0.2)))
ENDS = (0.5, 0.5, 0.0), (8.5, 5.5, None)


def pieces(rng: np.random.Generator, count: int) -> list[shapely.Polygon]:
    """Boxes of up to a metre, some of them turned."""
    return [
        shapely.affinity.rotate(
            shapely.box(x, y, x + w, y + h), float(rng.choice([0.0, 17.0])), origin=(float(x), float(y))
        )
        for x, y, w, h in rng.uniform((1, 1, 0.1, 0.1), (7, 4.5, 1.0, 1.0), (count, 4))
    ]


def made(shapes: list[shapely.Polygon], people: tuple[Person, ...] = (), zones: tuple[Zone, ...] = ()) -> World:
    return World.from_polygons(shapes, extent=EXTENT).with_content(people=people, zones=zones)


def changed(rng: np.random.Generator, shapes: list[shapely.Polygon], people: tuple[Person, ...]) -> World:
    """Return the world with an obstacle added, removed or moved, a door closed, or a person one step aside."""
    kind = rng.integers(5)
    if kind == 0:
        return made([*shapes, *pieces(rng, 1)], people)
    if kind == 1:
        return made(shapes[1:], people)
    if kind == 2:
        return made([shapely.affinity.translate(shapes[0], *rng.uniform(-0.5, 0.5, 2)), *shapes[1:]], people)
    if kind == 3:
        return made(shapes, people).with_content(people=people, zones=[Zone("keep-out", pieces(rng, 1)[0])])
    return made(shapes).with_content(people=[Person(people[0].x + 0.4, people[0].y - 0.2, 1.0)])


def lattice(world: World, robot: Any, **options: Any) -> tuple[Any, Any]:
    """Return the lattice of a world, and its costs."""
    family = LatticeGraph(anchor="world", **options)
    asked = edge_objectives(hpop.Problem(world, robot, *ENDS, CRITERIA).criteria, "lattice").optimised
    graph = family._lattice(robot, world, world.bounds[:2])
    return graph, graph.graph(asked)


@pytest.mark.seeds(2, of=60)
def test_an_updated_lattice_equals_one_that_is_built_anew(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes, people = pieces(rng, 5), (Person(*rng.uniform((1, 1), (8, 5)), 0.3),)
    robot = (ROUND, LONG)[seed % 2]
    options = {"step": 0.4, "headings": (8, 4, 16)[seed % 3], "corner_cutting": bool(rng.integers(2))}
    before = made(shapes, people)
    lattice(before, robot, **options)
    state = rng.bit_generator.state
    after = changed(rng, shapes, people)
    rng.bit_generator.state = state
    fresh, expected = lattice(changed(rng, shapes, people), robot, **options)
    asked = edge_objectives(hpop.Problem(before, robot, *ENDS, CRITERIA).criteria, "lattice").optimised
    LatticeGraph(anchor="world", **options).update(before, after, robot, asked)
    updated, costs = lattice(after, robot, **options)
    assert updated.counts["edges_rechecked"] < fresh.arcs.heads.size
    assert fresh.counts == {}
    np.testing.assert_array_equal(updated.clear, fresh.clear)
    np.testing.assert_array_equal(updated.free, fresh.free)
    for own, anew in zip(updated.arcs, fresh.arcs, strict=True):
        np.testing.assert_array_equal(own, anew)
        assert own.dtype == anew.dtype
    np.testing.assert_array_equal(costs.costs, expected.costs)


def grid(rng: np.random.Generator) -> Any:
    """Return occupied cells (H, W) of 0.1 m: an office with two doors and some boxes."""
    cells = np.zeros((90, 130), dtype=bool)
    cells[:, 60:62] = cells[44:46, 62:] = True
    cells[20:34, 60:62] = cells[44:46, 90:104] = False
    for row, column in rng.integers((2, 2), (80, 120), (9, 2)):
        cells[row : row + 5, column : column + 6] = True
    return cells


def groups_of_turns(graph: Graph) -> Groups:
    """Return the groups of turns of a graph to which queries add their ends."""
    nothing = np.zeros(0, np.int64)
    extended = graph.extended(graph.nodes, nothing, nothing, np.zeros((0, graph.criteria), np.int64), is_reused=True)
    return Groups.of(extended, Clock(Budget(), None))


@pytest.mark.seeds(1, of=100)
def test_a_lattice_on_changing_cells_equals_one_that_is_built_anew(seed: int) -> None:
    """Boxes come and go, doors close and open, cells far outside change, and people stand in some of the worlds."""
    rng = np.random.default_rng(seed)
    robot = (ROUND, LONG, hpop.DifferentialDrive(radius=0.25, camera_offset=(0.2, 0.0)))[seed % 3]
    keep_out = (None, shapely.box(1, 1, 2, 2))[seed // 2 % 2]
    people = [Person(9.0, 6.0, 0.3)][: seed % 4 == 3]
    options = {"step": 0.5, "headings": (8, 16, 4)[seed % 3], "corner_cutting": bool(rng.integers(2))}
    world = World.from_cells(grid(rng), 0.1, keep_out=keep_out).with_content(people=people)
    asked = edge_objectives(
        hpop.Problem(world, robot, *ENDS, CRITERIA[:1] + CRITERIA[3:]).criteria, "lattice"
    ).optimised

    def graph(world: World) -> tuple[Any, Any]:
        made = LatticeGraph(anchor="world", **options)._lattice(robot, world, world.bounds[:2])
        return made, made.graph(asked)

    groups_of_turns(graph(world)[1])
    for _ in range(4):
        row, column, height, width = (
            (20, 60, 14, 2),
            (44, 90, 2, 14),
            (0, 128, 2, 2),
            (*rng.integers((0, 0), (86, 120)), *rng.integers(1, 5, 2)),
        )[rng.integers(4)]
        part = np.full((height, width), rng.random() < 0.6)
        after = world.updated(part, at=(int(column), int(row)))
        LatticeGraph(anchor="world", **options).update(world, after, robot, asked)
        world = after
    assert world.raster is not None
    anew = World.from_cells(world.raster.cells, 0.1, keep_out=keep_out).with_content(people=people)
    (updated, costs), (fresh, expected) = graph(world), graph(anew)
    assert "edges_rechecked" in updated.counts
    np.testing.assert_array_equal(updated.free, fresh.free)
    for own, new in zip(updated.arcs, fresh.arcs, strict=True):
        np.testing.assert_array_equal(own, new)
        assert own.dtype == new.dtype
    np.testing.assert_array_equal(costs.costs, expected.costs)
    have_equal_groups(costs, expected)


def have_equal_groups(graph: Graph, other: Graph) -> None:
    groups, expected = groups_of_turns(graph).unshared(), groups_of_turns(other).unshared()
    for field in fields(groups):
        np.testing.assert_array_equal(getattr(groups, field.name), getattr(expected, field.name), field.name)


def test_several_changes_of_one_lattice_leave_each_other_alone() -> None:
    world, family = World.from_cells(grid(np.random.default_rng(3)), 0.1), LatticeGraph(anchor="world", step=0.5)
    asked = edge_objectives(hpop.Problem(world, ROUND, *ENDS, ("exposure", "turns")).criteria, "lattice").optimised

    def graph(world: World) -> Graph:
        costs: Graph = family._lattice(ROUND, world, world.bounds[:2]).graph(asked)
        return costs

    def changed(world: World, at: tuple[int, int]) -> World:
        after = world.updated(np.ones((2, 3), bool), at=at)
        family.update(world, after, ROUND, asked)
        return after

    groups_of_turns(graph(world))
    first = changed(world, (20, 20))
    second = [changed(first, at) for at in ((100, 20), (60, 70), (20, 60))]
    for each in second:
        assert each.raster is not None
        have_equal_groups(graph(each), graph(World.from_cells(each.raster.cells, 0.1)))


def test_fronts_on_changing_cells_are_those_of_a_fresh_plan() -> None:
    rng = np.random.default_rng(3)
    cells = grid(rng)
    many = hpop.Planning(
        World.from_cells(cells, 0.1), ROUND, ["exposure", "turns", "length"], {"lattice": {"step": 0.5}}
    )
    start, goal = (0.3, 0.3, 0.0), (12.4, 8.6, None)
    many.solve(start, goal)
    for part, at in ((np.ones((3, 4), bool), (30, 40)), (np.ones((14, 2), bool), (60, 20)), ([[100, -1]], (5, 60))):
        many = many.updated(many.world.updated(part, at))
        again = World.from_cells(many.world.raster.cells, 0.1)  # type: ignore[union-attr]
        expected = hpop.Planning(again, ROUND, many.criteria, {"lattice": {"step": 0.5}}).solve(start, goal)
        found = many.solve(start, goal)
        assert found.costs.tolist() == expected.costs.tolist()
        assert found.runs[0]["labels_generated"] == expected.runs[0]["labels_generated"]
        assert found.certificate == expected.certificate
        many = many.updated(World.from_occupancy_grid(np.where(again.raster.cells, 100, 0), 0.1))  # type: ignore[union-attr]
        assert many.solve(start, goal).runs[0]["edges_rechecked"] == 0


@pytest.mark.parametrize("planner", [{"lattice": {"step": 0.5}}, {"roadmap": {"samples": 60}}], ids=str)
@pytest.mark.seeds(1, of=3)
def test_fronts_in_a_changed_world_are_those_of_a_fresh_plan(planner: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = pieces(rng, 4)
    criteria = ["exposure", "turns", "length"]
    many = hpop.Planning(made(shapes), ROUND, criteria, planner)
    many.solve(*ENDS)
    more = [*shapes, shapely.box(0.1, 4.5, 0.8, 5.0)]
    found = many.updated(made(more)).solve(*ENDS)
    expected = hpop.Planning(made(more), ROUND, criteria, planner).solve(*ENDS)
    assert found.costs.tolist() == expected.costs.tolist()


def test_few_arcs_are_checked_again_after_a_door_closes() -> None:
    shapes = [shapely.box(4, 0, 4.2, 2.5), shapely.box(4, 3.5, 4.2, 6)]
    many = hpop.Planning(made(shapes), ROUND, ["turns", "exposure"], {"lattice": {"step": 0.25}})
    before = many.solve(*ENDS).runs[0]
    door = Zone("keep-out", shapely.box(4, 3.0, 4.2, 3.5), name="door")
    closed = many.updated(many.world.with_content(zones=[door])).solve(*ENDS).runs[0]
    assert "edges_rechecked" not in before
    assert 0 < closed["edges_rechecked"] < before["edges"] / 10


@pytest.mark.usefixtures("registered_as_before")
def test_a_criterion_of_a_user_that_reads_the_world_in_few_places_is_costed_anew() -> None:
    """Each person in the world makes arcs from one position dearer."""

    @hpop.criterion("tolled", group="P", unit="m", aggregate="sum", requires=("base",))
    @dataclass(frozen=True)
    class Tolled:
        """Length, counted once more for each person where a motion begins at one position."""

        def cost(self, m: Any) -> Any:
            within = np.hypot(m.start.x - 2.0, m.start.y - 3.0) < 0.1
            return m.base.length * (1 + len(m.world.content.people) * within) if within.any() else m.base.length

    def graph(world: World, before: World | None) -> Any:
        family = LatticeGraph(anchor="world", step=0.25)
        if before is not None:
            graph(before, None)
            family.update(before, world, ROUND, [Tolled()])
        return family._lattice(ROUND, world, world.bounds[:2]).graph([Tolled()])

    empty = made([shapely.box(4, 0, 4.2, 2.5), shapely.box(4, 3.5, 4.2, 6)])
    updated = graph(empty.with_content(people=[Person(8.0, 1.0, 0.3)]), empty)
    fresh = graph(made([shapely.box(4, 0, 4.2, 2.5), shapely.box(4, 3.5, 4.2, 6)], (Person(8.0, 1.0, 0.3),)), None)
    np.testing.assert_array_equal(updated.costs, fresh.costs)
