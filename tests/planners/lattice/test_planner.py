"""The lattice planner against an oracle that builds its own edges and closes sets of vectors, in plain loops."""

import math
import re

import numpy as np
import pytest
import shapely

from hpop.criteria import make_criterion, motion_costs
from hpop.criteria.costs import trajectory_costs
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.planners.graph_planners import Lattice
from hpop.planners.objectives import edge_objectives
from hpop.problems.problem import Problem
from hpop.problems.verify import collision_free
from hpop.runtime.limits import Status
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))


def solve(problem, **options):
    return Lattice(**options).solve(problem)


def angle_between(a, b):
    return math.atan2(math.sin(b - a), math.cos(b - a))


# The oracle: Becerra et al. 2020, section on the lattice, read word by word.


class Oracle:
    """States and edges of a lattice for a round robot, each edge costed alone."""

    def __init__(self, problem, step, headings, corner_cutting):
        self.problem, self.step = problem, step
        world, robot = problem.world, problem.model
        x_min, y_min, x_max, y_max = world.bounds
        self.blocked = shapely.union_all([world.keep_out, *(o.polygon for o in world.obstacles)])
        steps = {4: [(1, 0), (0, 1), (-1, 0), (0, -1)]}
        steps[8] = [*steps[4], (1, 1), (-1, 1), (-1, -1), (1, -1)]
        knight = [(a * s, b * t) for a, b in ((1, 2), (2, 1)) for s in (1, -1) for t in (1, -1)]
        steps[16] = [*steps[8], *knight]
        steps = steps[headings]

        def at(i, j):
            return problem.start[0] + i * step, problem.start[1] + j * step

        def free(i, j):
            point = shapely.Point(at(i, j))
            border = world.extent.exterior.distance(point)
            return world.extent.contains(point) and min(border, self.blocked.distance(point)) >= robot.radius

        reach = range(-20, 21)
        inside = {
            (i, j) for i in reach for j in reach if x_min <= at(i, j)[0] <= x_max and y_min <= at(i, j)[1] <= y_max
        }
        positions = {p for p in inside if free(*p)}
        self.edges = []  # (tail, head, costs in quanta); a state is (i, j, step of its heading)
        objectives = edge_objectives(problem.criteria, "oracle").optimised
        self.is_max = [c.aggregate == "max" for c in objectives]

        def cost(kind, tail, head, end_yaw):
            start = States(**dict(zip(("x", "y", "yaw"), self._columns(tail), strict=True)))
            x, y = at(*head[:2])
            end = States(x=np.array([x]), y=np.array([y]), yaw=np.array([end_yaw]))
            motion = Motions(world, robot, robot.laws[kind], start, end)
            return tuple(math.ceil(float(motion_costs(c, motion)[0]) / c.quantum - 1e-6) for c in objectives)

        for i, j in sorted(positions):
            for heading in steps:
                tail, yaw = (i, j, heading), math.atan2(heading[1], heading[0])
                for other in steps:  # Type A: same position, any other heading
                    if other != heading:
                        turned = angle_between(yaw, math.atan2(other[1], other[0]))
                        turned = math.pi if abs(abs(turned) - math.pi) < 1e-9 else turned
                        self.edges.append((tail, (i, j, other), cost("turn", tail, (i, j, other), yaw + turned)))
                to = (i + heading[0], j + heading[1])  # Type B: one step along the heading
                if to not in positions:
                    continue
                line = shapely.LineString([at(i, j), at(*to)])
                if min(line.distance(self.blocked), line.distance(world.extent.exterior)) < robot.radius:
                    continue
                passed = [
                    (a, b)
                    for a in range(i - 2, i + 3)
                    for b in range(j - 2, j + 3)
                    if (a, b) not in ((i, j), to)
                    and shapely.LineString([(i, j), to]).intersects(shapely.box(a - 0.5, b - 0.5, a + 0.5, b + 0.5))
                ]
                if corner_cutting or all(p in positions for p in passed):
                    self.edges.append((tail, (*to, heading), cost("move", tail, (*to, heading), yaw)))

    def _columns(self, state):
        i, j, heading = state
        x, y = self.problem.start[0] + i * self.step, self.problem.start[1] + j * self.step
        return np.array([x]), np.array([y]), np.array([math.atan2(heading[1], heading[0])])

    def front(self, source, targets):
        """Non-dominated vectors at the targets: relax every edge until no set changes."""
        leaving = {}
        for tail, head, cost in self.edges:
            leaving.setdefault(tail, []).append((head, cost))
        sets = {source: {(0,) * len(self.is_max)}}
        changed = {source}
        while changed:
            tail = changed.pop()
            for head, cost in leaving.get(tail, ()):
                longer = {
                    tuple(max(a, c) if m else a + c for a, c, m in zip(v, cost, self.is_max, strict=True))
                    for v in sets[tail]
                }
                merged = nondominated(sets.get(head, set()) | longer)
                if merged != sets.get(head):
                    sets[head] = merged
                    changed.add(head)
        return nondominated(set().union(*(sets.get(t, set()) for t in targets)))


def nondominated(vectors):
    kept = []
    for v in sorted(vectors):  # what dominates comes first
        if not any(all(a <= b for a, b in zip(w, v, strict=True)) for w in kept):
            kept.append(v)
    return set(kept)


def grid_step(yaw):
    """Return the step of a heading that is a multiple of 45 degrees."""
    return round(1.2 * math.cos(yaw)), round(1.2 * math.sin(yaw))


STEP = 0.5
EXPOSURE, OBSTRUCTION = {"exposure": {"radius": 0.5}}, {"obstruction": {"radius": 0.5}}


def random_problem(seed, criteria, goal_yaw):
    rng = np.random.default_rng(seed)
    while True:
        corners, sizes = rng.uniform((0.3, 0.3), (4.4, 3.4), (14, 2)), rng.uniform(0.1, 0.5, (14, 2))
        boxes = [shapely.box(*c, *(c + s)) for c, s in zip(corners, sizes, strict=True)]
        world = World.from_polygons(boxes, extent=shapely.box(0, 0, 4.9, 3.8))
        robot = DifferentialDrive(radius=0.15, camera_height=0.4)
        spots = (np.array([0.43, 0.37]), np.array([0.43 + 8 * STEP, 0.37 + 6 * STEP]))
        if all(world.clearance(*spot[:, None])[0] > 0.16 for spot in spots):
            return Problem(world, robot, (*spots[0], 0.0), (*spots[1], goal_yaw), criteria)


SEEDS = (0, 2, 3, 5)  # no path leads to the goal in world 2
FRONTS = [
    (["turns", "length"], 8, True, None),
    ([OBSTRUCTION, "rotation", "length", "clearance", "duration"], 4, False, np.pi),
]
MORE = [
    ([EXPOSURE, "turns"], 4, False, 0.0),
    (["turns", "length"], 8, False, np.pi / 2),
    ([EXPOSURE, "turns", "length", "clearance"], 4, False, 0.0),
    ([EXPOSURE, "turns", "length"], 8, False, 0.0),
    ([OBSTRUCTION, "turns", "length"], 4, True, None),
    (["clearance", "turns", "length"], 8, False, None),
]


@pytest.mark.parametrize(
    ("criteria", "headings", "corner_cutting", "goal_yaw"),
    [FRONTS[0], *(pytest.param(*front, marks=pytest.mark.proof) for front in [*FRONTS[1:], *MORE])],
)
@pytest.mark.seeds(1, of=SEEDS)
def test_the_front_equals_full_enumeration_and_its_trajectories_hold_what_they_claim(
    criteria, headings, corner_cutting, goal_yaw, seed
):
    problem = random_problem(seed, criteria, goal_yaw)
    found = solve(problem, step=STEP, headings=headings, corner_cutting=corner_cutting)
    oracle = Oracle(problem, STEP, headings, corner_cutting)
    ends = {head for _, head, _ in oracle.edges if head[:2] == (8, 6)}
    if goal_yaw is not None:
        ends = {end for end in ends if end[2] == grid_step(goal_yaw)}
    expected = oracle.front((0, 0, (1, 0)), ends)
    quanta = np.array([c.quantum for c in found.objectives])
    assert {tuple(row) for row in np.rint(found.planned / quanta).astype(int).tolist()} == expected
    assert len(found.planned) == len(expected)
    assert found.status == (Status.COMPLETE if expected else Status.NO_PATH)
    check_trajectories(problem, found, STEP)


@pytest.mark.parametrize(
    ("asked", "seeds", "most"),
    [(FRONTS, SEEDS[:1], 4), pytest.param([*FRONTS, *MORE], SEEDS, 10, marks=pytest.mark.proof)],
)
def test_the_compared_fronts_are_not_trivial(asked, seeds, most):
    sizes = [
        len(solve(random_problem(seed, criteria, yaw), step=STEP, headings=headings, corner_cutting=cut).planned)
        for criteria, headings, cut, yaw in asked
        for seed in seeds
    ]
    assert max(sizes) >= most
    assert sum(size >= 2 for size in sizes) >= len(sizes) / 2


def check_trajectories(problem, found, step):
    """Certificates: begins, ends, collides nowhere by fcl and by shapely, costs what was planned."""
    if not found.trajectories:
        return
    assert collision_free(problem, found.trajectories).all()
    costs = trajectory_costs(found.objectives, found.trajectories, problem.world)
    assert (np.abs(costs - found.planned) <= found.tolerance + 1e-9).all()
    quanta = np.array([c.quantum for c in found.objectives])
    motions = np.array([len(t) for t in found.trajectories])[:, None]
    assert (found.tolerance <= np.maximum(motions, 1) * quanta + 1e-12).all()
    ends = set()
    for trajectory in found.trajectories:
        s = trajectory.states
        assert (s.x[0], s.y[0]) == problem.start[:2]
        assert math.cos(s.yaw[0] - problem.start[2]) == pytest.approx(1.0)
        if problem.goal[2] is not None:
            assert math.cos(s.yaw[-1] - problem.goal[2]) == pytest.approx(1.0)
        ends.add((round(s.x[-1], 9), round(s.y[-1], 9)))
        blocked = shapely.union_all([o.polygon for o in problem.world.obstacles])
        dense = trajectory.at(np.linspace(0, trajectory.duration, 400))
        points = shapely.points(dense.x, dense.y)
        if problem.model.footprint is None:
            room = np.minimum(
                shapely.distance(points, blocked), shapely.distance(points, problem.world.extent.exterior)
            )
            assert (room >= problem.model.radius - 1e-9).all()
    assert len(ends) == 1
    assert math.dist(ends.pop(), problem.goal[:2]) <= step / math.sqrt(2) + 1e-9


def test_a_robot_that_is_not_round_keeps_free_at_every_yaw():
    robot = DifferentialDrive(footprint=((0.6, 0.15), (-0.2, 0.15), (-0.2, -0.15), (0.6, -0.15)), camera_height=0.4)
    walls = [shapely.box(2.0, 0.0, 4.0, 1.75), shapely.box(2.0, 2.25, 4.0, 5.0)]
    world = World.from_polygons(walls, extent=shapely.box(0, 0, 6, 5))
    problem = Problem(world, robot, (1.0, 2.0, 0.0), (5.0, 3.0, None), ["exposure", "turns", "length"])
    found = solve(problem, step=0.5)
    assert found.status is Status.COMPLETE
    check_trajectories(problem, found, 0.5)
    for trajectory in found.trajectories:
        s = trajectory.at(np.linspace(0, trajectory.duration, 2000))
        corners = np.array(robot.footprint)
        cos, sin = np.cos(s.yaw)[:, None], np.sin(s.yaw)[:, None]
        x = s.x[:, None] + cos * corners[:, 0] - sin * corners[:, 1]
        y = s.y[:, None] + sin * corners[:, 0] + cos * corners[:, 1]
        bodies = shapely.polygons(np.stack([x, y], axis=2))
        for wall in walls:
            assert shapely.area(shapely.intersection(bodies, wall)).max() < 1e-9
        inside = (np.abs(s.x - 3.0) < 0.9) & (np.abs(s.y - 2.0) < 1e-6)
        assert inside.any()  # it is the only way
        assert np.abs(np.sin(s.yaw[inside])).max() < 1e-6
    wide = DifferentialDrive(radius=0.65, camera_height=0.4)
    assert solve(Problem(world, wide, (1.0, 2.0, 0.0), (5.0, 3.0, None), ["length"]), step=0.5).status is Status.NO_PATH


@pytest.mark.parametrize(
    ("headings", "length"), [(4, 5.0), (8, 2 * math.sqrt(2) + 1), (16, math.sqrt(5) + math.sqrt(2))]
)
def test_more_headings_give_shorter_paths(headings, length):
    world = World.from_polygons([], extent=shapely.box(0, 0, 9, 9))
    problem = Problem(world, ROBOT, (3.0, 3.0, 0.0), (6.0, 5.0, None), ["length"])
    found = solve(problem, step=1.0, headings=headings)
    assert found.planned[:, 0].tolist() == pytest.approx([length], abs=4e-6)


@pytest.mark.parametrize("corner_cutting", [False, True])
def test_a_diagonal_between_two_blocked_positions_needs_corner_cutting(corner_cutting):
    posts = [shapely.box(1.7, 0.7, 2.3, 1.3), shapely.box(0.7, 1.7, 1.3, 2.3)]
    world = World.from_polygons(posts, extent=shapely.box(0.5, 0.5, 2.5, 2.5))
    problem = Problem(world, DifferentialDrive(radius=0.1), (1.0, 1.0, 0.0), (2.0, 2.0, None), ["turns", "length"])
    found = solve(problem, step=1.0, corner_cutting=corner_cutting)
    if corner_cutting:
        assert found.planned.tolist() == pytest.approx(np.array([[1.0, math.sqrt(2)]]), abs=1e-6)
    else:
        assert found.status is Status.NO_PATH


def test_a_free_heading_at_the_goal_takes_the_best_of_every_heading():
    fronts = {}
    for yaw in (None, *np.arange(8) * np.pi / 4):
        problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, yaw), ["turns", "length"])
        fronts[yaw] = {tuple(np.round(row, 9)) for row in solve(problem, step=0.5).planned}
    assert fronts[None] == nondominated(set().union(*(fronts[yaw] for yaw in fronts if yaw is not None)))
    assert fronts[None] != fronts[0.0]


@pytest.mark.seeds(1, of=[1, 2, 3])
def test_with_duration_no_path_of_the_lattice_beats_a_returned_one_in_the_mean(seed):
    rng = np.random.default_rng(seed)
    boxes = [shapely.box(*c, *(c + 0.25)) for c in rng.uniform(0.0, 2.0, (3, 2))]
    world = World.from_polygons(boxes, extent=shapely.box(-0.6, -0.6, 2.6, 1.6))
    robot = DifferentialDrive(radius=0.1, camera_height=0.4)
    free = world.clearance(np.array([0.0, 2.0]), np.array([0.0, 1.0])) > 0.11
    if not free.all():
        pytest.fail("take another seed: an end is blocked in this world")
    names = ["obstruction", "turns", "length", "duration"]
    problem = Problem(world, robot, (0.0, 0.0, 0.0), (2.0, 1.0, 0.0), names)
    found = solve(problem, step=1.0, headings=4)
    oracle = Oracle(problem, 1.0, 4, corner_cutting=False)
    vectors = every_walk(oracle, (0, 0, (1, 0)), (2, 1, (1, 0)), edges=11)
    quanta = np.array([c.quantum for c in found.objectives])
    costs = vectors * quanta
    mean = np.column_stack([costs[:, 0] / costs[:, 3], costs[:, 1:]])
    planned = np.column_stack([found.planned[:, 0] / found.planned[:, 3], found.planned[:, 1:]])
    assert len(planned) >= 1
    slack = 1e-3  # 11 edges, each rounded to 1e-4 s of exposure
    for row in planned:
        no_worse = (mean <= row + 1e-5).all(axis=1)
        assert not (no_worse & (mean[:, 0] < row[0] - slack)).any()
        better = (mean[:, 1:] < row[1:] - 1e-3).any(axis=1)
        assert not (no_worse & better & (mean[:, 0] <= row[0])).any()


def every_walk(oracle, source, target, edges):
    """Cost vectors of all walks of at most so many edges, loops and all."""
    ids = {state: n for n, state in enumerate(sorted({e[0] for e in oracle.edges} | {e[1] for e in oracle.edges}))}
    arcs = [[] for _ in ids]
    for tail, head, cost in oracle.edges:
        arcs[ids[tail]].append((ids[head], cost))
    at, costs, found = np.array([ids[source]]), np.zeros((1, 4), dtype=np.int64), []
    for _ in range(edges):
        heads, totals = [], []
        for state, leaving in enumerate(arcs):
            here = costs[at == state]
            for head, cost in leaving:
                heads.append(np.full(len(here), head))
                totals.append(here + cost)
        at, costs = np.concatenate(heads), np.concatenate(totals)
        both = np.unique(np.column_stack([at, costs]), axis=0)
        at, costs = both[:, 0], both[:, 1:]
        found.append(costs[at == ids[target]])
    return np.concatenate(found)


@pytest.mark.parametrize("limit", [{"max_labels": 1}, {"max_labels": 300}, {"max_labels": 3000}])
def test_a_search_cut_short_says_so_and_returns_a_part_of_the_front(limit):
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), ["exposure", "turns", "length", "clearance"])
    whole, part = solve(problem, step=0.25), solve(problem, step=0.25, **limit)
    assert whole.status is Status.COMPLETE
    assert len(whole.planned) > 10
    assert not part.status.is_final
    claim = "every point is optimal" if len(part.planned) else "the search itself found none"
    assert part.certificate.startswith(f"lattice: incomplete ({part.status}): {claim}")
    exact = {tuple(np.round(row, 9)) for row in whole.planned}
    assert {tuple(np.round(row, 9)) for row in part.planned} <= exact
    assert len(part.planned) < len(whole.planned)
    check_trajectories(problem, part, 0.25)


def test_every_criterion_of_a_front_is_re_evaluated_within_its_tolerance():
    names = ["exposure", "turns", "length", "rotation", "duration", "clearance"]
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 3.0, 0.0), names)
    found = solve(problem, step=0.5, headings=16)
    assert len(found.planned) > 5
    check_trajectories(problem, found, 0.5)
    assert all(re.fullmatch(r"[a-z]+", c.name) for c in map(make_criterion, names))
    for row, trajectory in zip(found.planned, found.trajectories, strict=True):
        assert trajectory.kinds.count("turn") == row[1]
