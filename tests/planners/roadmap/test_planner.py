"""The roadmap planner against an oracle that walks every simple path of the roadmap, in plain loops."""

import math
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
import shapely

from hpop.base.math import wrap
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, QueryError, UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Roadmap
from hpop.planners.graphs import arcs
from hpop.planners.graphs.roadmap.headings import StateRoadmap
from hpop.planners.judgement import Judgement, judge
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Spending
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.search import pareto_paths
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25, camera_height=0.8)
PILLAR = World.from_polygons([shapely.box(2.6, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
START, GOAL = (0.9, 2.1, 0.3), (5.2, 2.2, -1.1)
CRITERIA = [{"exposure": {"radius": 1.0}}, "turns", "length"]


def problem(*, world=PILLAR, robot=ROBOT, start=START, goal=GOAL, criteria=CRITERIA):
    return Problem(world, robot, start, goal, criteria)


# The oracle: positions alone, no states; a path turns where its direction changes.


def links_of(positions, count):
    """Each position with its nearest, and the start with the goal, as unordered pairs."""
    pairs = {frozenset((0, 1))}
    for i, p in enumerate(positions):
        near = sorted((math.dist(p, q), j) for j, q in enumerate(positions) if j != i)
        pairs |= {frozenset((i, j)) for _, j in near[:count]}
    return pairs


def simple_paths(positions, pairs, asked):
    """Every path without repeated positions from 0 to 1 whose segments keep the robot's radius from all that blocks."""
    solid = shapely.union_all([o.polygon for o in asked.world.obstacles] + [asked.world.extent.exterior])

    def free(i, j):
        return shapely.distance(shapely.LineString([positions[i], positions[j]]), solid) >= asked.model.radius

    onward = {
        i: [j for j in range(len(positions)) if frozenset((i, j)) in pairs and free(i, j)]
        for i in range(99)[: len(positions)]
    }
    stack = [(0,)]
    while stack:
        path = stack.pop()
        if path[-1] == 1:
            yield path
            continue
        stack += [(*path, j) for j in onward[path[-1]] if j not in path]


def driven(asked, points):
    """Turn towards each point, drive there, and turn to the goal's heading."""
    x, y, yaw = asked.start
    poses = [(x, y, yaw)]
    for (x0, y0), (x1, y1) in pairwise(points):
        poses.append((x1, y1, math.atan2(y1 - y0, x1 - x0)))
    if asked.goal[2] is not None:
        poses[-1] = (*poses[-1][:2], asked.goal[2])
    return Trajectory.from_poses(asked.model, poses)


def nondominated(costs, slack):
    """Rows to which no row is better by more than the slack in one cost and no worse in the others."""
    return [row for row in costs if not ((costs <= row + slack).all(axis=1) & (costs < row - slack).any(axis=1)).any()]


@pytest.mark.parametrize("goal_yaw", [-1.1, None])
@pytest.mark.parametrize("neighbours", [None, 3])
@pytest.mark.seeds(2, of=4)
def test_the_front_equals_that_of_all_simple_paths(seed, neighbours, goal_yaw):
    asked = problem(goal=(*GOAL[:2], goal_yaw))
    planner = Roadmap(samples=6, seed=seed, neighbours=neighbours)
    found = planner.solve(asked)
    positions = planner.roadmap(asked).positions
    assert positions[:2].tolist() == [list(START[:2]), list(GOAL[:2])]
    paths = list(simple_paths(positions, links_of(positions, neighbours or 7), asked))
    assert found.status is (Status.COMPLETE if paths else Status.NO_PATH)
    if not paths:
        return
    costs = trajectory_costs(found.objectives, [driven(asked, positions[list(p)]) for p in paths], asked.world)
    slack = np.array([2e-5, 0.5, 2e-5])
    best = np.array(nondominated(costs, slack))
    for row in best:
        assert (found.planned <= row + slack).all(axis=1).any()
    for row in found.planned:
        assert (np.abs(best - row) <= slack).all(axis=1).any()


@pytest.mark.proof
def test_the_compared_fronts_are_not_trivial():
    sizes = [
        len(Roadmap(samples=6, seed=seed, neighbours=n).solve(problem(goal=(*GOAL[:2], yaw))).planned)
        for seed in range(4)
        for n in (None, 3)
        for yaw in (-1.1, None)
    ]
    assert max(sizes) >= 4
    assert sum(size >= 2 for size in sizes) >= len(sizes) / 2


LONG = DifferentialDrive(footprint=((0.5, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.5, -0.2)), camera_height=0.8)


@pytest.mark.cases("-1.1-round-40", "None-long-25")
@pytest.mark.parametrize("samples", [25, 40, pytest.param(60, marks=pytest.mark.proof)])
@pytest.mark.parametrize("robot", [ROBOT, LONG], ids=["round", "long"])
@pytest.mark.parametrize("goal_yaw", [-1.1, None])
def test_what_is_found_holds_what_it_claims(robot, goal_yaw, samples):
    asked = problem(
        robot=robot, goal=(*GOAL[:2], goal_yaw), criteria=[*CRITERIA, {"obstruction": {"radius": 1.0}}, "clearance"]
    )
    found = Roadmap(samples=samples, seed=1).solve(asked)
    assert found.status is Status.COMPLETE
    assert len(found.trajectories) > 5
    assert found.stats["dropped"] == {}
    assert verify(asked, asked.front(found)) == []  # collisions by fcl, ends, costs
    again = trajectory_costs(found.objectives, found.trajectories, asked.world)
    assert (np.abs(again - found.planned) <= found.tolerance + 1e-9).all()
    quanta = np.array([c.quantum for c in found.objectives])
    motions = np.array([[max(1, len(t))] for t in found.trajectories])
    assert (found.tolerance <= motions * quanta + 1e-15).all()
    for trajectory in found.trajectories:
        s = trajectory.states
        assert (s.x[0], s.y[0], s.x[-1], s.y[-1]) == (*START[:2], *GOAL[:2])  # not snapped
        assert s.yaw[0] == pytest.approx(START[2], abs=1e-12)


def test_the_certificate_and_the_provenance_name_the_roadmap():
    found = Roadmap(samples=20, seed=3, neighbours=5).solve(problem(criteria=["turns", "length"]))
    assert found.certificate == (
        "roadmap: exact on the roadmap of 20 samples (seed 3) and 5 neighbours of each, for (turns, length); paths "
        "off this graph may be better; edge costs rounded to their quanta"
    )
    for trajectory, origin in zip(found.trajectories, found.provenance, strict=True):
        chosen = {"planner": "roadmap", "samples": 20, "neighbours": 5, "seed": 3}
        assert origin == {**chosen, "edges": len(trajectory)}


def test_the_seed_settles_the_front():
    first, again, other = (Roadmap(samples=40, seed=seed).solve(problem()) for seed in (5, 5, 6))
    assert (first.planned == again.planned).all()
    assert [t.describe() for t in first.trajectories] == [t.describe() for t in again.trajectories]
    assert first.planned.shape != other.planned.shape or (first.planned != other.planned).any()


def test_neighbours_are_those_of_prm_star():
    roadmap = Roadmap(samples=98).roadmap(problem())
    assert roadmap.options["neighbours"] == math.ceil(2 * math.e * math.log(100))


def test_samples_are_free_and_more_of_them_never_lengthen_the_shortest_path():
    asked = problem(criteria=["length"])
    few, many = (Roadmap(samples=n, neighbours=100).roadmap(asked).positions for n in (20, 60))
    assert (many[:22] == few).all()
    assert (PILLAR.clearance(*many.T) >= ROBOT.radius - 1e-9).all()
    lengths = [Roadmap(samples=n, neighbours=100).solve(asked).planned[0, 0] for n in (20, 60, 100)]
    assert lengths == sorted(lengths, reverse=True)
    # Taut about the pillar for a point is shorter than any; with 100 samples a fifth more suffices.
    taut = min(
        math.dist(START[:2], a) + math.dist(a, b) + math.dist(b, GOAL[:2])
        for a, b in [((2.6, 1.2), (3.3, 1.2)), ((2.6, 3.0), (3.3, 3.0))]
    )
    assert taut <= lengths[-1] <= 1.2 * taut


def line(*xs, start_yaw=0.0, goal_yaw=None, world=PILLAR):
    """Return a roadmap of positions on y = 4, all linked."""
    positions = np.array([(x, 4.0) for x in xs])
    links = np.stack(np.triu_indices(len(xs), 1), axis=1)
    return StateRoadmap(ROBOT, world, positions, links, start_yaw, ((1, goal_yaw),), "a line", {}, "add more")


def test_a_link_through_a_position_is_left_out_for_its_parts():
    roadmap = line(1.0, 5.0, 3.0, 2.0)
    tails, heads, _ = roadmap.directed_moves
    expected = {(0, 3), (3, 2), (2, 1)}
    assert set(zip(tails.tolist(), heads.tolist(), strict=True)) == expected | {(b, a) for a, b in expected}
    assert roadmap.size == 8  # two headings of each position
    assert roadmap.turns[0].size == 8
    objectives = edge_objectives(problem(criteria=["turns", "length"]).criteria, "test").optimised
    paths = pareto_paths(roadmap.graph(objectives), roadmap.start, roadmap.goals)
    assert paths.costs.tolist() == [[0, 4_000_000]]
    assert roadmap.trajectory(paths.nodes(0)).kinds == ("move",) * 3


@pytest.mark.parametrize("start_yaw", [0.0, 2 * math.pi, -1e-12, 2 * math.pi - 1e-12])
def test_a_heading_along_a_link_is_the_heading_of_the_link(start_yaw):
    roadmap = line(1.0, 5.0, start_yaw=start_yaw, goal_yaw=start_yaw)
    assert roadmap.size == 4
    assert roadmap.goals == [h for h in roadmap.moves[1].tolist() if roadmap.places(np.array([h]))[0] == 1]


def star(*degrees, start_yaw, goal_yaw=None):
    """Return a roadmap with links from (1, 2) to points 2 m away; the first goes on to the goal, straight up."""
    rays = [(1 + 2 * math.cos(a), 2 + 2 * math.sin(a)) for a in np.radians(degrees)]
    positions = np.array([(1.0, 2.0), (rays[0][0], rays[0][1] + 1.0), *rays])
    links = np.array([(0, i + 2) for i in range(len(rays))] + [(2, 1)])
    room = World.from_polygons([], extent=shapely.box(0, 0, 6, 5))
    return StateRoadmap(ROBOT, room, positions, links, start_yaw, ((1, goal_yaw),), "a star", {}, "add more")


@pytest.mark.parametrize(("apart", "turns"), [(0.5, 1), (1.9, 2), (2.5, 2)])
def test_turns_that_do_not_count_are_made_at_the_ends_only_and_never_add_up_to_one_that_counts(apart, turns):
    roadmap = star(apart, *np.arange(0.6, apart, 0.6), start_yaw=0.0)
    objectives = edge_objectives(problem(criteria=["turns", "length"]).criteria, "test").optimised
    paths = pareto_paths(roadmap.graph(objectives), roadmap.start, roadmap.goals)
    assert paths.costs[:, 0].tolist() == [turns]
    tails, heads = roadmap.turns
    turned = np.degrees(np.abs(wrap(roadmap.states(heads).yaw - roadmap.states(tails).yaw)))
    assert ((turned > 1.0) | (tails == roadmap.start)).all()


def test_the_last_turn_to_the_heading_of_the_goal_may_be_small():
    roadmap = star(0.0, start_yaw=0.0, goal_yaw=math.radians(90.4))
    objectives = edge_objectives(problem(criteria=["turns"]).criteria, "test").optimised
    paths = pareto_paths(roadmap.graph(objectives), roadmap.start, roadmap.goals)
    assert paths.costs.tolist() == [[1]]
    assert roadmap.trajectory(paths.nodes(0)).kinds == ("move", "turn", "move", "turn")


def test_too_many_turns_are_refused_before_they_are_made(monkeypatch):
    monkeypatch.setattr("hpop.planners.graphs.roadmap.headings.MAX_EDGES", 7)
    with pytest.raises(OptionError, match="a line must have at most 7 turns, got 8 between 8 states; take fewer"):
        line(1.0, 5.0, 3.0, 2.0).turns  # noqa: B018


def test_no_path_says_in_which_components_start_and_goal_are():
    wall = World.from_polygons([shapely.box(2.9, 0, 3.1, 5)], extent=shapely.box(0, 0, 6, 5))
    planner = Roadmap(samples=30)
    asked = problem(world=wall)
    found = planner.solve(asked)
    assert (found.status, len(found.trajectories)) == (Status.NO_PATH, 0)
    left = int((planner.roadmap(asked).positions[:, 0] < 3).sum())
    assert found.notes[-1] == (
        "no path: the roadmap of 30 samples (seed 0) and 19 neighbours of each has 2 unconnected parts; the part with "
        f"the start has {left} of 32 positions, the part with the goal {32 - left}; take more samples"
    )


def test_a_robot_without_room_to_turn_is_told_so():
    corridor = World.from_polygons([], extent=shapely.box(0, 0, 6, 0.6))
    asked = problem(world=corridor, robot=LONG, start=(1.0, 0.3, 0.0), goal=(5.0, 0.3, math.pi), criteria=["length"])
    found = Roadmap(samples=5).solve(asked)
    assert found.status is Status.NO_PATH
    assert "straight moves connect start and goal" in found.notes[-1]
    assert "no room to turn" in found.notes[-1]
    through = problem(world=corridor, robot=LONG, start=(1.0, 0.3, 0.0), goal=(5.0, 0.3, None), criteria=["length"])
    assert Roadmap(samples=5).solve(through).planned.tolist() == [[4.0]]


def test_a_map_with_hardly_any_free_space_says_how_few_samples_there_are():
    cell = World.from_polygons([], extent=shapely.box(0, 0, 0.5, 0.5))
    asked = problem(world=cell, start=(0.25, 0.25, 0.0), goal=(0.25, 0.25, 1.0), criteria=["turns"])
    found = Roadmap(samples=2).solve(asked)
    assert found.planned.tolist() == [[1.0]]
    assert any("only 0 of 2 samples" in note for note in found.notes)


def test_start_is_goal():
    found = Roadmap(samples=10).solve(problem(goal=START, criteria=[*CRITERIA, "clearance"]))
    assert found.planned.tolist() == [[0.0] * 4]
    assert len(found.trajectories[0]) == 0


def test_a_limit_leaves_a_part_that_is_called_one():
    found, exact = (Roadmap(samples=80, max_labels=n).solve(problem()) for n in (4000, None))
    assert found.status is Status.LABEL_LIMIT
    assert found.certificate.startswith("roadmap: incomplete (label limit): ")
    assert "others are missing" in found.certificate
    assert 0 < len(found.planned) < len(exact.planned)
    for row in found.planned:
        assert not (exact.planned < row).all(axis=1).any()
    assert Roadmap(samples=80, time_limit=1e-6).solve(problem()).status is Status.TIME_LIMIT


def test_an_interruption_of_the_last_check_keeps_what_was_found(monkeypatch):
    calls = 0

    def interrupted_once(*arguments, **options):
        nonlocal calls
        calls += 1
        if calls == 1:
            raise KeyboardInterrupt
        return judge(*arguments, **options)

    expected = Roadmap(samples=30).solve(problem())
    monkeypatch.setattr("hpop.planners.judgement.judge", interrupted_once)
    found = Roadmap(samples=30).solve(problem())
    assert found.status is Status.INTERRUPTED
    assert (found.planned == expected.planned).all()


def test_a_candidate_that_is_not_to_be_trusted_is_dropped_and_said(monkeypatch):
    def strict(asked, objectives, trajectories, **options):
        judged = judge(asked, objectives, trajectories, **options)
        return Judgement(judged.costs, ("collides", *judged.reasons[1:]))

    expected = Roadmap(samples=30).solve(problem())
    monkeypatch.setattr("hpop.planners.judgement.judge", strict)
    found = Roadmap(samples=30).solve(problem())
    assert (found.planned == expected.planned[1:]).all()
    assert len(found.trajectories) == len(found.provenance) == len(found.tolerance) == len(expected.planned) - 1
    assert found.stats["dropped"] == {"collides": 1}
    assert found.certificate.endswith("; without 1 that failed the exact check")
    assert found.notes[-1] == f"roadmap: 1 of {len(expected.planned)} candidates were rejected: collides (1)"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, "samples must be a whole number from 1 to 1,000,000, got 0"),
        ({"samples": 10.0}, "samples"),
        ({"samples": True}, "samples"),
        ({"samples": None}, "samples"),
        ({"neighbours": 0}, "neighbours"),
        ({"seed": -1}, "seed"),
        ({"seed": None}, "seed"),
        ({"time_limit": 0}, "time_limit"),
        ({"max_labels": -5}, "max_labels"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        Roadmap(**options)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((3.0, 2.0, 0.0), GOAL, r"the start \(3.000, 2.000\) is not usable: it is inside an obstacle"),
        (START, (3.0, 2.0, 0.0), r"the goal \(3.000, 2.000\) is not usable: it is inside an obstacle"),
        (START, (3.0, 2.0, None), "the goal .* inside an obstacle"),
        (START, (5.9, 2.0, 0.0), "the goal .* is 0.100 m away and the robot reaches 0.250 m"),
        ((-1.0, 2.0, 0.0), GOAL, "the start .* outside the map"),
    ],
)
def test_a_start_or_goal_that_is_blocked_is_refused_with_the_reason(start, goal, message):
    with pytest.raises(QueryError, match=message):
        Roadmap(samples=5).solve(problem(start=start, goal=goal))


def test_criteria_with_memory_alone_are_refused_and_beside_others_they_filter():
    with pytest.raises(UnsupportedCriterion, match="roadmap needs at least one criterion that adds up"):
        Roadmap(samples=5).solve(problem(criteria=["curvature_sign_changes"]))
    found = Roadmap(samples=20).solve(problem(criteria=["length", "curvature_sign_changes"]))
    assert [c.name for c in found.filters] == ["curvature_sign_changes"]
    assert found.planned.shape[1] == 1


def test_it_joins_the_front_of_the_lattice():
    asked = problem(start=(1.0, 2.0, 0.0), goal=(5.0, 2.0, 0.0), criteria=["turns", "length"])
    lattice = asked.solve("lattice", step=0.5)
    front = lattice | asked.front(Roadmap(samples=100).solve(asked))
    for row in lattice.costs:
        assert (front.costs <= row + 1e-9).all(axis=1).any()
    assert "roadmap" in {origin["planner"] for origin in front.provenance}


class Counted(Spending):
    """Counts how often limits are looked at."""

    looks = 0

    def check(self, doing, memory=0):
        type(self).looks += 1
        super().check(doing, memory)


def test_limits_are_looked_at_all_along_while_headings_are_laid_out(monkeypatch):
    """At least once for so many arrows, and for so many turns, as are worked on together."""
    monkeypatch.setattr(arcs, "BLOCK", 256)
    roadmap = Roadmap(samples=60).roadmap(problem(), Counted())
    for layer, items in (("directed_moves", 2 * len(roadmap.links)), ("turns", 4 * len(roadmap.links))):
        before = Counted.looks
        getattr(roadmap, layer)
        assert Counted.looks - before >= items // 1024 > 0


@pytest.mark.parametrize("most", [100_000, 1_000_000, 20_000_000])
def test_a_roadmap_of_positions_takes_no_more_memory_than_it_may(most):
    small, asked = Roadmap(samples=5), problem()
    small.solve(asked)  # what is imported and made once
    tracemalloc.start()
    found = Roadmap(samples=100_000, max_memory=most).solve(asked)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.status is Status.MEMORY_LIMIT
    assert peak < most + 2_000_000  # blocks, on every core
