"""Random rooms, and a search for better polylines near one that is said to be optimal.

The search shares nothing with planners: corners are displaced, singly, in pairs and all at random, and what is free by
shapely, keeps its bounds and turns no more is better if it costs less. Lengths, clearances and turns are its own.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

import hpop
from hpop.criteria.costs import trajectory_costs

WIDTH, HEIGHT, RADIUS = 9.0, 5.5, 0.3  # m
ROOM = shapely.box(0, 0, WIDTH, HEIGHT)
QUESTIONS = [
    (["exposure", "turns", "length"], "length"),
    (["exposure", "turns", "length"], "exposure"),
    (["clearance", "turns", "length"], "length"),
    (["clearance", "turns", "length"], "clearance"),
    (["exposure", "clearance", "length"], "length"),
    (["exposure", "length"], "length"),
]
STRAIGHT = 1e-5  # rad: less is no turn
SLACK = 1e-9


def random_question(seed):
    """Obstacles, a problem among them, and the cost to minimise."""
    rng = np.random.default_rng(seed)
    obstacles = []
    for _ in range(rng.integers(3, 7)):
        x, y = rng.uniform((2.0, 0.5), (7.0, 5.0))
        if rng.random() < 0.5:
            points = np.clip(rng.uniform((x - 0.9, y - 0.9), (x + 0.9, y + 0.9), (8, 2)), (1.6, 0.2), (7.4, 5.3))
            obstacles.append(shapely.convex_hull(shapely.multipoints(points)))
        else:
            w, h = rng.uniform(0.15, 0.7, 2)
            obstacles.append(shapely.box(x - w, y - h, x + w, y + h))
    start = (0.8, float(rng.uniform(0.8, 4.7)), 0.0)
    goal = (8.2, float(rng.uniform(0.8, 4.7)), None if rng.random() < 0.5 else 0.0)
    criteria, minimise = QUESTIONS[seed % len(QUESTIONS)]
    world = hpop.World.from_polygons(obstacles, extent=ROOM)
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=RADIUS), start, goal, criteria)
    return obstacles, problem, minimise


class Perturbation:
    """A search near polylines (m, 2) of one problem, minimising one cost."""

    def __init__(self, obstacles, problem, minimise, seed=0):
        self.problem, self.names = problem, [c.name for c in problem.criteria]
        self.place = self.names.index(minimise)
        around = shapely.difference(shapely.buffer(ROOM, 5.0, join_style="mitre"), ROOM)
        self.blocked = shapely.union_all([*obstacles, around])
        shapely.prepare(self.blocked)
        self.rng = np.random.default_rng(seed)

    def improvable(self, trajectory, bounds):
        """By what share of its cost a trajectory can be made better, its costs and bounds kept by name."""
        points = np.stack([trajectory.states.x, trajectory.states.y], axis=1)
        corners = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-9)]
        before = costs = self.costs(corners[None])[0]
        assert np.isfinite(before).all()
        limits = np.maximum([bounds.get(name, np.inf) for name in self.names], before)
        limits[self.place] = np.inf
        step = 0.3  # m
        while step > 1.5e-3 and len(corners) > 2:
            tried = self.near(corners, step)
            found = self.costs(tried)
            better = (found <= limits * (1 + SLACK) + SLACK).all(axis=1)
            better &= found[:, self.place] < costs[self.place] * (1 - 2e-5) - SLACK
            if better.any():
                best = np.flatnonzero(better)[found[better, self.place].argmin()]
                corners, costs, step = tried[best], found[best], min(0.3, 1.5 * step)
            else:
                step *= 0.5
        return (before[self.place] - costs[self.place]) / max(before[self.place], SLACK)

    def near(self, corners, step):
        """Polylines (b, m, 2) whose inner corners are displaced; first and last headings that are given stay."""
        turns, inner, moved = self.turns(corners), range(1, len(corners) - 1), []

        def displaced(first, last, by):
            others = corners.copy()
            others[first:last] += by
            moved.append(others)

        for i in inner:
            for angle in np.linspace(0, 2 * np.pi, 16, endpoint=False) + self.rng.uniform(0, 0.4):
                by = step * np.array([math.cos(angle), math.sin(angle)])
                displaced(i, i + 1, by)
                if i + 1 in inner:
                    displaced(i, i + 2, by)
            for k in (i - 1, i):
                along = corners[k + 1] - corners[k]
                displaced(i, i + 1, step * along / np.hypot(*along))
                displaced(i, i + 1, -step * along / np.hypot(*along))
        for _ in range(60):
            some = self.rng.random((len(inner), 1)) < 0.7
            displaced(1, -1, self.rng.normal(0, step / math.sqrt(2), (len(inner), 2)) * some)
        moved = np.array(moved)
        if turns[0] <= STRAIGHT:
            ahead = np.array([math.cos(self.problem.start[2]), math.sin(self.problem.start[2])])
            moved[:, 1] = corners[0] + np.maximum((moved[:, 1] - corners[0]) @ ahead, 1e-3)[:, None] * ahead
        goal = self.problem.goal[2]
        if goal is not None and turns[-1] <= STRAIGHT:
            ahead = np.array([math.cos(goal), math.sin(goal)])
            moved[:, -2] = corners[-1] - np.maximum((corners[-1] - moved[:, -2]) @ ahead, 1e-3)[:, None] * ahead
        return moved

    def turns(self, corners):
        """Absolute angles at the start, at inner corners, and at the goal if a heading is asked for there."""
        headings = np.arctan2(*np.diff(corners, axis=0).T[::-1])
        goal = self.problem.goal[2]
        headings = np.concatenate([[self.problem.start[2]], headings, [] if goal is None else [goal]])
        return np.abs((np.diff(headings) + np.pi) % (2 * np.pi) - np.pi)

    def costs(self, polylines):
        """Costs (b, k); inf of what collides."""
        lines = shapely.linestrings(polylines)
        distance = shapely.distance(lines, self.blocked)
        free = np.flatnonzero(distance >= RADIUS - 1e-6)
        costs = np.full((len(lines), len(self.names)), np.inf)
        for j, criterion in enumerate(self.problem.criteria):
            if criterion.name == "length":
                costs[free, j] = shapely.length(lines[free])
            elif criterion.name == "clearance":
                costs[free, j] = np.maximum(1.0 - distance[free], 0.0)
            elif criterion.name == "turns":
                costs[free, j] = [(self.turns(polylines[i]) > STRAIGHT).sum() for i in free]
            elif len(free):
                driven = [self.trajectory(polylines[i]) for i in free]
                costs[free, j] = trajectory_costs([criterion], driven, self.problem.world)[:, 0]
        return costs

    def trajectory(self, corners):
        headings = np.arctan2(*np.diff(corners, axis=0).T[::-1])
        goal = self.problem.goal[2]
        yaws = [self.problem.start[2], *headings[:-1], headings[-1] if goal is None else goal]
        poses = [(float(x), float(y), float(yaw)) for (x, y), yaw in zip(corners, yaws, strict=True)]
        return hpop.Trajectory.from_poses(self.problem.model, poses)
