"""Arcs and costs that a lattice takes from what holds at all positions: against tests of each motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import hpop
from hpop.criteria.base import criterion, make_criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import Motions
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.lattice.grid import Headings, steps_from
from hpop.planners.objectives import quantised

RECTANGLE = hpop.DifferentialDrive(footprint=((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)))
ROBOTS = {"round": hpop.DifferentialDrive(radius=0.2), "rectangle": RECTANGLE}


@criterion("test_away", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Away:
    """Own criterion: a turn costs by where it is."""

    def cost(self, m: Motions) -> np.ndarray:
        return m.duration + np.abs(m.start.x)


@criterion("test_dark", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Dark:
    """Own criterion: a turn costs by the world in which it is, as some criteria do without reading states."""

    def cost(self, m: Motions) -> np.ndarray:
        return m.duration * (1.0 if m.world.bounds[0] < 1e9 else 0.0)


CRITERIA = ["duration", "turns", "length", "rotation", "exposure", "clearance", "energy", "test_away", "test_dark"]


def lattice(robot: str, headings: int, seed: int, step: float = 0.35) -> StateLattice:
    cells = np.random.default_rng(seed).random((24, 30)) < 0.08
    world = hpop.World.from_cells(cells, 0.2).with_content(people=[hpop.Person(2.0, 2.0)])
    return StateLattice(ROBOTS[robot], world, (0.1, 0.2), step, Headings(headings), corner_cutting=False)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("headings", [4, 8, 16])
def test_costs_of_all_arcs_are_those_of_their_motions(robot, headings):
    graph, criteria = lattice(robot, headings, seed=headings), [make_criterion(name) for name in CRITERIA]
    costs = np.concatenate([graph.graph(part).costs for part in (criteria[:6], criteria[6:])], axis=1)
    tails, _ = graph.arcs.ends(slice(0, graph.arcs.heads.size))
    number = {ends: arc for arc, ends in enumerate(zip(tails.tolist(), graph.arcs.heads.tolist(), strict=True))}
    assert len(number) > 500
    for tails, heads, motions in graph.batches():
        rows = [number[arc] for arc in zip(tails.tolist(), heads.tolist(), strict=True)]
        for j, each in enumerate(criteria):
            assert (costs[rows, j] == quantised(motion_costs(each, motions), each)).all(), each.name


@pytest.mark.parametrize(
    ("name", "anywhere"),
    [("duration", True), ("turns", True), ("exposure", False), ("test_away", False), ("test_dark", False)],
)
def test_a_turn_costs_the_same_anywhere_if_its_cost_reads_neither_position_nor_world(name, anywhere):
    assert (lattice("round", 8, seed=1).costs_anywhere("turn", make_criterion(name)) is not None) == anywhere


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("headings", [8, 16])
def test_steps_are_those_of_which_each_is_free(robot, headings):
    graph = lattice(robot, headings, seed=3, step=0.15)
    expected, blocked = [], 0
    for heading, step in enumerate(graph.headings.steps):
        rows, columns, to_rows, to_columns = steps_from(graph.free[:, :, heading], step, corner_cutting=False)
        tails, heads = (graph.number[at] * graph.width + heading for at in ((rows, columns), (to_rows, to_columns)))
        free = graph.collision.motions_free(graph.motions("move", tails, heads))
        expected += zip(tails[free].tolist(), heads[free].tolist(), strict=True)
        blocked += int((~free).sum())
    assert sorted(expected) == sorted(zip(*(ends.tolist() for ends in graph.edges("move")), strict=True))
    assert blocked
