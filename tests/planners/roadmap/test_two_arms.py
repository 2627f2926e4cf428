"""Roadmaps in time for two arms: fronts equal all timed paths, plans keep the clock and are free, and bad questions."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import hpop
from hpop.cli import main
from hpop.errors import OptionError, QueryError, UnsupportedModel
from hpop.goals import Anywhere
from hpop.motions import Motions, States
from hpop.planners.graphs.roadmap import drawn_views, is_free_ending, timeless_problem
from hpop.planners.graphs.roadmap.configurations import configuration_roadmap
from hpop.planners.graphs.roadmap.survey import survey
from hpop.planners.spending import Spending
from hpop.problems.verify import verify
from tests.models.serial_arm.arms import HERE as ARM
from tests.models.serial_arm.arms import arm6
from tests.two_arms import BESIDE, TABLE, camera_at, share_done, sweep, tool_at, two_arms

LOOK, ROTATE, FAR = {"look_at": {"target": "work_tool"}}, "rotation", {"view_distance": {"target": "work_tool"}}
HOME = arm6().space.named["home"]
SAMPLES = 50  # of a motion, in the oracle


class Oracle:
    """All timed paths of a roadmap of the viewing arm alone, listed by brute force with pinocchio's frames.

    Collisions are sampled by python-fcl.
    """

    def __init__(self, problem, seed, samples, neighbours, far, steps):
        alone = timeless_problem(problem)
        found = survey(alone, 0 if is_free_ending(problem) else None, seed, Spending())
        views = drawn_views(problem, alone, samples, seed)
        rest = max(1, samples - views.size)
        still = configuration_roadmap(found, rest, neighbours, far, Spending(), views)
        self.problem, self.steps, self.arms = problem, steps, problem.model
        self.rows = np.stack([getattr(still.nodes, name) for name in self.arms.joints], axis=1)
        self.links = [(a, b) for a, b in still.links.tolist()] + [(a, a) for a in range(len(self.rows))]
        self.goals = range(len(self.rows)) if is_free_ending(problem) else still.goals
        self.tick = self.arms.motion.duration / steps
        self.chain, self.judge = self.arms.view.chain, self.arms.judge(problem.world)

    def lasts(self, a, b):
        way = self.rows[b] - self.rows[a]
        least = share_done(way, self.chain.speed, self.chain.acceleration, np.zeros(1))[1]
        return max(1, math.ceil(least / self.tick - 1e-9))

    def is_free(self, a, b, step):
        start, end = (
            States(
                **{n: np.array([v]) for n, v in zip(self.arms.joints, self.rows[c], strict=True)},
                pace=np.zeros(1),
                time=np.array([t]),
            )
            for c, t in ((a, step * self.tick), (b, (step + self.lasts(a, b)) * self.tick))
        )
        return bool(self.judge.motions_free(Motions(self.problem.world, self.arms, self.arms.law, start, end))[0])

    def costs(self, a, b, step):
        """Integrals of the angle to the tool, of the camera's rotation and of the distance beyond the band."""
        u = np.linspace(0, 1, SAMPLES + 1)
        done, _ = share_done(self.rows[b] - self.rows[a], self.chain.speed, self.chain.acceleration, u)
        given, angles, beyond, frames = self.arms.motion.describe(), [], [], []
        for share, part in zip(u, done, strict=True):
            time = (step + share * self.lasts(a, b)) * self.tick
            camera = camera_at(self.rows[a] + part * (self.rows[b] - self.rows[a]), self.arms.view.base)
            tool = tool_at([np.interp(time, given["times"], column) for column in given["joints"].values()])
            off = tool[:3, 3] - camera[:3, 3]
            angles.append(np.arctan2(np.linalg.norm(np.cross(camera[:3, 0], off)), camera[:3, 0] @ off))
            beyond.append(max(0.2 - np.linalg.norm(off), np.linalg.norm(off) - 0.6, 0.0))
            frames.append(camera[:3, :3])
        turned = [0.5 * np.linalg.norm(after.T @ before - before.T @ after) for before, after in pairwise(frames)]
        rotation = np.arcsin(np.minimum(1.0, np.array(turned) / math.sqrt(2.0))).sum()
        lasts = self.lasts(a, b) * self.tick
        return np.array([np.trapezoid(angles, u) * lasts, rotation, np.trapezoid(beyond, u) * lasts])

    def vectors(self):
        """Cost vectors of all timed paths from the start to a goal at the last step, one by one."""
        arcs = self.arcs = dict[tuple[int, int, int], np.ndarray | None]()
        found, stack = [], [(0, 0, np.zeros(3))]
        while stack:
            node, step, cost = stack.pop()
            if step == self.steps:
                found += [cost] * (node in self.goals)
                continue
            for a, b in self.links:
                if a != node or step + self.lasts(a, b) > self.steps:
                    continue
                if (a, b, step) not in arcs:
                    arcs[a, b, step] = self.costs(a, b, step) if self.is_free(a, b, step) else None
                if (paid := arcs[a, b, step]) is not None:
                    stack.append((b, step + self.lasts(a, b), cost + paid))
        return np.array(found)


ENDS = {"anywhere": Anywhere(), "ready": "ready", "either": ["ready", HOME]}


@pytest.mark.parametrize(
    ("seed", "goal", "near", "samples"),
    [
        pytest.param(1, "anywhere", 0.6, 7, marks=pytest.mark.proof),
        pytest.param(1, "anywhere", 0.4, 7, marks=pytest.mark.proof),
        pytest.param(0, "ready", 0.6, 12, marks=pytest.mark.proof),
        pytest.param(3, "either", 0.4, 12, marks=pytest.mark.proof),
    ],
)
def test_a_front_is_that_of_all_timed_paths(seed, goal, near, samples):
    """Oracle and planner share only the roadmap of the viewing arm alone. Sampled costs are off by up to 0.01.

    In these cases no least distance of a motion is between 0 and 2 mm, where proof and samples may disagree.
    """
    pytest.importorskip("pinocchio")
    arms = two_arms(view=arm6(base=(0.1, near, 0, 0, 0, -0.4)), step=0.4, motion=sweep(times=(0, 1.0, 2.8)))
    problem = hpop.Problem(TABLE, arms, HOME, ENDS[goal], [LOOK, ROTATE, FAR])
    options = {"samples": samples, "neighbours": 2, "far": 1, "seed": seed}
    front = problem.solve("roadmap", **options)
    oracle = Oracle(problem, seed, samples, 2, 1, steps=7)
    every = oracle.vectors()
    open_at, shut_at = (
        {arc[:2] for arc, paid in oracle.arcs.items() if (paid is None) is shut} for shut in (False, True)
    )
    assert open_at & shut_at  # motions that the working arm blocks at some times
    assert len(every) > 20
    assert len(front) > 1
    for costs in front.costs:  # each is the cost of some timed path
        assert np.abs(every - costs).max(axis=1).min() < 0.01
    for vector in every:  # none is better
        assert ((front.costs <= vector + 0.01).all(axis=1)).any()
    assert not verify(problem, front)


@pytest.mark.proof
def test_plans_keep_the_clock_and_come_out_as_planned():
    arms = two_arms(step=0.2)
    criteria = [LOOK, ROTATE, FAR, {"occlusion": {"target": "work_tool", "rays": 7}}]
    problem = hpop.Problem(TABLE, arms, "home", Anywhere(), criteria)
    front = problem.solve("roadmap", samples=30)
    assert len(front) > 3
    assert not verify(problem, front)
    for trajectory in front.trajectories:
        assert np.allclose(trajectory.times, trajectory.states.time, atol=1e-9)
        assert np.allclose(np.mod(trajectory.times + 1e-9, 0.2), 0, atol=1e-8)
        assert trajectory.duration == pytest.approx(2.0)
    assert "at 11 times 0.2 s apart, with waits" in front.certificate
    assert any("working arm is taken to move exactly as given" in note for note in front.notes)
    assert front.costs[:, 1].min() == 0.0  # to stay is a plan, and to follow the tool is another
    assert front.costs[:, 0].min() < 0.6 * front.costs[:, 0].max()


def test_a_saved_front_is_read_and_verified_again(tmp_path):
    problem = hpop.Problem(TABLE, two_arms(), "home", "ready", [LOOK, ROTATE])
    front = problem.solve("roadmap", samples=20)
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    assert np.array_equal(again.costs, front.costs)
    assert not verify(problem, again)


AT = dict(zip(arm6().joints, HOME, strict=True))
FACING = {"motion": sweep([[0, 0.6, 1.2]] * 2, (0, 1)), "view": arm6(base=(0.5, 0, 0, 0, 0, np.pi))}


def test_a_scenario_is_planned_and_shown_from_the_command_line(tmp_path, monkeypatch):
    monkeypatch.setattr("hpop.view.save_pictures", lambda *given, **options: [])  # have tests of their own
    arm = {"urdf": str(ARM / "arm6.urdf"), "srdf": str(ARM / "arm6.srdf"), "tip": "tool", "acceleration": 6}
    arms, motion = {"work": {"serial_arm": arm}, "view": {"serial_arm": arm | {"base": list(BESIDE)}}}, sweep()
    columns = {"t": motion["times"], **motion["joints"]}
    lines = [[f"{name} (rad)" if name != "t" else "t (s)" for name in columns], *zip(*columns.values(), strict=True)]
    (tmp_path / "work.csv").write_text("\n".join(",".join(map(str, line)) for line in lines))
    scenario = {
        "world": {"solids": {"obstacles": [{"name": "table", "box": [1.0, 2.4, 0.04], "position": [0.2, 0.5, -0.03]}]}},
        "model": {"two_arms": arms | {"motion": "work.csv"}},
        "start": list(HOME),
        "goal": {"anywhere": {}},
        "criteria": [ROTATE, LOOK],
        "planner": {"roadmap": {"samples": 20}},
    }
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(scenario))
    planned = CliRunner().invoke(main, ["plan", str(tmp_path / "two.yaml"), "--out", str(tmp_path / "out")])
    assert planned.exit_code == 0, planned.output
    shown = CliRunner().invoke(main, ["show", str(tmp_path / "out")])
    assert shown.exit_code == 0, shown.output
    assert "verified" in shown.output


@pytest.mark.cases("exact")
@pytest.mark.parametrize("planner", ["weighted-sum", "exact"])
def test_other_searches_find_points_of_the_front(planner):
    problem = hpop.Problem(TABLE, two_arms(), "home", Anywhere(), [LOOK, ROTATE])
    front = problem.solve("roadmap", samples=20)
    others = problem.solve({planner: {"on": {"roadmap": {"samples": 20}}}})
    assert 1 < len(others) <= len(front)
    for costs in others.costs:
        assert np.abs(front.costs - costs).max(axis=1).min() < 1e-6


@pytest.mark.parametrize(
    ("arms", "start", "goal", "words"),
    [
        (FACING, (0, 0.6, 1.2, 0, 0, 0), Anywhere(), "of the working arm at 0 s"),
        ({}, AT | {"time": 0.5}, Anywhere(), "the time of the start must be 0 s"),
        ({}, HOME, AT | {"time": 1.0}, "the time of a goal must be 2 s"),
        ({"motion": sweep(times=(0, 0.1, 0.2))}, "home", "upright", "no goal can be reached within 0.2 s"),
    ],
)
def test_refused(arms, start, goal, words):
    problem = hpop.Problem(TABLE, two_arms(**arms), start, goal, [LOOK, ROTATE])
    with pytest.raises(QueryError, match=words):
        problem.solve("roadmap", samples=10)


@pytest.mark.proof
def test_a_front_without_a_view_of_the_target_says_so():
    arms = two_arms(view=arm6(base=(4.0, 0, 0, 0, 0, 0)))
    problem = hpop.Problem(TABLE, arms, "home", Anywhere(), [LOOK, ROTATE])
    front = problem.solve("roadmap", samples=20)
    assert len(front)
    assert any("in no state that was found does the camera look at the work_tool" in note for note in front.notes)


def test_other_planners_refuse_two_arms():
    problem = hpop.Problem(TABLE, two_arms(), "home", "ready", [LOOK, ROTATE])
    for planner in ("lattice", "spline", "rrt"):
        with pytest.raises((QueryError, OptionError, UnsupportedModel)):
            problem.solve(planner)
