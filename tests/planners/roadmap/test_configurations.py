"""Roadmaps of configurations against an oracle that walks every simple path, and what holds of them for any model."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.math import wrap
from hpop.criteria.costs import trajectory_costs
from hpop.errors import ModelError, OptionError, QueryError
from hpop.models.base import PlanarModel
from hpop.motions import Leg, Model, States, StateSpace
from hpop.planners import Roadmap
from hpop.planners.graphs.roadmap.configurations import ConfigurationRoadmap
from hpop.planners.graphs.roadmap.links import nearest
from hpop.planners.spending import Spending
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Person

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "examples/plugin"))
from hpop_example_plugin.holonomic import Holonomic

sys.path.pop(0)

PILLAR = hpop.World.from_polygons([shapely.box(2.4, 1.5, 2.8, 2.6)], extent=shapely.box(0, 0, 5, 4))
BASE = Holonomic(length=0.5, width=0.3)
HEAD = hpop.PanTilt(hpop.DifferentialDrive(radius=0.25), pan=(-1.5, 2.0), tilt=(-0.5, 0.3))
ENDS = {BASE: ((0.8, 2.0, 0.3), (4.2, 2.1, -1.1)), HEAD: ((0.8, 2.0, 0.3, 1.0, 0.0), (4.2, 2.1, -1.1, 0.5, -0.2))}
CRITERIA = ["duration", "rotation", {"exposure": {"radius": 1.0}}]


def problem(model: Model = BASE, *, goal: Any = None, start: Any = None, criteria: Any = CRITERIA, world: Any = PILLAR):
    ends = ENDS[model]
    return hpop.Problem(world, model, start or ends[0], goal or ends[1], criteria)


# The oracle: nodes and their nearest by the metric written out, every simple path, each written out as a trajectory.


def apart(space: StateSpace, a: tuple[float, ...], b: tuple[float, ...]) -> float:
    total = 0.0
    for name, weight, x, y in zip(space.names, space.weights, a, b, strict=True):
        if not math.isnan(y):
            total += (weight * (float(wrap(np.array(y - x))) if name in space.turning else y - x)) ** 2
    return math.sqrt(total)


def links_of(space: StateSpace, nodes: list[tuple[float, ...]], count: int) -> set[tuple[int, int]]:
    """Return the expected links: start (first) and goal (last) to samples in one direction, and to each other."""
    last = len(nodes) - 1
    samples = range(1, last)

    def near(i: int) -> list[int]:
        return sorted((j for j in samples if j != i), key=lambda j: apart(space, nodes[j], nodes[i]))[:count]

    pairs = {(0, last), *((0, j) for j in near(0)), *((j, last) for j in near(last))}
    for i in samples:
        pairs |= {pair for j in near(i) for pair in ((i, j), (j, i))}
    return pairs


def through(model: Model, rows: list[tuple[float, ...]]) -> Trajectory:
    """Pair by pair, a leg at a time."""
    space = model.space
    here = States(**{name: np.array([value]) for name, value in zip(space.names, rows[0], strict=True)})
    states, kinds = [here], []
    for row in rows[1:]:
        to = States(**{name: np.array([value]) for name, value in zip(space.names, row, strict=True)})
        for leg in model.connect(here, to):
            if leg.present[0]:
                states.append(leg.end)
                kinds.append(leg.kind)
        here = states[-1]
    columns = {name: np.concatenate([getattr(each, name) for each in states]) for name in space.names}
    return Trajectory(model, States(**columns), tuple(kinds))


def simple_paths(asked: hpop.Problem, nodes: list[tuple[float, ...]], count: int) -> Iterator[Trajectory]:
    """Every path without repeated nodes from the start to the goal whose motions are all free."""
    model, last = asked.model, len(nodes) - 1
    collision = model.collision(asked.world)

    def free(i: int, j: int) -> bool:
        motions = (motions for _, motions in through(model, [nodes[i], nodes[j]]).batches(asked.world))
        return all(bool(collision.motions_free(each).all()) for each in motions)

    onward: dict[int, list[int]] = {i: [] for i in range(len(nodes))}
    for i, j in links_of(model.space, nodes, count):
        if free(i, j):
            onward[i].append(j)
    stack = [(0,)]
    while stack:
        path = stack.pop()
        if path[-1] == last:
            yield through(model, [nodes[i] for i in path])
            continue
        stack += [(*path, j) for j in onward[path[-1]] if j not in path]


def nodes_of(roadmap: ConfigurationRoadmap) -> list[tuple[float, ...]]:
    columns = [getattr(roadmap.nodes, name).tolist() for name in roadmap.model.space.names]
    return list(zip(*columns, strict=True))


@pytest.mark.cases("0-holonomic-False", "0-pan-tilt-True")
@pytest.mark.parametrize("free_yaw", [False, True])
@pytest.mark.parametrize("model", [BASE, HEAD], ids=["holonomic", "pan-tilt"])
@pytest.mark.seeds(2, of=6)
def test_the_front_equals_that_of_all_simple_paths(seed: int, model: Model, free_yaw: bool) -> None:
    goal = tuple(
        None if free_yaw and name == "yaw" else v for name, v in zip(model.space.names, ENDS[model][1], strict=True)
    )
    asked = problem(model, goal=goal)
    planner = Roadmap(samples=7, seed=seed, neighbours=3)
    found, nodes = planner.solve(asked), nodes_of(planner.roadmap(asked))
    assert nodes[0] == ENDS[model][0]
    trajectories = list(simple_paths(asked, nodes, 3))
    assert found.status is (Status.COMPLETE if trajectories else Status.NO_PATH)
    if not trajectories:
        return
    costs = trajectory_costs(found.objectives, trajectories, asked.world)
    slack = 8 * np.array([c.quantum for c in found.objectives])
    assert len(found.planned) >= 1
    for row in costs:
        assert (found.planned <= row + slack).all(axis=1).any()
    for row in found.planned:
        assert (np.abs(costs - row) <= slack).all(axis=1).any()
        assert not ((costs <= row - slack).any(axis=1) & (costs <= row + 1e-9).all(axis=1)).any()


@pytest.mark.proof
def test_the_compared_fronts_are_not_trivial() -> None:
    sizes = [
        len(Roadmap(samples=7, seed=seed, neighbours=3).solve(problem(model)).planned)
        for seed in range(6)
        for model in (BASE, HEAD)
    ]
    assert max(sizes) >= 3
    assert sum(size >= 1 for size in sizes) >= 6


@pytest.mark.seeds(3, of=20)
def test_the_nearest_are_those_of_the_metric_also_round_the_circle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.0, 2.0, 4) * [1, 1, 1, seed % 2]
    bounds = np.array([5.0, 1.0, 9.0, math.pi])
    space = StateSpace(
        ("x", "lift", "a", "b"), ("m", "m", "rad", "rad"), -bounds, bounds, weights, frozenset({"a", "b"})
    )
    states, of = space.sample(rng, 60), space.sample(rng, 5)
    if seed % 3 == 0:
        of = States(**{**of.__dict__, "a": np.full(5, np.nan)})
    found = nearest(space, states, of, 7, Spending())
    nodes = list(zip(*(getattr(states, name).tolist() for name in space.names), strict=True))
    for row, asked in zip(found, zip(*(getattr(of, name).tolist() for name in space.names), strict=True), strict=True):
        distances = [apart(space, node, asked) for node in nodes]
        assert [distances[i] for i in row] == pytest.approx(sorted(distances)[:7], abs=1e-9)


# What is found


@pytest.mark.cases("holonomic-roadmap", "pan-tilt-planner1")
@pytest.mark.parametrize("planner", ["roadmap", {"weighted-sum": {"on": {"roadmap": {"samples": 80, "seed": 1}}}}])
@pytest.mark.parametrize("model", [BASE, HEAD], ids=["holonomic", "pan-tilt"])
def test_what_is_found_is_free_by_the_judge_keeps_its_ends_and_costs_what_was_planned(
    model: Model, planner: Any
) -> None:
    asked = problem(model)
    front = asked.solve({"roadmap": {"samples": 80, "seed": 1}} if planner == "roadmap" else planner)
    assert len(front) >= 3
    assert verify(asked, front) == []  # collisions by fcl, ends, costs, what the robot cannot do
    assert "NOT VALID" not in front.certificate
    assert "the roadmap of 80 samples (seed 1) and 24 neighbours of each" in front.certificate
    for trajectory in front.trajectories:
        ends = [[float(getattr(trajectory.states, name)[i]) for name in model.space.names] for i in (0, -1)]
        assert ends[0] == pytest.approx(ENDS[model][0], abs=1e-12)
        assert model.space.values(trajectory.states.take([-1]))[:2] == pytest.approx(ENDS[model][1][:2], abs=1e-12)
        assert wrap(np.array(ends[1][2] - ENDS[model][1][2])) == pytest.approx(0.0, abs=1e-9)
        for begin, end in pairwise(np.asarray(trajectory.states.yaw)):
            assert abs(end - begin) <= math.pi + 1e-9


def test_the_head_keeps_within_its_stops_all_the_way() -> None:
    front = problem(HEAD).solve("roadmap", samples=80, seed=1)
    pans = np.concatenate([np.asarray(t.states.pan) for t in front.trajectories])
    assert -1.5 <= pans.min() < pans.max() <= 2.0
    assert pans.max() - pans.min() > 1.0


def test_the_drive_keeps_its_roadmap_of_positions_and_headings() -> None:
    asked = hpop.Problem(PILLAR, hpop.DifferentialDrive(radius=0.2), *ENDS[BASE], ["length"])
    assert "positions" in Roadmap(samples=20).solve(asked).stats
    assert "chains" in Roadmap(samples=20).solve(problem()).stats


def walks(roadmap: ConfigurationRoadmap, sizes: list[int]) -> list[np.ndarray]:
    """Return walks of these numbers of nodes along the arcs, from anywhere; no arc leaves a goal."""
    rng, arcs = np.random.default_rng(0), roadmap.arcs
    found = []
    for size in sizes:
        walk = [int(rng.integers(1, roadmap.size - 1))]
        while len(walk) < size:
            onward = arcs.heads[arcs.start[walk[-1]] : arcs.start[walk[-1] + 1]]
            walk.append(int(rng.choice(onward[~np.isin(onward, roadmap.goals)])))
        found.append(np.array(walk))
    return found


ALL_ROUND = hpop.PanTilt(hpop.DifferentialDrive(radius=0.25), pan="all round")
ENDS[ALL_ROUND] = ENDS[HEAD]


@pytest.mark.parametrize("model", [BASE, ALL_ROUND], ids=["holonomic", "pan-tilt"])
def test_trajectories_made_together_are_those_made_leg_by_leg_and_cost_what_their_chains_cost(model: Model) -> None:
    asked = problem(model, criteria=[*CRITERIA, "clearance"])
    roadmap = Roadmap(samples=40, seed=2).roadmap(asked)
    paths = walks(roadmap, [30, 1, 2, 12])
    graph = roadmap.graph(asked.criteria)
    quanta = np.array([criterion.quantum for criterion in asked.criteria])
    arcs = {
        (int(u), int(v)): cost for u, v, cost in zip(*roadmap.arcs.ends(slice(0, graph.arcs)), graph.costs, strict=True)
    }
    for path, made in zip(paths, roadmap.trajectories(paths), strict=True):
        alone = Trajectory.through(model, roadmap.states(path))
        assert made.kinds == alone.kinds
        for name in model.space.names:
            assert getattr(made.states, name) == pytest.approx(getattr(alone.states, name), abs=1e-9)
        costs = np.array([arcs[pair] for pair in pairwise(path.tolist())]).reshape(-1, 4) * quanta
        again = trajectory_costs(asked.criteria, [made], asked.world)[0] if len(path) > 1 else np.zeros(4)
        assert costs[:, :3].sum(axis=0) == pytest.approx(again[:3], abs=1.01 * len(path) * quanta[:3].max())
        assert costs[:, 3].max(initial=0.0) == pytest.approx(again[3], abs=1.01 * quanta[3])


# Goals


def test_a_goal_may_be_a_set_with_free_angles_and_its_nearest_way_is_taken() -> None:
    far, near = (4.6, 3.6, 0.0), (1.2, 2.4, None)
    front = problem(goal=[far, near], criteria=["length"]).solve("roadmap", samples=60)
    assert len(front) == 1
    end = front.trajectories[0].states.take([-1])
    assert (float(end.x[0]), float(end.y[0])) == (1.2, 2.4)
    assert front.costs[0, 0] == pytest.approx(math.hypot(0.4, 0.4))
    assert front.trajectories[0].kinds == ("slide",)  # no turn that nobody asked for


@dataclass(frozen=True)
class Beyond:
    """All states beyond an x."""

    x: float

    def states(self, problem: hpop.Problem, rng: np.random.Generator, count: int) -> States:
        drawn = problem.model.space.bounded(x=(self.x, 5.0), y=(0.0, 4.0)).sample(rng, count)
        return States(**drawn.__dict__)

    def reached(self, model: Model, states: States) -> np.ndarray:
        return np.asarray(states.x >= self.x)

    def describe(self) -> Any:
        return {"beyond": self.x}


def test_a_goal_of_ones_own_is_reached_at_one_of_its_states() -> None:
    found = Roadmap(samples=60).solve(problem(goal=Beyond(4.0)))
    assert len(found.trajectories) >= 2
    assert all(trajectory.states.x[-1] >= 4.0 for trajectory in found.trajectories)
    assert ", 100 free states of the goal" not in found.certificate  # some of them are blocked
    assert "free states of the goal (100 found, 100 sought), for (duration" in found.certificate


def test_who_is_at_the_goal_already_stays() -> None:
    front = problem(goal=(0.8, 2.0, None), criteria=["length"]).solve("roadmap", samples=10)
    assert front.costs.tolist() == [[0.0]]
    assert len(front.trajectories[0]) == 0


# Refusals, and no path


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ({"start": (2.6, 2.0, 0.0)}, r"the start \(2\.600, 2\.000, 0\.000\) is not usable: "),
        ({"goal": (2.6, 2.0, 0.0)}, r"the goal \(2\.600, 2\.000, 0\.000\) is not usable: "),
        (
            {"goal": (2.6, 2.0, None)},
            r"the goal \(2\.600, 2\.000, any\) is not usable \(at any of 100 random angles\): ",
        ),
        ({"goal": [(2.6, 2.0, 0.0), (0.1, 0.1, 0.0)]}, r"the goal 0 .* not usable: .*the goal 1 .* is not usable: "),
        ({"goal": Beyond(4.95)}, "the goal is not usable: all of 100 states drawn from it at random are blocked"),
    ],
)
def test_ends_that_are_blocked_are_refused_by_what_blocks_them(ends: dict[str, Any], said: str) -> None:
    with pytest.raises(QueryError, match=said):
        Roadmap(samples=10).solve(problem(**ends))


def test_a_goal_that_is_blocked_is_left_out_of_a_set() -> None:
    assert len(Roadmap(samples=60).solve(problem(goal=[(2.6, 2.0, 0.0), (4.2, 2.1, 0.0)])).planned) >= 1


def test_people_who_move_are_refused() -> None:
    walking = PILLAR.with_content(people=[Person(1.0, 3.0, velocity=(0.5, 0.0))])
    with pytest.raises(QueryError, match="roadmap does not consider time"):
        Roadmap(samples=10).solve(problem(world=walking))


def test_where_no_path_leads_the_components_are_told() -> None:
    walled = hpop.World.from_polygons([shapely.box(2.3, 0.0, 2.9, 4.0)], extent=shapely.box(0, 0, 5, 4))
    found = Roadmap(samples=40).solve(problem(world=walled))
    assert found.status is Status.NO_PATH
    assert len(found.trajectories) == 0
    assert any("unconnected parts; the part with the start has" in note for note in found.notes)


@dataclass(frozen=True)
class Ratchet(Holonomic):
    """Slides towards rising x alone: from elsewhere its legs do not lead there."""

    name = "ratchet"

    def connect(self, a: States, b: States) -> list[Leg]:
        ((kind, end, present),) = super().connect(a, b)
        able = b.x >= a.x
        return [
            Leg(kind, States(**{n: np.where(able, getattr(end, n), getattr(a, n)) for n in end.names}), present & able)
        ]


def test_where_the_legs_do_not_lead_there_is_no_chain() -> None:
    there = hpop.Problem(PILLAR, Ratchet(length=0.5, width=0.3), *ENDS[BASE], ["length"])
    front = there.solve("roadmap", samples=150)
    assert all((np.diff(t.states.x) >= 0).all() for t in front.trajectories)
    back = Roadmap(samples=150).solve(hpop.Problem(PILLAR, there.model, *ENDS[BASE][::-1], ["length"]))
    assert back.status is Status.NO_PATH
    assert any("only by motions in the opposite direction" in note for note in back.notes)


@dataclass(frozen=True)
class Unconnected(Holonomic):
    """A robot whose author forgot how it gets from a state to another."""

    name = "unconnected"
    connect = PlanarModel.connect


def test_a_robot_that_does_not_say_how_it_gets_anywhere_is_told_to() -> None:
    asked = hpop.Problem(PILLAR, Unconnected(), *ENDS[BASE], ["length"])
    with pytest.raises(ModelError, match=r"unconnected must have the laws turn and move, .*override connect\(a, b\)"):
        Roadmap(samples=10).solve(asked)


def test_more_links_than_a_graph_can_have_are_refused_before_they_are_made() -> None:
    with pytest.raises(OptionError, match=r"at most 60,000,000 links, got .*; take fewer"):
        Roadmap(samples=1000, neighbours=100_000).solve(problem())


@pytest.mark.parametrize(
    ("limit", "status"), [({"time_limit": 1e-6}, Status.TIME_LIMIT), ({"max_memory": 3000}, Status.MEMORY_LIMIT)]
)
def test_a_limit_that_is_passed_ends_the_building(limit: dict[str, float], status: Status) -> None:
    found = Roadmap(samples=100, **limit).solve(problem())
    assert found.status is status
    assert "was passed while" in found.notes[-1]
