"""Speeds on roadmaps of configurations: fronts are those of all choices of speed for all chains, by own enumeration.

Links, motions, classes and the timing of reaches and runs are computed here; only the criteria are hpop's, each on one
motion at a time. The nodes are those that the roadmap has drawn.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.cli.report import driven_speeds
from hpop.criteria import trajectory_cost
from hpop.errors import ModelError, UnsupportedModel
from hpop.export.base import jerk_limited
from hpop.motions import Model, States
from hpop.planners import Roadmap
from hpop.planners.graphs.roadmap.configurations import ConfigurationRoadmap
from hpop.problems.verify import verify
from hpop.testing import check_model
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Box, Solid, World, pose_at
from tests.models.serial_arm.arms import arm6

POST = World.from_solids([Solid(Box((0.1, 0.1, 0.9)), pose_at((0.55, 0, 0.45)), "post")])
PILLAR = hpop.World.from_polygons([shapely.box(2.4, 1.5, 2.8, 2.6)], extent=shapely.box(0, 0, 5, 4))
ON_TOP = (0.0, 0.0, 0.45, 0.0, 0.0, 0.0)
BASE = hpop.DifferentialDrive(radius=0.3, body_height=0.4, speeds=(0.4, 1.0), turn_rates=(0.5, 1.5))
CARRIER = hpop.DifferentialDrive(radius=0.25, speeds=(0.3, 0.6, 1.0), turn_rates=(0.5, 1.5))
HEAD = hpop.PanTilt(CARRIER, pan=(-1.5, 2.0), tilt=(-0.5, 0.3))
ARM = arm6(velocity_scaling=(0.3, 0.5, 1.0))
MOBILE = hpop.MobileArm(arm6(base=ON_TOP, velocity_scaling=(0.4, 1.0)), BASE)
ENDS: dict[Model, Any] = {
    ARM: (POST, (-0.9, 0.6, 1.2, 0, -0.2, 0), (0.9, 0.3, 1.0, 0, 0.2, 0.1)),
    HEAD: (PILLAR, (0.8, 2.0, 0.3, 1.0, 0.0), (4.2, 2.1, -1.1, 0.5, -0.2)),
    MOBILE: (PILLAR, (0.8, 2.0, 0.3, *(0.1,) * 6), (4.2, 2.1, -1.1, *(0.4,) * 6)),
}
NAMES = {ARM: "arm", HEAD: "pan-tilt", MOBILE: "mobile arm"}
CRITERIA = ["duration", "felt_acceleration"]
Costs = tuple[int, ...]


def asked(model: Model, criteria: Any = CRITERIA) -> hpop.Problem:
    world, start, goal = ENDS[model]
    return hpop.Problem(world, model, start, goal, criteria)


def rows_of(states: States) -> list[tuple[float, ...]]:
    return list(zip(*(column.tolist() for column in states.__dict__.values()), strict=True))


class Oracle:
    """Front by brute force: all chains of motions in all classes, with labels that are compared one by one."""

    def __init__(self, problem: hpop.Problem) -> None:
        self.problem, self.model = problem, problem.model
        self.collision = problem.model.collision(problem.world)

    def motions(self, a: States, b: States) -> list[tuple[str, States, States]]:
        found, here = [], a
        for leg in self.model.connect(a, b):
            if leg.present[0]:
                found.append((leg.kind, here, leg.end))
            here = leg.end
        return found

    def trajectory(self, kind: str, a: States, b: States, *speeds: float) -> Trajectory:
        columns = {name: np.concatenate([getattr(a, name), getattr(b, name)]) for name in self.model.space.names}
        return Trajectory(self.model, States(**columns, **({"speed": np.array(speeds)} if speeds else {})), (kind,))

    def variants(self, kind: str, a: States, b: States) -> list[list[Trajectory]]:
        """Return one motion at each of its speeds, with the changes of speed that it needs."""
        if kind == "move" and self.model is HEAD:
            return [
                [
                    self.trajectory("speed_change", a, a, 0.0, v),
                    self.trajectory("move", a, b, v, v),
                    self.trajectory("speed_change", b, b, v, 0.0),
                ]
                for v in (0.3, 0.6, 1.0)
            ]
        slower = {(ARM, "reach"): ("0.3", "0.5"), (MOBILE, "reach"): ("0.4",), (MOBILE, "run"): ("0.4",)}
        slower |= {(HEAD, "turn"): ("0.5",), (MOBILE, "spin"): ("0.5",)}
        return [
            [self.trajectory(k, a, b)] for k in (kind, *(f"{kind}_{s}" for s in slower.get((self.model, kind), ())))
        ]

    def paid(self, motions: list[Trajectory]) -> Costs:
        total = [sum(trajectory_cost(c, m, self.problem.world) for m in motions) for c in self.problem.criteria]
        return tuple(int(np.ceil(t / c.quantum - 1e-6)) for t, c in zip(total, self.problem.criteria, strict=True))

    def arcs(self, a: States, b: States) -> set[Costs]:
        """Return the costs of a chain in all classes: all reaches in one, all drives in one; none if it collides."""
        motions = self.motions(a, b)
        for kind, begin, end in motions:
            for _, batch in self.trajectory(kind, begin, end, *((1.0, 1.0) if kind == "move" else ())).batches(
                self.problem.world
            ):
                if not self.collision.motions_free(batch).all():
                    return set()
        found = set()
        kinds = list(dict.fromkeys(kind for kind, _, _ in motions))
        choices = {kind: self.variants(kind, *motions[[k for k, _, _ in motions].index(kind)][1:]) for kind in kinds}
        for chosen in product(*(range(len(choices[kind])) for kind in kinds)):
            number = dict(zip(kinds, chosen, strict=True))
            found.add(self.paid([m for k, begin, end in motions for m in self.variants(k, begin, end)[number[k]]]))
        return found

    def front(self, nodes: list[States], links: list[tuple[int, int]], goal: int) -> set[Costs]:
        known = {link: self.arcs(nodes[link[0]], nodes[link[1]]) for link in links}
        labels: list[set[Costs]] = [set() for _ in nodes]
        labels[0] = {(0,) * len(self.problem.criteria)}
        for _ in nodes:
            for (u, v), costs in known.items():
                both = labels[v] | {tuple(map(sum, zip(a, b, strict=True))) for a in labels[u] for b in costs}
                labels[v] = {a for a in both if not any(b != a and all(map(int.__le__, b, a)) for b in both)}
        return labels[goal]


@pytest.mark.cases("0-pan-tilt")
@pytest.mark.parametrize("model", [ARM, HEAD, MOBILE], ids=list(NAMES.values()))
@pytest.mark.seeds(1, of=20)
def test_the_front_is_that_of_all_speeds_of_all_chains(model: Model, seed: int) -> None:
    problem, planner = asked(model), Roadmap(samples=5, seed=seed, neighbours=3, far=0, trees=0)
    roadmap = planner.roadmap(problem)
    assert isinstance(roadmap, ConfigurationRoadmap)
    links = [(int(u), int(v)) for u, v in roadmap.links]
    nodes = [roadmap.nodes.take([i]) for i in range(roadmap.size)]
    best = Oracle(problem).front(nodes, links, roadmap.goals[0])
    found = planner.solve(problem)
    quanta = [criterion.quantum for criterion in problem.criteria]
    assert {tuple(map(int, row)) for row in np.round(found.planned / quanta)} == best


def test_reaches_at_a_share_last_what_a_trapezoid_of_speed_lasts() -> None:
    states = States(**{name: np.array([0.0, 0.2 * i]) for i, name in enumerate(ARM.space.names)})
    for kind, share in (("reach_0.3", 0.3), ("reach_0.5", 0.5), ("reach", 1.0)):
        ways = [0.2 * i for i in range(6)]
        rate = min(share * v / w for v, w in zip(arm6().chain.speed, ways, strict=True) if w)
        change = min(a / w for a, w in zip(arm6().chain.acceleration, ways, strict=True) if w)
        lasts = 1 / rate + rate / change if rate**2 < change else 2 / np.sqrt(change)
        assert Trajectory(ARM, states, (kind,)).duration == pytest.approx(lasts)


@pytest.mark.cases("arm")
@pytest.mark.parametrize("model", [ARM, HEAD, MOBILE], ids=list(NAMES.values()))
def test_plans_are_free_cost_what_was_planned_and_say_their_speeds(model: Model) -> None:
    problem = asked(model)
    front = problem.solve({"roadmap": {"samples": 60}})
    assert verify(problem, front) == []
    assert "NOT VALID" not in front.certificate
    assert "speeds" in front.certificate
    driven = {word for trajectory in front.trajectories for word in driven_speeds(trajectory).split()}
    assert (
        driven >= {ARM: {"reach", "reach_0.3"}, HEAD: {"0.3", "1", "turn"}, MOBILE: {"reach", "run_0.4", "run"}}[model]
    )
    assert front.problem is not None
    assert hpop.Problem.from_description(front.problem).model == model


def test_speeds_are_better_together_than_each_alone() -> None:
    several = asked(ARM).solve({"roadmap": {"samples": 60}}).costs
    for share in (0.3, 1.0):
        world, start, goal = ENDS[ARM]
        alone = hpop.Problem(world, arm6(velocity_scaling=share), start, goal, CRITERIA).solve(
            {"roadmap": {"samples": 60}}
        )
        for row in alone.costs:
            assert (several <= row + 8 * alone.quanta).all(axis=1).any()


def test_a_list_of_one_share_is_that_share_bit_for_bit() -> None:
    world, start, goal = ENDS[ARM]
    one, listed = (
        hpop.Problem(world, arm6(velocity_scaling=share), start, goal, CRITERIA).solve({"roadmap": {"samples": 40}})
        for share in (0.5, [0.5])
    )
    assert np.array_equal(one.costs, listed.costs)
    assert one.certificate == listed.certificate


@pytest.mark.proof
def test_a_tour_of_an_arm_chooses_speeds_and_stands_at_its_stops() -> None:
    world, start, goal = ENDS[ARM]
    tour = {"order": "any", "stops": [{"look_at": {"target": [0.9, 0.9, 0.3], "distance": [0.2, 1.5]}, "dwell": 2}]}
    problem = hpop.Problem(world, ARM, start, goal, CRITERIA, tour=tour)
    front = problem.solve({"roadmap": {"samples": 60}})
    assert verify(problem, front) == []
    assert len({trajectory.kinds for trajectory in front.trajectories}) > 1
    for trajectory in front.trajectories:
        assert np.diff(trajectory.states.clock)[[kind == "hold" for kind in trajectory.kinds]].sum() == pytest.approx(2)


def test_slow_reaches_are_exported_with_limited_jerk() -> None:
    front = asked(ARM).solve({"roadmap": {"samples": 40}})
    slow = next(t for t in front.trajectories if "reach_0.3" in t.kinds)
    limited = jerk_limited(slow, 50.0).trajectory
    assert limited.duration >= slow.duration
    assert list(ARM.faults(limited)) == []


@pytest.mark.proof
@pytest.mark.parametrize("model", [pytest.param(ARM, id="arm"), pytest.param(MOBILE, id="mobile arm")])
def test_models_with_slower_laws_keep_the_contract(model: Model) -> None:
    check_model(model)


def test_what_is_refused_says_why() -> None:
    for wrong in ((1.0, 0.5), (0.5, 0.5), (), (0.5, 2.0), tuple(np.linspace(0.1, 1, 9))):
        with pytest.raises(ModelError, match="velocity_scaling must be"):
            arm6(velocity_scaling=wrong)
    with pytest.raises(UnsupportedModel, match=r"has the speeds reach_0\.3, reach_0\.5, reach; give the model one"):
        asked(ARM).solve("spline")
