"""Splines of a small arm before a shelf: proved free by two codes, no worse than their paths, costs as planned."""

import itertools
import signal
import time
from concurrent.futures import Executor, Future

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError, UnsupportedCriterion, UnsupportedModel
from hpop.models.serial_arm import SerialArm
from hpop.motions import States
from hpop.planners.base import make_planner
from hpop.planners.programs import Deadline
from hpop.planners.programs.spline.job import FRACTIONS, SplineJob
from hpop.planners.programs.spline.knots import Knots, PieceCosts
from hpop.planners.programs.spline.step import Aim, StepPrograms
from hpop.planners.spending import Spending
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world.geometry.solids import Box, Solid

CRITERIA = ["duration", "rotation", {"look_at": {"target": [0.6, 0.0, 0.5]}}]
PATHS = (
    (
        (-0.87, 1.51, -1.03, 1.54, 1.87, -0.57),
        (-1.57, 1.24, -1.20, 0.73, 0.83, -0.75),
        (0.70, 0.27, 0.63, -1.70, 1.54, 1.40),
    ),
    (
        (1.19, 1.01, 0.46, -0.10, -1.54, 0.97),
        (1.20, 1.40, 1.07, 0.45, -1.35, 1.30),
        (-1.56, 0.91, 2.27, 2.06, -0.90, -0.21),
    ),
)


def board(x, y, z, size):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return Solid(Box(size), pose)


@pytest.fixture(scope="module")
def world():
    sides = [board(0.6, y, 0.5, (0.3, 0.02, 0.6)) for y in (0.4, -0.4)]
    boards = [board(0.6, 0.0, z, (0.3, 0.8, 0.02)) for z in (0.35, 0.75)]
    return hpop.World.from_solids([*sides, *boards, board(0.0, 0.0, -0.06, (2.0, 2.0, 0.1))])


@pytest.fixture(scope="module")
def arm():
    return SerialArm.from_urdf("examples/arm/arm6.urdf", srdf="examples/arm/arm6.srdf", tip="tool", acceleration=3.0)


@pytest.fixture(scope="module")
def paths(arm):
    return [Trajectory.through(arm, States(**dict(zip(arm.space.names, np.array(p).T, strict=True)))) for p in PATHS]


@pytest.fixture(scope="module", params=[0, pytest.param(1, marks=pytest.mark.proof)])
def planned(request, arm, world, paths):
    """Return a problem, its path, and the planner's result for it."""
    rows = PATHS[request.param]
    problem = hpop.Problem(world, arm, rows[0], rows[-1], CRITERIA)
    planner = make_planner({"spline": {"warm_start": [paths[request.param]], "pieces": 4}})
    return problem, paths[request.param], planner.solve(problem)


def test_a_spline_is_better_than_its_path_and_the_path_stays(planned):
    problem, path, found = planned
    *splines, stays = found.trajectories
    assert stays is path
    before = np.array(list(problem.evaluate(path).values()))
    for spline in splines:
        assert set(spline.kinds) == {"spline"}
        costs = np.array(list(problem.evaluate(spline).values()))
        assert (costs <= before).all()
        assert costs.sum() < 0.9 * before.sum()
    assert found.status is Status.COMPLETE
    assert path not in problem.front(found).trajectories


def test_one_spline_is_for_all_costs_alike_and_each_that_follows_lowers_a_cost(planned):
    _, _, found = planned
    splines = found.planned[:-1]
    assert 1 < len(splines) <= 1 + splines.shape[1]
    assert all((after < before).any() for before, after in itertools.pairwise(splines))


def test_what_was_planned_is_what_the_trajectory_costs(planned):
    problem, _, found = planned
    costs = [list(problem.evaluate(trajectory).values()) for trajectory in found.trajectories]
    np.testing.assert_allclose(found.planned, costs, rtol=0.01)


def test_it_is_free_by_the_judge_and_keeps_the_limits_of_all_joints(planned):
    problem, _, found = planned
    spline = found.trajectories[0]
    judge = problem.model.judge(problem.world)
    assert all(judge.motions_free(m).all() for _, m in spline.batches(problem.world))
    assert list(problem.model.faults(spline)) == []
    rates, changes = spline.rates(np.linspace(0.0, spline.duration, 5000))
    for i, name in enumerate(problem.model.space.names):
        assert np.abs(getattr(rates, name)).max() <= problem.model.chain.speed[i] * (1 + 1e-9)
        assert np.abs(getattr(changes, name)).max() <= problem.model.chain.acceleration[i] * (1 + 1e-9)


@pytest.mark.proof
def test_minimising_one_cost_makes_that_smaller(arm, world, paths):
    problem = hpop.Problem(world, arm, PATHS[1][0], PATHS[1][-1], CRITERIA)

    def costs(minimise):
        planner = make_planner({"spline": {"warm_start": [paths[1]], "minimise": minimise, "pieces": 4}})
        return problem.evaluate(planner.solve(problem).trajectories[0])

    by_time, by_rotation = costs("duration"), costs("rotation")
    assert by_time["duration"] < by_rotation["duration"]
    assert by_rotation["rotation"] < by_time["rotation"]


def test_steps_keep_limits_and_gradients_are_those_of_the_costs(arm, world, paths):
    """Any solution of a program keeps speeds and accelerations in the time that it names itself."""
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], CRITERIA)
    pieces = PieceCosts(world, arm, problem.criteria)
    law, collision = pieces.law, arm.collision(world)
    knots = Knots.along(paths[0], law, 8)
    rng = np.random.default_rng(0)
    rows = np.concatenate([knots.at(fraction) for fraction in FRACTIONS.tolist()])
    apart = collision.separations(States(**dict(zip(law.names, rows.T, strict=True))), 0.15)
    slopes = pieces.slopes(knots)
    steps = StepPrograms(knots.shares, law, np.array(arm.space.low), np.array(arm.space.high))
    aim = Aim(np.array([0.0, 1.0, 0.0]), slopes.costs, slopes.costs)
    bends = pieces.curvature(knots, aim.weights / aim.scale, 1e-4)
    program = steps.of(knots, aim, slopes, bends, apart, 0.004, FRACTIONS)
    for distance in (0.02, 0.2, 0.6):
        taken = program.within(distance, np.inf)
        assert np.abs(taken.values).max() <= distance * (1 + 1e-6)
        moved = knots.moved(taken.values, taken.slopes, law)
        assert moved.duration <= knots.duration + taken.duration + 1e-5
        assert moved.within(np.array(arm.space.low) - 1e-5, np.array(arm.space.high) + 1e-5)
    move = rng.normal(size=(2, knots.shares.size - 1, len(law.names)))
    step = 1e-6
    costs = [pieces.costs(knots_moved(knots, sign * step * move)) for sign in (1.0, -1.0)]
    direction = np.concatenate([*move], axis=1).ravel()
    np.testing.assert_allclose(
        program.gradients[:, :-1] @ direction, (costs[0] - costs[1]) / (2 * step), rtol=1e-4, atol=1e-4
    )


def knots_moved(knots, move):
    """Move the inner knots in the same time."""
    values, slopes = knots.values.copy(), knots.slopes.copy()
    values[1:-1] += move[0]
    slopes[1:-1] += move[1]
    return Knots(values, slopes, knots.shares, knots.duration)


def test_distances_have_the_gradients_that_differences_say(arm, world):
    collision, rng = arm.collision(world), np.random.default_rng(5)
    states = arm.space.sample(rng, 60)
    apart = collision.separations(states, 0.2)
    assert apart.owner.size > 60
    free = np.flatnonzero(apart.distance > 0.01)[:100]
    step = 1e-4
    for i, name in enumerate(arm.space.names):
        moved = []
        for off in (step, -step):
            columns = {n: getattr(states, n) for n in states.names} | {name: getattr(states, name) + off}
            moved.append(collision.separations(States(**columns), 0.25))
        # The same pairs, one by one: those of a state are in the same order.
        for row in free.tolist():
            owner = apart.owner[row]
            near = [np.sort(one.distance[one.owner == owner]) for one in moved]
            predicted = apart.distance[row] + step * apart.gradient[row, i] * np.array([1.0, -1.0])
            for distances, expected in zip(near, predicted, strict=True):
                assert np.abs(distances - expected).min() < 5e-6


def test_a_path_that_cannot_be_a_spline_stays_and_is_counted(arm, world):
    """A motion of one joint at its limits has no equally quick spline of few pieces."""
    start, goal = arm.space.named["ready"], (1.0, *arm.space.named["ready"][1:])
    ends = States(**dict(zip(arm.space.names, np.array([start, goal]).T, strict=True)))
    path = Trajectory.through(arm, ends)
    problem = hpop.Problem(world, arm, start, goal, ["duration"])
    found = make_planner({"spline": {"warm_start": [path], "pieces": 3}}).solve(problem)
    assert [trajectory.kinds for trajectory in found.trajectories] == [("reach",)]
    assert [note for note in found.notes if "the path stays" in note] == [
        "1 path without a candidate: no step costs less than its path (the path stays)"
    ]


def test_a_cost_that_is_known_on_numbers_alone_comes_as_it_comes(arm, world, paths):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration", {"exposure": {"radius": 0.3}}])
    found = make_planner({"spline": {"warm_start": [paths[0]], "pieces": 2}}).solve(problem)
    assert any(note.startswith("exposure is computed for each spline, but not aimed at (") for note in found.notes)
    costs = [list(problem.evaluate(trajectory).values()) for trajectory in found.trajectories]
    np.testing.assert_allclose(found.planned, costs, rtol=0.01, atol=1e-9)


@pytest.mark.proof
def test_a_worker_does_the_same(arm, world, paths):
    import pickle

    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], CRITERIA)
    job = SplineJob(problem, problem.criteria, (0, 1, 2), 0, 2)
    here, there = (one.solve(paths[0]).candidate for one in (job, pickle.loads(pickle.dumps(job))))
    np.testing.assert_array_equal(*([one.planned for one in splines] for splines in (here, there)))


def test_knots_where_phases_end_leave_a_path_as_it_is(arm, world, paths):
    law = arm.laws["spline"]
    for count in (2, 12):
        knots = Knots.along(paths[0], law, count)
        assert knots.duration == pytest.approx(paths[0].duration, rel=1e-12)
        spline, moments = knots.trajectory(arm, law), np.linspace(0.0, paths[0].duration, 50)
        for name in arm.space.names:
            np.testing.assert_allclose(
                getattr(spline.at(moments), name), getattr(paths[0].at(moments), name), atol=1e-9
            )


def interrupted_at(number, monkeypatch):
    """Ctrl-C as the nth step of sequential programming begins."""
    of, calls = StepPrograms.of, []

    def interrupting(steps, *arguments):
        calls.append(steps)
        if len(calls) == number:
            signal.raise_signal(signal.SIGINT)
        return of(steps, *arguments)

    monkeypatch.setattr(StepPrograms, "of", interrupting)


def test_ctrl_c_between_two_steps_keeps_what_they_certified(arm, world, paths, monkeypatch):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], CRITERIA)
    planner = make_planner({"spline": {"warm_start": [paths[0], paths[0]], "pieces": 2, "minimise": "duration"}})
    interrupted_at(4, monkeypatch)
    found = planner.solve(problem)
    spline, *stay = found.trajectories
    assert found.status is Status.INTERRUPTED
    assert stay == [paths[0], paths[0]]
    assert spline.duration < paths[0].duration
    assert all(arm.judge(world).motions_free(m).all() for _, m in spline.batches(world))
    assert found.certificate.startswith("spline: the best of 1 spline and 2 paths, 1 not smoothed yet; each spline is")


def test_ctrl_c_on_the_second_of_two_paths_that_are_one_keeps_what_the_first_became(arm, world, paths, monkeypatch):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    options = {"pieces": 2, "minimise": "duration"}
    first = make_planner({"spline": {"warm_start": [paths[0]], **options}}).solve(problem)
    interrupted_at(first.stats["steps"] + 3, monkeypatch)
    found = make_planner({"spline": {"warm_start": [paths[0]] * 2, **options}}).solve(problem)
    assert found.status is Status.INTERRUPTED
    assert [one["warm_start"] for one in found.provenance if one["pieces"]] == [0, 1]
    np.testing.assert_array_equal(found.planned[0], first.planned[0])


class Outside(Executor):
    """Does a task at once, then lets something happen before its result is handed over."""

    def __init__(self, happens):
        self.happens = happens

    def submit(self, fn, /, *arguments):
        done = Future()
        done.set_result(fn(*arguments))
        self.happens()
        return done


def test_ctrl_c_with_workers_keeps_all_paths(arm, world, paths):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    planner = make_planner({"spline": {"warm_start": [paths[0]] * 2, "pieces": 2, "minimise": "duration"}})
    found = planner.solve(problem, executor=Outside(lambda: signal.raise_signal(signal.SIGINT)))
    assert (found.status, found.trajectories) == (Status.INTERRUPTED, (paths[0], paths[0]))
    assert "interrupted: 2 paths not smoothed" in found.notes


def test_what_workers_certified_until_the_limit_is_waited_for(arm, world, paths, monkeypatch):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    seconds = [0.0]
    monkeypatch.setattr(Spending, "seconds", lambda spending: seconds[0])
    options = {"warm_start": [paths[0]], "pieces": 2, "minimise": "duration", "time_limit": 60.0}
    planner = make_planner({"spline": options})
    found = planner.solve(problem, executor=Outside(lambda: seconds.append(seconds.pop() + 60.1)))
    assert [set(one.kinds) for one in found.trajectories] == [{"spline"}, {"reach"}]


def test_time_that_goes_by_while_a_stage_is_drawn_is_not_taken_from_the_splines(arm, world, paths, monkeypatch):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    options = {"warm_start": [paths[0]], "pieces": 2, "minimise": "duration", "time_limit": 60.0}
    answers, now = make_planner({"spline": options}).stages(problem), time.monotonic
    next(answers)
    monkeypatch.setattr(time, "monotonic", lambda: now() + 1000.0)
    assert [set(one.kinds) for one in next(answers).trajectories] == [{"spline"}, {"reach"}]


@pytest.mark.parametrize("jump", [-1e6, 1e6])
def test_a_wall_clock_that_is_set_neither_ends_nor_prolongs_the_work(arm, world, paths, monkeypatch, jump):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    job = SplineJob(problem, problem.criteria, (0,), 0, 2, deadline=Deadline.after(-1.0))
    options = {"warm_start": [paths[0]], "pieces": 2, "minimise": "duration", "time_limit": 60.0}
    answers, now = make_planner({"spline": options}).stages(problem), time.time
    next(answers)
    ahead = Deadline.after(3600.0)
    monkeypatch.setattr(time, "time", lambda: now() + jump)
    assert not ahead.is_past
    assert job.solve(paths[0]).reason == "no time was left"
    assert [set(one.kinds) for one in next(answers).trajectories] == [{"spline"}, {"reach"}]


def test_no_spline_is_found_twice(planned):
    _, _, found = planned
    for one, other in itertools.combinations(found.trajectories, 2):
        assert one.describe() != other.describe()


def test_the_paths_are_the_first_answer_and_splines_follow(arm, world, paths):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], CRITERIA)
    planner = make_planner({"spline": {"warm_start": [paths[0]] * 2, "pieces": 2, "minimise": "duration"}})
    first, second, last = planner.stages(problem)
    assert [one.status for one in (first, second, last)] == [Status.UNFINISHED, Status.UNFINISHED, Status.COMPLETE]
    assert first.trajectories == (paths[0], paths[0])
    assert [len(one.trajectories) for one in (second, last)] == [3, 4]


@pytest.mark.proof
def test_time_that_is_over_leaves_the_paths_and_no_step_begins(arm, world, paths):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], CRITERIA)
    job = SplineJob(problem, problem.criteria, (0, 1, 2), 0, 2, deadline=Deadline.after(-1.0))
    outcome = job.solve(paths[0])
    assert (outcome.candidate, outcome.reason, outcome.counts["programs"]) == (None, "no time was left", 0)
    found = make_planner({"spline": {"warm_start": [paths[0]], "time_limit": 1e-9}}).solve(problem)
    assert found.status is Status.TIME_LIMIT
    assert found.trajectories == (paths[0],)
    assert "time limit: 1 path not smoothed" in found.notes
    front = problem.solve("spline", warm_start=[paths[0]], time_limit=1e-9)
    assert "earlier stages" not in front.certificate  # which had no other points


@pytest.mark.parametrize("stage", ["checking", "graph"])
def test_ctrl_c_while_the_roadmap_is_planned_keeps_what_it_found(stage, arm, world):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    seen = []

    def stop(progress):
        seen.append(progress.stage)
        if seen.count("graph") == 2 and progress.stage == stage:
            signal.raise_signal(signal.SIGINT)

    front = problem.solve("spline", warm_start={"roadmap": {"samples": 20}}, progress=stop)
    assert Status.INTERRUPTED in front.status
    assert len(front)
    assert not any("spline" in one.kinds for one in front.trajectories)


def test_ctrl_c_while_the_paths_are_re_evaluated_keeps_them(arm, world, paths, monkeypatch):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    front = hpop.Problem.front

    def interrupted(problem, candidates, progress=None):
        monkeypatch.setattr(hpop.Problem, "front", front)
        raise KeyboardInterrupt

    monkeypatch.setattr(hpop.Problem, "front", interrupted)
    found = problem.solve("spline", warm_start={"roadmap": {"samples": 20}})
    assert found.status == "interrupted"
    assert found.certificate.startswith(problem.solve("roadmap", samples=20).certificate)  # of its last stage


def test_robots_without_splines_and_costs_without_gradients_are_refused(arm, world, paths):
    plane = hpop.World.from_polygons([], extent=shapely.box(0, 0, 5, 5))
    with pytest.raises(UnsupportedModel, match="spline"):
        hpop.Problem(plane, hpop.DifferentialDrive(), (1, 1, 0), (4, 4, None), ["length"]).solve("spline")
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    with pytest.raises(OptionError, match="minimise"):
        problem.solve("spline", minimise="rotation", warm_start=paths)
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], [{"occlusion": {"target": [0.6, 0.0, 0.5]}}])
    with pytest.raises(UnsupportedCriterion, match="gradient"):
        problem.solve("spline", warm_start=paths)


def test_a_planner_of_paths_that_does_not_serve_the_robot_is_refused_by_name(arm, world):
    problem = hpop.Problem(world, arm, PATHS[0][0], PATHS[0][-1], ["duration"])
    with pytest.raises(
        UnsupportedModel, match=r"lattice needs a model with plane, turn-move, .* Planners that can use this model: "
    ):
        problem.solve("spline", warm_start="lattice")
