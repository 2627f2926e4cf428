"""The any-angle planner: straight where it can, taut where it must, nowhere worse than the lattice it starts from."""

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
import shapely

from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, QueryError
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import AnyAngle, Lattice
from hpop.planners.judgement import is_free, judge
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.world import World
from hpop.world.content.content import Person

ROBOT = DifferentialDrive(radius=0.15, camera_height=0.4)
LONG = DifferentialDrive(footprint=((0.4, 0.12), (-0.2, 0.12), (-0.2, -0.12), (0.4, -0.12)), camera_height=0.4)
ROOM = World.from_polygons([], extent=shapely.box(0, 0, 10, 8))
CRITERIA = [{"exposure": {"radius": 0.5}}, "turns", "length"]
STEP = 0.5


def cluttered(seed, goal, robot=ROBOT, criteria=CRITERIA):
    """Random boxes between a start and a goal that are free; the start is on the lattice."""
    rng = np.random.default_rng(seed)
    while True:
        corners, sizes = rng.uniform((0.3, 0.3), (4.4, 3.4), (14, 2)), rng.uniform(0.1, 0.5, (14, 2))
        boxes = [shapely.box(*c, *(c + s)) for c, s in zip(corners, sizes, strict=True)]
        world = World.from_polygons(boxes, extent=shapely.box(0, 0, 4.9, 3.8))
        if (world.clearance(np.array([0.45, goal[0]]), np.array([0.4, goal[1]])) > 0.3).all():
            return Problem(world, robot, (0.45, 0.4, 0.0), goal, criteria)


ON_THE_LATTICE, OFF_THE_LATTICE = (0.45 + 8 * STEP, 0.4 + 6 * STEP), (4.37, 3.28)
SEEDS = (0, 1, 3, 5)


@pytest.mark.cases("0-round-0.0-8", "0-round-None-16", "0-long-None-8")
@pytest.mark.parametrize(("goal_yaw", "headings"), [(0.0, 8), (None, 8), (None, 4), (None, 16)])
@pytest.mark.seeds(1, of=SEEDS)
@pytest.mark.parametrize("robot", [ROBOT, LONG], ids=["round", "long"])
def test_nothing_on_the_lattice_is_better(seed, goal_yaw, headings, robot):
    asked = cluttered(seed, (*ON_THE_LATTICE, goal_yaw), robot)
    lattice = Lattice(STEP, headings).solve(asked)
    found = AnyAngle(STEP, headings).solve(asked)
    assert found.status is lattice.status
    exact = trajectory_costs(found.objectives, lattice.trajectories, asked.world)
    # The lattice's sums are rounded a step, and both are integrated by panels that begin elsewhere.
    slack = 1e-4 * exact.max(axis=0, initial=0.0) + 1e-5
    for row in exact:
        assert (found.planned <= row + slack).all(axis=1).any()


@pytest.mark.proof
def test_the_compared_lattices_have_fronts_and_most_of_their_points_are_dominated():
    shares, sizes = [], []
    for seed in SEEDS:
        asked = cluttered(seed, (*ON_THE_LATTICE, None))
        lattice, found = asked.solve("lattice", step=STEP), asked.solve("any-angle", step=STEP)
        sizes.append(len(lattice))
        better = [
            ((found.costs <= row).all(axis=1) & (found.costs < row - 1e-3).any(axis=1)).any() for row in lattice.costs
        ]
        shares.append(np.mean(better) if better else 0.0)
    assert max(sizes) >= 5
    assert sum(size >= 2 for size in sizes) >= 3
    assert max(shares) > 0.5


@pytest.mark.cases("round-goal0", "round-goal1", "long-goal2")
@pytest.mark.parametrize("goal", [(*ON_THE_LATTICE, 0.0), (*OFF_THE_LATTICE, None), (*OFF_THE_LATTICE, -np.pi / 2)])
@pytest.mark.parametrize("robot", [ROBOT, LONG], ids=["round", "long"])
def test_what_is_found_holds_what_it_claims_and_ends_at_the_goal_itself(goal, robot):
    asked = cluttered(3, goal, robot, [*CRITERIA, {"obstruction": {"radius": 0.5}}, "clearance"])
    found = AnyAngle(step=STEP).solve(asked)
    assert found.status is Status.COMPLETE
    assert len(found.trajectories) >= (2 if robot is ROBOT else 1)
    assert found.stats["dropped"] == {}
    assert verify(asked, asked.front(found)) == []  # collisions by fcl, ends, costs
    again = trajectory_costs(found.objectives, found.trajectories, asked.world)
    assert (np.abs(again - found.planned) <= found.tolerance + 1e-9).all()
    for trajectory in found.trajectories:
        assert is_free(asked, trajectory)
        assert (trajectory.states.x[-1], trajectory.states.y[-1]) == goal[:2]


@pytest.mark.parametrize("goal", [(6.0, 4.0), (7.13, 3.37), (1.6, 7.1), (9.4, 1.0)])
def test_on_an_empty_map_the_shortest_path_is_straight(goal):
    asked = Problem(ROOM, ROBOT, (1.0, 1.0, 0.0), (*goal, None), ["turns", "length"])
    found = AnyAngle(step=0.25).solve(asked)
    along_x = goal[1] == 1.0
    best = found.planned[np.argmin(found.planned[:, 1])]
    assert best.tolist() == pytest.approx([0.0 if along_x else 1.0, math.dist((1.0, 1.0), goal)], abs=1e-6)


@pytest.mark.parametrize("top", [3.9, 4.9, 5.9])
def test_about_a_wall_the_shortest_path_is_taut_over_its_corner(top):
    # The lattice has a position 0.1 m above the wall's top, and every path passes over it.
    wall = World.from_polygons([shapely.box(4.0, 0.0, 4.0 + 1e-3, top)], extent=shapely.box(0, 0, 10, 8))
    robot = DifferentialDrive(radius=0.05, camera_height=0.4, mast_radius=0.01)
    start, goal = (1.0, 1.0), (9.0, 2.0)
    found = AnyAngle(step=1.0).solve(Problem(wall, robot, (*start, 0.0), (*goal, None), ["length"]))

    def over(height):
        return math.dist(start, (4.0, height)) + math.dist((4.0, height), goal)

    assert over(top) < found.planned[:, 0].min() <= over(top + 0.1) + found.tolerance[:, 0].max()


def turning_points(trajectory):
    """Positions at which a trajectory's heading changes, or where it ends."""
    s = trajectory.states
    yaw = np.append(s.yaw, np.nan)
    return {(s.x[i], s.y[i]) for i in range(len(trajectory) + 1) if yaw[i] != yaw[i + 1]}


def bending_points(trajectory, solid, radius):
    """Positions at which a trajectory of a round robot still bends when it is pulled taut, one after the other."""
    points = list(dict.fromkeys(zip(trajectory.states.x.tolist(), trajectory.states.y.tolist(), strict=True)))
    bends, last = set(), 0
    for i in range(2, len(points)):
        if shapely.LineString([points[last], points[i]]).distance(solid) < radius:
            last = i - 1
            bends.add(points[last])
    return bends


def corners_of(asked, first):
    """Each corner that the roadmap of a lattice's paths should have, with how many of them share it."""
    solid = shapely.union_all([o.polygon for o in asked.world.obstacles] + [asked.world.extent.exterior])
    found = Counter()
    for t in first.trajectories:
        found.update(turning_points(t) | bending_points(t, solid, asked.model.radius))
    return {point: count for point, count in found.items() if point not in (asked.start[:2], asked.goal[:2])}


@pytest.mark.parametrize("goal", [ON_THE_LATTICE, OFF_THE_LATTICE])
def test_the_positions_are_the_corners_of_the_lattice_paths_with_start_and_goal(goal):
    asked = cluttered(5, (*goal, None))
    first = Lattice(step=STEP).solve(asked)
    roadmap, notes = AnyAngle(step=STEP).roadmap(asked, first)
    assert notes == ()
    points = [tuple(point) for point in roadmap.positions.tolist()]
    assert points[:2] == [asked.start[:2], asked.goal[:2]]
    assert len(set(points)) == len(points)
    assert set(points[2:]) == set(corners_of(asked, first))
    count = len(points)
    assert {frozenset(link) for link in roadmap.links.tolist()} == {
        frozenset((i, j)) for i in range(count) for j in range(i)
    }


def test_of_too_many_corners_those_that_most_paths_share_are_taken_and_a_note_says_so():
    asked = cluttered(5, (*ON_THE_LATTICE, None))
    first = Lattice(step=STEP).solve(asked)
    shared = corners_of(asked, first)
    roadmap, notes = AnyAngle(step=STEP, max_positions=3).roadmap(asked, first)
    kept = {tuple(point) for point in roadmap.positions[2:].tolist()}
    assert len(kept) == 3 < len(shared)
    assert min(shared[c] for c in kept) >= max(n for c, n in shared.items() if c not in kept)
    assert notes[0].startswith(f"any-angle: only 3 of {len(shared)} corners are used")
    found = AnyAngle(step=STEP, max_positions=3).solve(asked)
    assert notes[0] in found.notes
    assert "the visibility roadmap of 3 corners of the front of the lattice of step 0.5 m" in found.certificate
    assert {origin["corners"] for origin in found.provenance} == {3}


def test_without_corners_there_is_the_straight_line_or_nothing():
    free = Problem(ROOM, ROBOT, (1.0, 1.0, 0.0), (7.0, 4.0, None), ["length"])
    straight = AnyAngle(step=STEP, max_positions=0).solve(free)
    assert straight.planned.tolist() == [[pytest.approx(math.dist((1, 1), (7, 4)), abs=1e-6)]]
    wall = World.from_polygons([shapely.box(4.0, 0.0, 4.2, 6.0)], extent=shapely.box(0, 0, 10, 8))
    blocked = Problem(wall, ROBOT, (1.0, 1.0, 0.0), (7.0, 4.0, None), ["length"])
    found = AnyAngle(step=STEP, max_positions=0).solve(blocked)
    assert found.status is Status.NO_PATH
    assert any("has 2 unconnected parts" in note and "a larger max_positions" in note for note in found.notes)


def test_headings_written_with_three_decimals_are_those_of_the_lattice():
    fronts = []
    for start_yaw, goal_yaw in ((np.pi / 2, -np.pi / 4), (1.571, -0.785)):
        asked = Problem(ROOM, ROBOT, (1.0, 1.0, start_yaw), (6.0, 5.0, goal_yaw), ["turns", "length"])
        found = AnyAngle(step=STEP).solve(asked)
        assert verify(asked, asked.front(found)) == []
        fronts.append(found.planned.tolist())
    assert fronts[0] == fronts[1]


def test_start_is_goal():
    found = AnyAngle(step=STEP).solve(Problem(ROOM, ROBOT, (1.0, 1.0, 0.0), (1.0, 1.0, 0.0), CRITERIA))
    assert found.planned.tolist() == [[0.0] * 3]
    turned = AnyAngle(step=STEP).solve(
        Problem(ROOM, ROBOT, (1.0, 1.0, 0.0), (1.0, 1.0, np.pi / 2), ["turns", "length"])
    )
    assert turned.planned.tolist() == [[1.0, 0.0]]


QUERIES = 8  # a map


@pytest.mark.cases("room-64-64-8")
@pytest.mark.parametrize("name", ["den312d", "room-64-64-8"])
def test_on_benchmark_maps_no_path_is_longer_than_the_published_optimum_of_eight_neighbours(shared_data, name):
    folder = shared_data("movingai") / name
    world = World.from_movingai(folder / f"{name}.map")
    height = world.raster.cells.shape[0]
    robot = DifferentialDrive(radius=0.05, camera_height=0.4, mast_radius=0.01)
    queries = [line.split() for line in next(folder.glob("*.scen")).read_text().splitlines()[1:] if line.strip()]
    shorter = 0
    for _, _, _, _, column, row, to_column, to_row, length in queries[:: len(queries) // QUERIES][:QUERIES]:
        # The file counts rows from the top, cells are 1 m.
        start = (int(column) + 0.5, height - int(row) - 0.5, 0.0)
        goal = (int(to_column) + 0.5, height - int(to_row) - 0.5, None)
        found = AnyAngle(step=1.0).solve(Problem(world, robot, start, goal, ["length"]))
        best = found.planned[:, 0].min()
        assert math.dist(start[:2], goal[:2]) - 1e-5 <= best <= float(length) + 1e-3
        shorter += best < float(length) - 1e-3
    assert shorter >= QUERIES / 2


def test_without_a_lattice_path_the_note_of_the_lattice_is_passed_on():
    wall = World.from_polygons([shapely.box(4.0, 0.0, 4.2, 8.0)], extent=shapely.box(0, 0, 10, 8))
    found = AnyAngle(step=STEP).solve(Problem(wall, ROBOT, (1.0, 1.0, 0.0), (7.0, 4.0, None), ["length"]))
    assert (found.status, found.trajectories) == (Status.NO_PATH, ())
    assert any("obstacles separate start and goal" in note for note in found.notes)
    assert (
        found.notes[-1]
        == "any-angle: the roadmap was not searched, since there is no lattice path from which to build it"
    )


def test_limits_are_kept_and_said():
    asked = cluttered(3, (*ON_THE_LATTICE, None))
    found = AnyAngle(step=STEP, max_labels=10).solve(asked)
    assert found.status is Status.LABEL_LIMIT
    assert "incomplete (label limit)" in found.certificate
    assert AnyAngle(step=STEP, time_limit=1e-6).solve(asked).status is Status.TIME_LIMIT


@pytest.mark.parametrize("search", [1, 2])
def test_an_interruption_keeps_what_is_finished(search):
    asked = cluttered(3, (*ON_THE_LATTICE, None))
    graphs = 0

    def progress(report):
        nonlocal graphs
        graphs += report.stage == "graph"
        if graphs == search and (search == 2 or report.stage != "graph"):
            raise KeyboardInterrupt

    found = AnyAngle(step=STEP).solve(asked, progress)
    assert found.status is Status.INTERRUPTED
    expected = len(Lattice(step=STEP).solve(asked).trajectories) if search == 2 else 0
    assert len(found.trajectories) == expected
    assert "the roadmap was not searched" in found.notes[-1]
    assert all(origin["planner"] == "lattice" for origin in found.provenance)


def test_an_interruption_is_told_though_the_lattice_ran_out_of_time(monkeypatch):
    """A plan of several planners goes on after a time limit, but not after Ctrl-C."""
    asked = cluttered(3, (*ON_THE_LATTICE, None))
    first = dataclasses.replace(Lattice(step=STEP).solve(asked), status=Status.TIME_LIMIT)
    monkeypatch.setattr(Lattice, "stages", lambda planner, problem, progress=None: iter([first]))

    checks = []

    def interrupted_once(*arguments, **options):
        checks.append(arguments)
        if len(checks) == 1:
            raise KeyboardInterrupt
        return judge(*arguments, **options)

    assert AnyAngle(step=STEP).solve(asked).status is Status.TIME_LIMIT
    monkeypatch.setattr("hpop.planners.judgement.judge", interrupted_once)
    assert AnyAngle(step=STEP).solve(asked).status is Status.INTERRUPTED


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 0}, "step"),
        ({"headings": 5}, "headings"),
        ({"max_positions": -1}, "max_positions must be a whole number of at least 0, got -1"),
        ({"max_positions": 1.5}, "max_positions"),
        ({"time_limit": 0}, "time_limit"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        AnyAngle(**options)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((0.1, 1.0, 0.0), (5.0, 2.0, None), "the start .* is 0.100 m away"),
        ((1.0, 1.0, 0.0), (9.95, 2.0, None), "the goal .* is 0.050 m away"),
    ],
)
def test_ends_that_the_lattice_cannot_use_are_refused(start, goal, message):
    with pytest.raises(QueryError, match=message):
        AnyAngle(step=STEP).solve(Problem(ROOM, ROBOT, start, goal, ["length"]))


@pytest.mark.proof  # corners of a whole room on a clock: timed tests of lattice and roadmap hold the claim in each run
def test_among_people_who_move_paths_at_any_angle_are_planned_on_a_clock():
    world = ROOM.with_content(people=(Person(1.0, 4.0, velocity=(0.5, 0.0), name="Bob"),))
    asked = Problem(world, ROBOT, (1.0, 1.0, 0.0), (5.0, 2.0, None), ["length", "duration"])
    found = AnyAngle(step=STEP).solve(asked)
    assert found.status is Status.COMPLETE
    assert "on a clock of 0.05 s" in found.certificate
    assert verify(asked, asked.front(found)) == []
    on_lattice = Lattice(step=STEP).solve(asked)
    assert found.planned[:, 0].min() < on_lattice.planned[:, 0].min()


def test_the_same_question_has_the_same_answer():
    first, again = (AnyAngle(step=STEP).solve(cluttered(3, (*OFF_THE_LATTICE, None))) for _ in range(2))
    assert (first.planned == again.planned).all()
    assert [t.describe() for t in first.trajectories] == [t.describe() for t in again.trajectories]


def test_a_time_limit_that_is_no_number_is_told_by_its_name() -> None:
    with pytest.raises(OptionError, match="time_limit must be a positive number"):
        AnyAngle(time_limit="soon")  # type: ignore[arg-type]
