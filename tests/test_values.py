"""Values stay what they are: an operation that gives another value does not change the one that it was asked of."""

from __future__ import annotations

import numpy as np
import shapely

from hpop import DifferentialDrive, Problem, World
from hpop.drive.closings import Closing
from hpop.drive.drive_graph import DriveGraph
from hpop.planners import Lattice
from hpop.planners.objectives import edge_objectives

ROOM = World.from_polygons([shapely.box(2.2, 1.2, 2.8, 2.8)], extent=shapely.box(0, 0, 5, 4))
DOOR = shapely.box(2.2, 2.8, 2.8, 4.0)


def problem_in(world: World) -> Problem:
    return Problem(world, DifferentialDrive(radius=0.2), (0.5, 2.0, 0.0), (4.5, 2.0, 0.0), ["turns", "length"])


def test_a_world_with_a_note_of_its_file_is_another_world_on_another_ground():
    noted = ROOM.read_from({"kind": "geojson", "path": "/maps/room.geojson"})
    assert (noted.source, noted.ground.path) == (
        {"kind": "geojson", "path": "/maps/room.geojson"},
        "/maps/room.geojson",
    )
    assert (ROOM.source, ROOM.ground.path) == (None, None)
    assert noted.ground.obstacles is ROOM.ground.obstacles


def test_states_costed_in_another_world_leave_the_states_in_their_own():
    problem = problem_in(ROOM)
    states = Lattice(step=0.5).lattice(problem)
    before = states.graph(problem.criteria).costs
    other = states.costed_in(ROOM.with_content())
    assert other is not states
    assert states.world is problem.world
    assert np.array_equal(other.graph(problem.criteria).costs, before)


def test_a_door_that_closes_leaves_earlier_paths_of_a_drive_as_they_were():
    problem = problem_in(ROOM)
    states = Lattice(step=0.5).lattice(problem)
    ways = DriveGraph.laid_out("lattice", states, problem, edge_objectives(problem.criteria, "lattice"))
    start, prepared = ways.query.start, ways.prepared()
    before = ways.remaining_paths(prepared, start, [], None).costs
    closed = ways.changed(problem.world, [Closing(DOOR)], people=False)
    assert closed.closed.any()
    assert not ways.closed.any()
    assert np.array_equal(ways.remaining_paths(prepared, start, [], None).costs, before)
    fresh = closed.remaining_paths(closed.prepared(), start, [], None).costs
    assert np.array_equal(closed.remaining_paths(closed.prepared(ways, prepared), start, [], None).costs, fresh)
