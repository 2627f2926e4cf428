"""Exact ends on a graph of states, against an oracle that shares no code: joins made by hand, judged by fcl."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from hpop.base.math import wrap
from hpop.criteria.costs import trajectory_costs
from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.planners import searches as exact_search
from hpop.planners.graph_planners import Lattice, Roadmap, WeightedSum
from hpop.planners.graphs import lattice as lattice_planner
from hpop.planners.graphs.joined_ends import with_ends
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.lattice.grid import Headings
from hpop.planners.graphs.query import Query
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Spending
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Budget, Status
from hpop.search import pareto_paths
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([shapely.box(1.55, 1.35, 2.4, 1.75)], extent=shapely.box(0, 0, 4, 3))
ROUND = DifferentialDrive(radius=0.2, camera_height=0.6, camera_offset=(0.1, 0.0))
LONG = DifferentialDrive(footprint=((0.45, 0.12), (-0.2, 0.12), (-0.2, -0.12), (0.45, -0.12)), camera_height=0.6)
CRITERIA = ["length", "turns", "rotation"]
STEP, ANCHOR = 0.8, (0.61, 0.53)


def random_ends(seed):
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform((0.5, 0.5, -3.0), (1.3, 2.5, 3.0)), rng.uniform((2.7, 0.5, -3.0), (3.5, 2.5, 3.0))
    return tuple(start.tolist()), (*goal[:2].tolist(), None if seed % 2 else float(goal[2]))


def lattice_of(problem, headings, anchor=ANCHOR):
    """Return a lattice that is anchored at neither end."""
    return StateLattice(problem.model, problem.world, anchor, STEP, Headings(headings), False)


def solved(problem, graph, reach=1.5 * STEP):
    """Return the candidates on a graph with its ends."""
    space, start, goals = with_ends(graph, problem, reach)
    objectives = edge_objectives(problem.criteria, "test")
    query = Query(space, objectives, space.graph(objectives.optimised), start, goals, 0.0)
    return query.exact("test", Budget())


class Oracle:
    """Lattice and joins as lists of motions, each looked at by fcl every two centimetres or degrees."""

    def __init__(self, problem, headings, anchor=ANCHOR):
        self.problem = problem
        self.fcl = problem.model.judge(problem.world)
        steps = {
            4: [(1, 0), (0, 1), (-1, 0), (0, -1)],
            8: [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)],
        }
        self.steps = steps[headings]
        self.places = {
            (i, j): (anchor[0] + i * STEP, anchor[1] + j * STEP)
            for i, j in itertools.product(range(-4, 7), repeat=2)
            if 0 <= anchor[0] + i * STEP <= 4 and 0 <= anchor[1] + j * STEP <= 3
        }
        self.known = {}
        self.arcs = {}
        self._ends()

    def pose(self, node):
        (i, j), (dx, dy) = node
        return (*self.places[i, j], math.atan2(dy, dx))

    def free(self, a, b):
        if (a, b) not in self.known:
            n = 2 + int(max(math.dist(a[:2], b[:2]) / 0.02, abs(a[2] - b[2]) / math.radians(2.0)))
            x, y, yaw = (np.linspace(p, q, n) for p, q in zip(a, b, strict=True))
            (x0, y0, x1, y1) = self.problem.world.bounds
            inside = ((x > x0) & (x < x1) & (y > y0) & (y < y1)).all()
            self.known[a, b] = bool(inside and self.fcl.states_free(States(x=x, y=y, yaw=yaw)).all())
        return self.known[a, b]

    def add(self, tail, head, poses):
        """Return length, turns over a degree and rotation of a free arc along poses, in quanta, rounded once."""
        if not all(self.free(a, b) for a, b in itertools.pairwise(poses)):
            return
        turned = [abs(b[2] - a[2]) for a, b in itertools.pairwise(poses)]
        length = sum(math.dist(a[:2], b[:2]) for a, b in itertools.pairwise(poses))
        costs = (length, sum(angle > math.radians(1) for angle in turned), sum(turned))
        quanta = [c.quantum for c in self.problem.criteria]
        cost = tuple(math.ceil(c / q - 1e-6) for c, q in zip(costs, quanta, strict=True))
        self.arcs.setdefault(tail, []).append((head, cost))

    def _inside(self):
        for i, j in self.places:
            for step in self.steps:
                x, y, yaw = self.pose(((i, j), step))
                for other in self.steps:
                    if other != step:
                        last = yaw + wrap(math.atan2(*other[::-1]) - yaw)
                        self.add(((i, j), step), ((i, j), other), [(x, y, yaw), (x, y, float(last))])
                to = (i + step[0], j + step[1])
                across = [(i + step[0], j), (i, j + step[1])] if all(step) else []
                if to in self.places and all(any(self.stands(at, h) for h in [step]) for at in across):
                    self.add(((i, j), step), (to, step), [(x, y, yaw), (*self.places[to], yaw)])

    def stands(self, at, step):
        if at not in self.places:
            return False
        pose = self.pose((at, step))
        return self.free(pose, pose)

    def _ends(self):
        start, goal = self.problem.start, self.problem.goal
        nodes = list(itertools.product(self.places, self.steps))
        for node in nodes:
            pose = self.pose(node)
            self.join("start", node, start, pose)
            self.join(node, "goal", pose, goal)
        self.join("start", "goal", start, goal)

    def join(self, tail, head, a, b):
        if math.dist(a[:2], b[:2]) > 1.5 * STEP:
            return
        ahead = a[2] + float(wrap(math.atan2(b[1] - a[1], b[0] - a[0]) - a[2]))
        poses = [a, (*a[:2], ahead), (*b[:2], ahead)]
        if b[2] is not None:
            poses.append((*b[:2], ahead + float(wrap(b[2] - ahead))))
        self.add(tail, head, poses)

    def front(self):
        """Closure of sets of vectors."""
        self._inside()
        sets, waiting = {"start": {(0, 0, 0)}}, ["start"]
        while waiting:
            node = waiting.pop()
            for head, cost in self.arcs.get(node, []):
                longer = {tuple(a + c for a, c in zip(v, cost, strict=True)) for v in sets[node]}
                union = sets.get(head, set()) | longer
                kept = {v for v in union if not any(w != v and all(map(int.__le__, w, v)) for w in union)}
                if kept != sets.get(head, set()):
                    sets[head] = kept
                    waiting.append(head)
        return sorted(sets.get("goal", set()))


ROBOTS = pytest.mark.parametrize(
    ("model", "headings"), [(ROUND, 4), (ROUND, 8), (LONG, 4)], ids=["round-4", "round-8", "long-4"]
)


def rounded(x, y, yaw):
    return round(float(x), 6), round(float(y), 6), round(math.degrees(yaw)) % 360


@pytest.mark.cases("0-round-8", "1-long-4", "2-round-4")
@ROBOTS
@pytest.mark.parametrize("seed", range(3))
def test_joins_and_their_costs_are_those_made_by_hand(model, headings, seed):
    problem = Problem(WORLD, model, *random_ends(seed), CRITERIA)
    space, start, (goal,) = with_ends(lattice_of(problem, headings), problem, 1.5 * STEP)
    graph, s = space.graph(problem.criteria), space.states(np.arange(space.size))
    name = [rounded(*pose) for pose in zip(s.x[:-2], s.y[:-2], s.yaw[:-2], strict=True)] + ["start", "goal"]
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)).tolist()
    arcs = zip(tails, graph.heads.tolist(), graph.costs.tolist(), strict=True)
    found = {(name[tail], name[head], tuple(cost)) for tail, head, cost in arcs if tail == start or head == goal}
    oracle, expected = Oracle(problem, headings), set()
    for tail, by_hand in oracle.arcs.items():
        for head, cost in by_hand:
            ends = (node if isinstance(node, str) else rounded(*oracle.pose(node)) for node in (tail, head))
            expected.add((*ends, cost))
    assert found == expected
    assert len(found) > 8


@pytest.mark.cases("model1-4-0")
@pytest.mark.parametrize(("model", "headings", "seed"), [(ROUND, 4, 6), (LONG, 4, 0)])
def test_fronts_are_those_of_the_joins_made_by_hand_and_end_where_they_are_asked_to(model, headings, seed):
    problem = Problem(WORLD, model, *random_ends(seed), CRITERIA)
    found = solved(problem, lattice_of(problem, headings))
    quanta = [c.quantum for c in problem.criteria]
    expected = Oracle(problem, headings).front()
    assert sorted(tuple(row) for row in np.rint(found.planned / quanta).astype(int).tolist()) == expected
    assert len(expected) > 1
    check(problem, found)


def check(problem, found):
    """Costs re-evaluated equal those planned, no collision by fcl, ends exactly those asked for."""
    front = problem.front(found)
    assert "NOT VALID" not in front.certificate
    assert verify(problem, front) == []
    for trajectory in front.trajectories:
        s = trajectory.states
        assert (s.x[0], s.y[0], s.yaw[0]) == problem.start
        assert (s.x[-1], s.y[-1]) == problem.goal[:2]
        assert problem.goal[2] is None or abs(wrap(s.yaw[-1] - problem.goal[2])) < 1e-9


def test_any_graph_of_states_can_be_joined():
    """A roadmap between other places."""
    other = Problem(WORLD, ROUND, (0.6, 1.5, 0.0), (3.4, 1.5, None), CRITERIA)
    problem = Problem(WORLD, ROUND, *random_ends(0), CRITERIA)
    found = solved(problem, Roadmap(samples=30, seed=1).roadmap(other), 0.8)
    assert found.status is Status.COMPLETE
    assert "the start joined to" in found.certificate
    check(problem, found)


def test_joins_leave_the_groups_of_turns_as_they_are():
    problem = Problem(WORLD, ROUND, *random_ends(1), CRITERIA)
    lattice = lattice_of(problem, 8)
    space, _, _ = with_ends(lattice, problem, 1.5 * STEP)
    alone, beside = (Groups.of(graph.graph(problem.criteria), Clock(Budget(), None)) for graph in (lattice, space))
    assert beside.step == alone.step == 1
    assert beside.rows[:-2].tolist() == alone.rows.tolist()
    assert beside.rows[-2:, 1].tolist() == [1, 1]


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((1.0, 1.0, 0.0), (3.4, 1.8, None)),
        ((1.0, 1.0, 2.356), (3.4, 2.6, 0.785)),  # three decimals
        ((1.0, 1.0, -math.pi / 4), (3.4 + 1e-9, 1.0, math.pi)),
    ],
)
def test_where_start_and_goal_are_states_of_the_lattice_nothing_is_joined(start, goal):
    problem = Problem(WORLD, ROUND, start, goal, CRITERIA)
    planner = Lattice(step=STEP)
    lattice = planner.lattice(problem)
    space, begin, ends = planner.ends(lattice, problem)
    assert space is lattice
    states = lattice.states(np.array([begin, *ends]))
    assert np.hypot(states.x[1:] - goal[0], states.y[1:] - goal[1]).max() < 1e-8
    assert len(ends) == (8 if goal[2] is None else 1)
    assert "joined" not in planner.solve(problem).certificate


def test_a_goal_in_place_but_of_another_heading_takes_one_turn_there():
    problem = Problem(WORLD, ROUND, (1.0, 1.0, 0.0), (3.4, 1.0, 0.5), ["length", "turns"])
    found = Lattice(step=STEP).solve(problem)
    assert found.planned == pytest.approx(np.array([[2.4, 1.0]]), abs=0.01)
    assert found.trajectories[0].states.yaw[-1] == pytest.approx(0.5, abs=1e-12)


def test_turns_of_less_than_a_degree_at_the_ends_count_as_the_criterion_counts_them():
    """The heading at the start is half a degree off: one small turn, and on as the lattice goes."""
    problem = Problem(WORLD, ROUND, (1.0, 1.0, math.radians(0.5)), (3.4, 1.0, None), ["length", "turns"])
    found = Lattice(step=STEP).solve(problem)
    assert found.planned == pytest.approx(np.array([[2.4, 0.0]]), abs=0.01)
    assert found.trajectories[0].kinds == ("turn", "move", "move", "move")


@pytest.mark.seeds(2, of=4)
def test_where_no_cost_charges_for_turns_a_path_with_the_fewest_is_kept(seed):
    """Those of joins count as well: told by asking for the turns too."""
    asked, alone = (Problem(WORLD, ROUND, *random_ends(seed), names) for names in (["length", "turns"], ["length"]))
    both, found = (solved(problem, lattice_of(problem, 8)) for problem in (asked, alone))
    shortest = both.planned[both.planned[:, 0].argmin()]
    assert found.planned.tolist() == [[shortest[0]]]
    assert trajectory_costs(both.objectives, found.trajectories, WORLD)[0, 1] == shortest[1]


def test_start_and_goal_within_reach_of_each_other_are_joined_straight():
    problem = Problem(WORLD, ROUND, (0.9, 0.8, 1.0), (1.2, 1.2, None), CRITERIA)
    found = solved(problem, lattice_of(problem, 8))
    assert [t.kinds for t in found.trajectories] == [("turn", "move")]
    assert found.planned[0, 0] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("goal", [(0.9, 0.8, 1.0), (0.9, 0.8, None)])
def test_a_start_that_is_the_goal_is_so_off_the_lattice_too(goal):
    problem = Problem(WORLD, ROUND, (0.9, 0.8, 1.0), goal, CRITERIA)
    found = solved(problem, lattice_of(problem, 8))
    assert found.planned.tolist() == [[0.0, 0.0, 0.0]]
    assert len(found.trajectories[0]) == 0


@pytest.mark.parametrize(("goal", "kinds"), [((1.0, 1.0, None), ()), ((1.8, 1.0, None), ("turn", "move"))])
def test_a_free_heading_at_a_position_of_the_lattice_takes_no_turn_to_one_of_its_headings(goal, kinds):
    problem = Problem(WORLD, ROUND, (1.0, 1.0, 0.3), goal, ["length", "turns"])
    assert [t.kinds for t in Lattice(step=STEP).solve(problem).trajectories] == [kinds]


def test_the_worst_edge_of_a_join_is_its_worst_motion():
    problem = Problem(WORLD, ROUND, *random_ends(0), ["clearance", "length"])
    check(problem, solved(problem, lattice_of(problem, 8)))


def test_every_planner_on_a_lattice_ends_at_the_goal_and_their_union_compares_like_with_like():
    problem = Problem(WORLD, ROUND, (1.0, 1.0, 0.0), (3.33, 2.47, 1.0), ["length", "turns"])
    planners = [Lattice(step=0.4), Lattice(step=0.8), WeightedSum(step=0.4), {"any-angle": {"step": 0.4}}]
    for planner in planners:
        front = problem.solve(planner)
        assert {(t.states.x[-1], t.states.y[-1]) for t in front.trajectories} == {(3.33, 2.47)}
    front = problem.solve([*planners, {"roadmap": {"samples": 40}}])
    assert not [note for note in front.notes if "goal" in note]
    assert verify(problem, front) == []


def test_the_certificate_names_the_joining():
    problem = Problem(WORLD, ROUND, (1.0, 1.0, 0.3), (3.3, 2.4, None), ["length"])
    found = Lattice(step=STEP).solve(problem)
    counts = found.provenance[0]["joined"]
    both = f"the start joined to {counts['start']} positions and the goal joined to {counts['goal']} positions"
    assert f"{both} within 1.2 m by at most a turn, a move and a turn" in found.certificate
    assert found.notes == ()


def test_where_no_path_leads_to_a_joined_goal_the_wall_between_is_named():
    wall = World.from_polygons([shapely.box(1.95, -1, 2.05, 4)], extent=shapely.box(0, 0, 4, 3))
    problem = Problem(wall, ROUND, (1.0, 1.0, 0.3), (3.33, 2.47, 1.0), ["length"])
    found = Lattice(step=0.4).solve(problem)
    assert found.status is Status.NO_PATH
    assert any("obstacles separate start and goal" in note for note in found.notes)


OFF = Problem(WORLD, ROUND, (1.0, 1.0, 0.3), (3.33, 2.47, 1.0), CRITERIA)
FINE = 0.2


@pytest.fixture(scope="module")
def exact():
    """All that is optimal on a fine lattice."""
    return Lattice(step=FINE).solve(OFF)


def test_a_bound_on_the_turns_counts_those_of_joins(exact):
    most = int(np.median(exact.planned[:, 1]))
    found = Lattice(step=FINE, max_turns=most).solve(OFF)
    assert found.planned.tolist() == exact.planned[exact.planned[:, 1] <= most].tolist()
    none = Lattice(step=FINE, max_turns=int(exact.planned[:, 1].min()) - 1).solve(OFF)
    assert none.status is Status.NO_PATH


def test_a_search_goes_on_from_its_checkpoint_to_the_same_front(exact, tmp_path):
    kept = tmp_path / "kept"
    stopped = Lattice(step=FINE, checkpoint=kept, max_labels=200).solve(OFF)
    assert stopped.status is Status.LABEL_LIMIT
    assert Lattice(step=FINE, checkpoint=kept).solve(OFF).planned.tolist() == exact.planned.tolist()


def test_stages_on_a_part_of_the_lattice_end_at_the_goal_too(exact, monkeypatch):
    monkeypatch.setattr(lattice_planner, "MOST_FIRST", 40)
    monkeypatch.setattr(Spending, "share", lambda spending, seconds: spending.left())  # no stage ends by the clock
    monkeypatch.setattr(exact_search, "_quick_exact_answer", lambda *asked: None)
    fresh = World.from_polygons([shapely.box(1.55, 1.35, 2.4, 1.75)], extent=shapely.box(0, 0, 4, 3))  # nothing kept
    *stages, last = Lattice(step=FINE).stages(replace(OFF, world=fresh))
    assert "positions on the shortest paths" in stages[0].certificate
    for found in (*stages, last):
        assert len(found.planned)
        check(OFF, found)
    assert last.planned.tolist() == exact.planned.tolist()


def test_a_mean_itself_is_optimised_up_to_the_goal():
    problem = Problem(WORLD, ROUND, OFF.start, OFF.goal, ["obstruction", "length"])
    found = Lattice(step=0.4, max_detour=1.2).solve(problem)
    assert len(found.planned) > 1
    check(problem, found)


@pytest.mark.parametrize("heading", [5, 8, 13])
def test_half_a_turn_of_a_join_goes_the_way_round_that_was_checked(heading):
    problem = Problem(WORLD, ROUND, (0.6, 0.6, 0.0), (3.1, 2.0, float(Headings(16).yaw[heading])), CRITERIA)
    lattice = StateLattice(ROUND, WORLD, (3.1 - 0.125, 2.0 + 0.25), 0.25, Headings(16), False)
    space, _, goals = with_ends(lattice, problem, 1.5 * 0.25)
    start, (_, ahead, _, end) = space.joins.corners[0], space.joins.corners
    last = end.yaw - ahead.yaw
    half = np.flatnonzero((space.joins.heads == goals[0]) & (np.abs(np.abs(last) - np.pi) < 1e-6))
    for row in half.tolist():
        states = space.trajectory(np.array([space.joins.tails[row], goals[0]])).states
        assert states.yaw[-1] - states.yaw[0] == pytest.approx(end.yaw[row] - start.yaw[row])


def test_trajectories_made_together_are_those_made_one_by_one():
    problem = Problem(WORLD, ROUND, (1.0, 1.0, 0.3), (3.33, 2.47, 1.0), ["length", "turns", "exposure"])
    for planner in (Lattice(step=0.4), Lattice(step=0.4, headings=16)):
        query = planner.query(problem)
        paths = pareto_paths(query.graph, query.start, query.goals)
        nodes = [paths.nodes(i) for i in range(len(paths))]
        assert len(nodes) > 3
        for path, together in zip(nodes, query.space.trajectories(nodes), strict=True):
            alone = query.space.trajectory(path)
            checked = Trajectory(alone.model, alone.states, alone.kinds)  # looks at each motion by itself
            assert together.kinds == checked.kinds
            for name in ("x", "y", "yaw"):
                column = getattr(together.states, name)
                assert column.tobytes() == getattr(checked.states, name).tobytes()
                assert not column.flags.writeable


def test_all_motions_of_a_law_are_checked_at_once(monkeypatch):
    checks = []
    monkeypatch.setattr(
        "hpop.planners.graphs.trajectory_graph.refuse_impossible", lambda *motions: checks.append(motions[-1].size)
    )
    problem = Problem(WORLD, ROUND, (1.0, 1.0, 0.3), (3.33, 2.47, 1.0), ["length", "turns", "exposure"])
    found = Lattice(step=0.4).solve(problem)
    assert checks == []  # made when they are asked for
    assert sum(map(len, found.trajectories)) == sum(checks)
    assert len(checks) == 2  # turns and moves
