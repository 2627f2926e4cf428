"""Groups exist so that no aspect is forgotten: what is left empty is said, and costs can be seen by group."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import UnsupportedCriterion


@dataclass(frozen=True)
class _Memory:
    """Time so far, squared: a criterion with memory."""

    name = "impatience"
    group = "O"
    unit = "s²"
    aggregate = "trajectory"
    requires = ()
    smooth = False
    quantum = 1e-6

    def cost(self, m):
        return (m.t0 + m.duration) ** 2


@pytest.fixture(scope="module")
def world():
    return hpop.World.from_polygons([shapely.box(4, 2, 6, 6)], extent=shapely.box(0, 0, 10, 8))


def solved(world, criteria):
    model = hpop.DifferentialDrive()
    return hpop.Problem(world, model, (1, 4, 0), (9, 4, 0), criteria).solve("lattice", step=0.5)


def test_groups_without_a_criterion_are_named_once(world):
    front = solved(world, ["exposure", "turns"])
    (note,) = [note for note in front.notes if "group" in note]
    assert "about the robot (energy, wear) or people nearby" in note
    assert "comfort" not in note


def test_costs_stand_under_their_groups(world):
    front = solved(world, ["exposure", "turns", "length", "duration"])
    grouped = front.by_group()
    assert {group: list(columns) for group, columns in grouped.items()} == {
        "P": ["exposure"], "C": ["turns", "length"], "R": ["duration"], "O": [],
    }  # fmt: skip
    np.testing.assert_array_equal(grouped["R"]["duration"], front.costs[:, 3])


def test_a_criterion_that_decides_nothing_is_inactive():
    def front(costs):
        items = [hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0)])] * len(costs)
        return hpop.Front.of(
            costs, items, names=["a", "b", "c"], units=["1"] * 3, quanta=[1.0, 1.0, 0.1], status="complete",
            certificate="made by hand",
        )  # fmt: skip

    assert front([[1, 2, 0.30000001], [2, 1, 0.29999999]]).inactive == ("c",)
    assert front([[1, 2, 3]]).inactive == ()


def test_a_criterion_with_memory_is_evaluated_and_filtered_by_but_not_searched_for(world):
    front = solved(world, ["turns", "length", _Memory()])
    assert front.names == ("turns", "length", "impatience")
    durations = [trajectory.duration for trajectory in front.trajectories]
    np.testing.assert_allclose(front.costs[:, 2], np.square(durations))
    assert "impatience evaluated on these trajectories, not searched for" in front.certificate
    assert any("impatience has memory" in note for note in front.notes)
    assert len(front) == len(solved(world, ["turns", "length"]))


def test_criteria_with_memory_alone_leave_the_lattice_nothing_to_search(world):
    with pytest.raises(UnsupportedCriterion, match="impatience"):
        solved(world, [_Memory()])
