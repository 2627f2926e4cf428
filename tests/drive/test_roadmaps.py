"""On a roadmap the options are the best of all simple paths, and what a search of the roadmap in the new world finds.

The brute force shares nothing with drives: positions and links of the roadmap are a graph of networkx, of which those
links are left out that come within the robot's radius of a pillar or of what is closed; each of its simple paths is
driven, and evaluated.
"""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import replace
from typing import Any

import networkx as nx
import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import DriveError
from hpop.frontier import is_nondominated
from hpop.planners import Roadmap
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.roadmap.headings import StateRoadmap
from hpop.planners.objectives import edge_objectives
from hpop.runtime.limits import Budget, Status
from hpop.world import World
from hpop.world.content.content import Zone
from tests.drive.test_fresh_search import covered

EXTENT = shapely.box(0, 0, 7, 5)
RADIUS = 0.25
SLACK = 1e-3  # of lengths, and of turns, that edges rounded up make; other ways differ by more
EVENTS = 5


class Driven:
    """A drive on a roadmap, and what is closed, written down beside it."""

    def __init__(self, seed: int, samples: int, criteria: tuple[str, ...]) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.pillars = [shapely.box(x, y, x + 0.4, y + 0.8) for x, y in rng.uniform((1.5, 0), (5, 4), (3, 2))]
        self.ground = World.from_polygons([shapely.union_all(self.pillars)], extent=EXTENT)
        self.robot, self.criteria = hpop.DifferentialDrive(radius=RADIUS), list(criteria)
        self.planner = Roadmap(samples=samples, neighbours=4, seed=seed)
        self.closed: list[Any] = []
        self.problem = hpop.Problem(self.ground, self.robot, (0.6, 2.5, 0.0), (6.4, 2.5, None), self.criteria)
        roadmap = self.planner.roadmap(self.problem)
        assert isinstance(roadmap, StateRoadmap)
        self.roadmap = roadmap
        front = self.problem.solve(self.planner)
        if not len(front):
            pytest.skip("no way")
        self.drive = hpop.follow(self.problem, front, int(rng.integers(len(front))))

    def bends_less_than_a_degree(self) -> bool:
        """Check for two links, or the start's heading and a link, that differ by less than a degree at a position."""
        states = self.roadmap.states(np.arange(self.roadmap.size))
        apart = np.abs(np.sin(0.5 * (states.yaw[:, None] - states.yaw)))
        same = self.roadmap.places(np.arange(self.roadmap.size))
        alike = (same[:, None] == same) & (apart < np.sin(0.5 * np.deg2rad(1.0)))
        return bool(alike.sum() > states.size)

    def options(self) -> Any:
        """Options after each of some closings and openings, of which some are taken."""
        now = 0.0
        for _ in range(EVENTS):
            now += float(self.rng.uniform(0.1, 1.5))
            if self.closed and self.rng.random() < 0.4:
                self.drive.world(now, open=self.closed.pop(int(self.rng.integers(len(self.closed)))))
            else:
                at = self.rng.uniform((1.2, 0.3), (6.0, 4.5))
                area = shapely.box(*at, *(at + self.rng.uniform(0.1, 0.7, 2)))
                with suppress(DriveError):  # it covers the robot
                    self.drive.world(now, close=area)
                    self.closed.append(area)
            options = self.drive.options(now, 1.0)
            if options.commit.arrives:
                return
            yield options
            if len(options) and self.rng.random() < 0.7:
                self.drive.take(int(self.rng.integers(len(options))))

    def node(self, roadmap: StateRoadmap, commit: hpop.drive.Commit) -> int | None:
        """Return the state of a roadmap at which options begin, if there is one."""
        states = roadmap.states(np.arange(roadmap.size))
        off = np.hypot(states.x - commit.state.x, states.y - commit.state.y)
        off += np.abs(np.sin(0.5 * (states.yaw - commit.state.yaw)))
        return int(off.argmin()) if off.min() < 1e-9 else None

    def by_hand(self, commit: hpop.drive.Commit) -> np.ndarray | None:
        """Costs (n, k) of all that is not dominated among simple paths; None where the roadmap has no such state."""
        here, places = np.array([commit.state.x[0], commit.state.y[0]]), self.roadmap.positions
        if self.node(self.roadmap, commit) is None:
            return None
        apart = np.hypot(*(places - here).T)
        blocks, room = [*self.pillars, *self.closed], EXTENT.buffer(-RADIUS + 1e-12)
        links = [shapely.LineString(places[list(link)]) for link in self.roadmap.links.tolist()]
        free = [room.covers(line) and all(line.distance(block) >= RADIUS for block in blocks) for line in links]
        graph = nx.Graph([link for link, is_free in zip(self.roadmap.links.tolist(), free, strict=True) if is_free])
        graph.add_nodes_from(range(len(places)))
        ((goal, _),) = self.roadmap.targets
        ways = list[hpop.Trajectory]()
        for path in nx.all_simple_paths(graph, int(apart.argmin()), goal):
            poses = [(*here, float(commit.state.yaw[0]))]
            for tail, head in itertools.pairwise(path):
                yaw = float(np.arctan2(*(places[head] - places[tail])[::-1]))
                yaw = poses[-1][2] + float(np.remainder(yaw - poses[-1][2] + np.pi, 2 * np.pi)) - np.pi
                if abs(yaw - poses[-1][2]) > 1e-9:
                    poses.append((*places[tail], yaw))
                poses.append((*places[head], poses[-1][2]))
            ways.append(hpop.Trajectory.from_poses(self.robot, poses))
        costs = np.array([list(self.problem.evaluate(way).values()) for way in ways]).reshape(-1, len(self.criteria))
        return costs[is_nondominated(costs)] if len(costs) else costs

    def fresh(self, commit: hpop.drive.Commit) -> np.ndarray | None:
        """Costs (n, k) of what a search finds on the roadmap made in the world of now; None where it does not begin."""
        roadmap = replace(
            self.roadmap, world=self.ground.with_content(zones=[Zone("keep-out", a) for a in self.closed])
        )
        node = self.node(roadmap, commit)
        if node is None:
            return None
        objectives = edge_objectives(self.problem.criteria, "roadmap")
        graph = roadmap.graph(objectives.optimised)
        query = Query(roadmap, objectives, graph, node, roadmap.goals, build_seconds=0.0)
        return hpop.problems.solving.front(self.problem, query.exact("roadmap", Budget())).costs


def compared(options: hpop.drive.Options, costs: np.ndarray) -> None:
    assert options.status in (Status.COMPLETE, Status.NO_PATH)
    assert covered(options.front.costs, costs, np.full(costs.shape[1], SLACK))
    assert covered(costs, options.front.costs, np.full(costs.shape[1], SLACK))


@pytest.mark.seeds(2, of=60)
def test_options_on_a_roadmap_are_the_best_of_all_simple_paths(seed: int) -> None:
    driven = Driven(seed, samples=7, criteria=("length", "turns") if seed % 2 else ("length", "rotation", "turns"))
    if driven.bends_less_than_a_degree():
        pytest.skip("the roadmap has no such turns")
    for options in driven.options():
        costs = driven.by_hand(options.commit)
        if costs is not None:
            compared(options, costs)


@pytest.mark.seeds(1, of=60)
def test_options_on_a_roadmap_are_those_of_a_fresh_search(seed: int) -> None:
    driven = Driven(seed, samples=60, criteria=("length", "turns"))
    for options in driven.options():
        costs = driven.fresh(options.commit)
        if costs is not None:
            compared(options, costs)
