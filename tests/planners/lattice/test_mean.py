"""Claims: under a cap a time-mean is exact on the lattice, and planned is what is re-evaluated."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import shapely

from hpop.base.registry import criteria as registered
from hpop.criteria import Duration, Length, motion_costs
from hpop.criteria.base import criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.models import DifferentialDrive, PanTilt
from hpop.planners.graph_planners import Lattice
from hpop.problems.problem import Problem
from hpop.problems.verify import collision_free
from hpop.runtime.limits import Status
from hpop.world import World

STEP = 0.5
OBSTRUCTION = {"obstruction": {"radius": 0.6}}
ROBOT = DifferentialDrive(radius=0.15, camera_height=0.4, turn_rate=3.0, turn_acceleration=30.0, acceleration=4.0)
Vector = tuple[Fraction | int, ...]


@pytest.fixture
def gloom(monkeypatch):
    """Register a time-mean that names no integral, with another quantum."""
    monkeypatch.setattr(registered, "_types", dict(registered))

    @criterion("gloom", group="P", unit="lux", aggregate="time-mean", quantum=1e-5)
    @dataclass(frozen=True)
    class Gloom:
        def cost(self, m):
            return m.integrate(lambda s: 1.0 + s.base.x**2)

    return Gloom()


def random_problem(seed: int, criteria, size: int = 4) -> Problem:
    """Return a small room with posts between the positions of the lattice, and one post that may stand on one."""
    rng = np.random.default_rng(seed)
    side = (size - 1) * STEP
    while True:
        centres = rng.uniform(-0.2, side + 0.2, (3, 2))
        posts = [shapely.Point(*c).buffer(r) for c, r in zip(centres, rng.uniform(0.05, 0.2, 3), strict=True)]
        world = World.from_polygons(posts, extent=shapely.box(-0.3, -0.3, side + 0.3, side + 0.3))
        if world.clearance(np.array([0.0, side]), np.array([0.0, side])).min() > 0.16:
            return Problem(world, ROBOT, (0.0, 0.0, 0.0), (side, side, None), criteria)


def all_walks(problem: Problem, planner: Lattice) -> tuple[set[Vector], int]:
    """(mean, other costs) in quanta of every walk under the cap, by brute force on the edges' motions; the cap."""
    lattice = planner.lattice(problem)
    (mean,) = (c for c in problem.criteria if c.aggregate == "time-mean")
    others = [c for c in problem.criteria if c is not mean]
    names = ["mean", "duration", *(c.name for c in others)]
    cost, detour = capped(planner)
    place = names.index(cost)
    most = [planner.max_turns if name == "turns" and planner.max_turns is not None else 10**15 for name in names]
    edges: dict[int, list[tuple[int, tuple[int, ...]]]] = {}
    back: dict[int, list[tuple[int, int]]] = {}
    for tails, heads, motions in lattice.batches():
        columns = [
            np.ceil(motion_costs(c, motions) / c.quantum - 1e-6).astype(int) for c in (mean, Duration(), *others)
        ]
        for tail, head, *costs in zip(*(column.tolist() for column in (tails, heads, *columns)), strict=True):
            edges.setdefault(tail, []).append((head, tuple(costs)))
            back.setdefault(head, []).append((tail, costs[place]))
    _, start, goals = planner.ends(lattice, problem)
    left = dict.fromkeys(goals, 0)  # least of what is capped to a goal
    queue = [(0, goal) for goal in goals]
    while queue:
        so_far, node = heapq.heappop(queue)
        for tail, time in back.get(node, ()):
            if so_far + time < left.get(tail, 10**15):
                left[tail] = so_far + time
                heapq.heappush(queue, (so_far + time, tail))
    if start not in left:
        return set(), 0
    cap = int(detour * left[start])
    is_max = [False, False, *(c.aggregate == "max" for c in others)]
    seen = {(start, (0,) * len(is_max))}
    waiting = list(seen)
    while waiting:
        node, g = waiting.pop()
        for head, costs in edges.get(node, ()):
            longer = tuple(max(a, c) if worst else a + c for a, c, worst in zip(g, costs, is_max, strict=True))
            within = all(a <= b for a, b in zip(longer, most, strict=True))
            if within and longer[place] + left.get(head, 10**15) <= cap and (head, longer) not in seen:
                seen.add((head, longer))
                waiting.append((head, longer))
    at = problem.criteria.index(mean)
    walks = {(Fraction(g[0], max(1, g[1])), g[2:]) for node, g in seen if node in goals}
    return {(*rest[:at], ratio, *rest[at:]) for ratio, rest in walks}, cap


def capped(planner: Lattice) -> tuple[str, float]:
    """Return the cost that max_detour caps, and its factor above the least."""
    detour = planner.max_detour
    return next(iter(detour.items())) if isinstance(detour, dict) else ("duration", detour)


def nondominated(vectors: set[Vector]) -> list[Vector]:
    kept: list[Vector] = []
    for v in sorted(vectors):  # what dominates comes first
        if not any(all(a <= b for a, b in zip(w, v, strict=True)) for w in kept):
            kept.append(v)
    return kept


QUESTIONS = [
    ([OBSTRUCTION], 4, 2.4, None),
    (["turns", OBSTRUCTION, "duration"], 4, 2.3, None),
    ([OBSTRUCTION, "turns", "length"], 4, 2.0, 4),
    (["length", "turns", OBSTRUCTION, "clearance"], 4, {"length": 1.7}, 5),
    (["turns", OBSTRUCTION, "length", "rotation", "duration"], 4, {"length": 1.4}, 6),
    ([OBSTRUCTION, "turns", "length"], 8, {"length": 1.2}, 5),
]
MORE = [
    (["turns", OBSTRUCTION, "clearance"], 4, 2.4, None),
    ([OBSTRUCTION, "turns", "length"], 4, 2.4, None),
    ([OBSTRUCTION, "turns", "length"], 8, 1.8, None),
    ([OBSTRUCTION, "turns", "length"], 4, {"length": 1.4}, 6),
]


@pytest.mark.parametrize(
    ("criteria", "headings", "detour", "turns"),
    [*QUESTIONS, *(pytest.param(*question, marks=pytest.mark.proof) for question in MORE)],
)
@pytest.mark.seeds(1, of=4)
def test_the_front_equals_brute_force_over_all_walks_under_the_cap(seed, criteria, headings, detour, turns):
    problem = random_problem(seed, criteria)
    planner = Lattice(step=STEP, headings=headings, max_detour=detour, max_turns=turns)
    found = planner.solve(problem)
    walks, cap = all_walks(problem, planner)
    expected = nondominated(walks)
    assert found.status is (Status.COMPLETE if expected else Status.NO_PATH)
    assert found.objectives == problem.criteria
    planned = sorted(found.planned.tolist())
    means = [c.aggregate == "time-mean" for c in problem.criteria]
    scale = [c.quantum / Duration().quantum if m else c.quantum for c, m in zip(problem.criteria, means, strict=True)]
    exact = sorted([float(x) * q for x, q in zip(v, scale, strict=True)] for v in expected)
    assert len(planned) == len(exact)
    assert np.allclose(planned, exact, rtol=1e-12, atol=1e-12)
    check_trajectories(problem, found, planner, cap * 1e-6)


def check_trajectories(problem, found, planner, cap):
    """Collision-free, as long and with as many turns as allowed, and each costs what was planned."""
    if not found.trajectories:
        return
    assert collision_free(problem, found.trajectories).all()
    costs = trajectory_costs(found.objectives, found.trajectories, problem.world)
    assert (np.abs(costs - found.planned) <= found.tolerance + 1e-12).all()
    sizes = trajectory_costs(
        [{"duration": Duration(), "length": Length()}[capped(planner)[0]]], found.trajectories, problem.world
    )
    for trajectory, tolerance, (size,) in zip(found.trajectories, found.tolerance, sizes, strict=True):
        edges = len(trajectory)
        assert size <= cap + edges * 1e-6
        assert planner.max_turns is None or trajectory.kinds.count("turn") <= planner.max_turns
        place = [c.aggregate for c in found.objectives].index("time-mean")
        assert tolerance[place] <= 2 * edges * 1e-6 / max(trajectory.duration, 1e-6)


@pytest.mark.proof
def test_the_compared_fronts_are_not_trivial_and_hold_means_that_the_integral_misses():
    criteria = [OBSTRUCTION, "turns", "length"]
    sizes, better = [], 0
    for seed in range(4):
        problem = random_problem(seed, criteria)
        exact = Lattice(step=STEP, headings=4, max_detour=2.4).solve(problem)
        if exact.status is Status.NO_PATH:
            continue
        stand_in = problem.solve("lattice", step=STEP, headings=4)
        sizes.append(len(exact.planned))
        better += exact.planned[:, 0].min() < stand_in.reported[:, 0].min() - 1e-6
    assert max(sizes) >= 6
    assert better >= 2


def test_a_front_of_problem_solve_holds_the_mean_itself():
    problem = random_problem(0, [OBSTRUCTION, "turns", "length"])
    front = problem.solve("lattice", step=STEP, headings=4, max_detour=1.6)
    assert front.names == ("obstruction", "turns", "length")
    assert front.reported_names == ()
    cap = front.runs[0]["duration_cap"]
    assert cap == pytest.approx(1.6 * front.runs[0]["least_duration"], abs=1e-6)
    assert front.certificate == (
        f"lattice: exact under duration <= {cap:.6g} s (1.6 times the least) on the lattice of step 0.5 m, 4 headings, "
        "no corner cutting, for (obstruction, turns, length); paths off this graph may be better, and "
        "nothing is claimed beyond the cap; edge costs rounded to their quanta"
    )
    assert all(p["planner"] == "lattice" and p["max_detour"] == 1.6 for p in front.provenance)
    assert not any("stand" in note or "integral" in note for note in front.notes)
    assert front.costs[:, 0].tolist() == pytest.approx(
        [problem.evaluate(t)["obstruction"] for t in front.trajectories], abs=1e-12
    )


def test_a_front_under_a_cap_on_the_length_says_so():
    problem = random_problem(0, [OBSTRUCTION, "turns", "length"])
    front = problem.solve("lattice", step=STEP, headings=4, max_detour={"length": 1.4}, max_turns=5)
    run = front.runs[0]
    assert run["least_length"] == pytest.approx(front.costs[:, 2].min(), abs=1e-5)
    assert run["length_cap"] == pytest.approx(1.4 * run["least_length"], abs=1e-6)
    assert "duration_cap" not in run
    assert front.certificate == (
        f"lattice: exact under length <= {run['length_cap']:.6g} m (1.4 times the least) and at most 5 turns on the "
        "lattice of step 0.5 m, 4 headings, no corner cutting, for (obstruction, turns, length); paths off this "
        "graph may be better, and nothing is claimed beyond the cap; edge costs rounded to their quanta"
    )
    assert all(p["max_detour"] == {"length": 1.4} for p in front.provenance)


def test_turns_that_the_bound_allows_are_spent_where_the_mean_is_low():
    """The least mean under a cap on the length falls with every two turns more: there and back in a good place."""
    problem = random_problem(3, [OBSTRUCTION, "turns", "length"])
    least = [
        Lattice(step=STEP, headings=4, max_detour={"length": 1.0}, max_turns=n).solve(problem).planned[:, 0].min()
        for n in (4, 6, 8, 10)
    ]
    assert all(after < before for before, after in pairwise(least))


def test_a_cap_on_the_duration_may_be_named():
    problem = random_problem(0, [OBSTRUCTION, "turns", "length"])
    named, plain = (problem.solve("lattice", step=STEP, max_detour=d) for d in ({"duration": 1.3}, 1.3))
    assert named.costs.tolist() == plain.costs.tolist()
    assert (named.certificate, named.provenance) == (plain.certificate, plain.provenance)


def test_a_larger_cap_leaves_out_nothing_that_a_smaller_one_has():
    problem = random_problem(1, [OBSTRUCTION, "turns", "length"])
    fronts = [Lattice(step=STEP, headings=4, max_detour=d).solve(problem).planned for d in (1, 1.2, 1.4, 1.7)]
    for small, large in pairwise(fronts):
        for row in small:
            assert (large <= row + 1e-12).all(axis=1).any()
    shortest = Lattice(step=STEP, headings=4, max_detour=1).solve(problem)
    durations = [t.duration for t in shortest.trajectories]
    assert max(durations) == pytest.approx(min(durations), abs=1e-5)


def test_criteria_with_memory_filter_the_front_and_are_not_searched_for():
    problem = random_problem(0, [OBSTRUCTION, "turns", "length", "net_winding"])
    found = Lattice(step=STEP, headings=4, max_detour=1.3).solve(problem)
    assert [c.name for c in found.objectives] == ["obstruction", "turns", "length"]
    assert [c.name for c in found.filters] == ["net_winding"]
    assert found.planned.shape[1] == 3
    assert "net_winding evaluated on these trajectories" in found.certificate


def test_where_no_path_leads_the_walls_are_to_blame():
    wall = shapely.box(0.7, -0.3, 0.8, 1.3)
    world = World.from_polygons([wall], extent=shapely.box(-0.3, -0.3, 1.8, 1.3))
    problem = Problem(world, ROBOT, (0.0, 0.0, 0.0), (1.5, 0.0, None), [OBSTRUCTION, "length"])
    found = Lattice(step=STEP, max_detour=1.3).solve(problem)
    assert found.status is Status.NO_PATH
    assert found.planned.shape == found.tolerance.shape == (0, 2)
    assert not any("cap" in note for note in found.notes)
    assert "duration" not in found.certificate


def test_start_is_goal():
    problem = random_problem(0, [OBSTRUCTION, "length"])
    there = Problem(problem.world, ROBOT, problem.start, (0.0, 0.0, 0.0), problem.criteria)
    front = there.solve("lattice", step=STEP, max_detour=2.0)
    assert front.costs.tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("limit", [1, 40])
def test_a_limit_claims_no_more_than_it_may(limit):
    problem = random_problem(1, [OBSTRUCTION, "turns", "length"])
    found = Lattice(step=STEP, max_detour=1.5, max_labels=limit).solve(problem)
    assert found.status is Status.LABEL_LIMIT
    assert f"incomplete ({found.status}): paths of duration <= " in found.certificate
    assert "others are missing, and may be better" in found.certificate


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.proof)])
def test_ctrl_c_at_any_report_keeps_what_is_found_or_is_passed_on(every):
    problem = random_problem(2, [OBSTRUCTION, "turns", "length"])
    planner = Lattice(step=STEP, max_detour=1.8)
    walks, _ = all_walks(problem, planner)
    passed_on, kept, stop_at = 0, 0, 1
    while True:
        reports = iter(range(1, 10_000))

        def interrupt(_, reports=reports, stop_at=stop_at):
            if next(reports) == stop_at:
                raise KeyboardInterrupt

        try:
            found = planner.solve(problem, interrupt)
        except KeyboardInterrupt:
            passed_on += 1
        else:
            if found.status is Status.COMPLETE:
                break
            assert found.status is Status.INTERRUPTED
            means = {float(mean) for mean, *_ in walks}
            assert all(min(abs(m - mean) for m in means) < 1e-12 for mean in found.planned[:, 0])
            kept += len(found.planned) > 0
        stop_at += every
    assert passed_on
    assert kept


LENGTHS = [{"length": 0.99}, {"length": "1.3"}, {"length": True}, {"width": 1.3}, {}, {"length": 1.3, "duration": 1.2}]


@pytest.mark.parametrize("detour", [0.99, 0, -1.0, float("nan"), float("inf"), 1e9, "1.3", True, *LENGTHS])
def test_a_detour_that_makes_no_sense_is_refused(detour):
    with pytest.raises(
        OptionError, match=r"max_detour must be the longest allowed duration .* from 1 to 1,000, got .*; give"
    ):
        Lattice(max_detour=detour, max_turns=5)


def test_a_cap_on_the_length_alone_is_refused_with_the_reason():
    with pytest.raises(OptionError, match=r"turning in place adds no length.*Give max_turns.*or limit the duration"):
        Lattice(max_detour={"length": 1.3})


def test_a_head_could_turn_back_or_tilt_for_ever_under_a_cap_on_length_and_turns():
    room = World.from_polygons([shapely.box(1.2, 0.8, 1.5, 1.1)], extent=shapely.box(0, 0, 2.6, 2.0))
    ends = (0.5, 0.5, 0.0, 0.0, 0.0), (2.0, 1.5, None, None, None)
    for tilt in ((0.0, 0.0), (-0.2, 0.2)):
        problem = Problem(room, PanTilt(ROBOT, pan=(-1.6, 1.6), tilt=tilt), *ends, [OBSTRUCTION, "turns", "length"])
        with pytest.raises(OptionError, match="take time and add nothing to turns and length"):
            Lattice(step=STEP, headings=4, max_detour={"length": 1.2}, max_turns=3).solve(problem)
        assert len(Lattice(step=STEP, headings=4, max_detour=1.05, max_turns=3).solve(problem).trajectories)


@pytest.mark.parametrize(
    ("criteria", "message"),
    [
        (
            [OBSTRUCTION, "turns", "rotation"],
            "max_detour with 'length' needs the criterion 'length'.* are only turns, rot",
        ),
        ([OBSTRUCTION, "length"], "max_turns needs the criterion 'turns', but the search"),
    ],
)
def test_what_is_bounded_must_be_among_the_criteria(criteria, message):
    with pytest.raises(OptionError, match=message):
        random_problem(0, criteria).solve("lattice", step=STEP, max_detour={"length": 1.3}, max_turns=5)


def test_a_detour_needs_a_time_mean():
    problem = random_problem(0, ["turns", "length"])
    with pytest.raises(OptionError, match="none of turns, length is one; leave max_detour out, or add one such as"):
        problem.solve("lattice", max_detour=1.3)


def test_at_most_four_costs_stand_beside_the_mean():
    names = ["turns", "length", "rotation", "clearance", "duration"]
    four = random_problem(0, [OBSTRUCTION, *names[:4]])
    assert Lattice(step=STEP, headings=4, max_detour=1.1).solve(four).planned.shape[1] == 5
    with pytest.raises(OptionError, match="at most 4 costs beside the mean, got 5"):
        Lattice(max_detour=1.3).solve(random_problem(0, [OBSTRUCTION, *names]))


def test_a_mean_of_ones_own_with_another_quantum(gloom):
    problem = random_problem(2, [gloom, "length"])
    planner = Lattice(step=STEP, headings=4, max_detour=1.5)
    found = planner.solve(problem)
    walks, _ = all_walks(problem, planner)
    exact = sorted((float(m) * 10, n * 1e-6) for m, n in nondominated(walks))
    assert np.allclose(sorted(found.planned.tolist()), exact, rtol=1e-12)
    costs = trajectory_costs(found.objectives, found.trajectories, problem.world)
    assert (np.abs(costs - found.planned) <= found.tolerance + 1e-12).all()


def test_a_second_time_mean_is_refused_by_name(gloom):
    problem = random_problem(0, [OBSTRUCTION, gloom, "length"])
    with pytest.raises(UnsupportedCriterion, match="can minimise one mean over time, got obstruction, gloom"):
        problem.solve("lattice", max_detour=1.3)


def test_without_a_cap_the_integral_stands_in_as_before():
    problem = random_problem(0, [OBSTRUCTION, "turns", "length"])
    found = Lattice(step=STEP, headings=4).solve(problem)
    assert [c.name for c in found.objectives] == ["exposure", "turns", "length"]
    assert "obstruction reported, not optimised" in found.certificate
