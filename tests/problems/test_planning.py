"""Many queries on one map: the answers are those of fresh plans on the same graph, and nothing is computed twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import criterion
from hpop.errors import QueryError, UnknownName, UnsupportedModel
from hpop.motions import Motions
from hpop.problems.verify import verify
from hpop.world import Person
from hpop.world.content.content import Zone
from tests.joints import Joints

WALLS = [shapely.box(2.0, 0.0, 2.4, 2.6), shapely.box(4.0, 1.4, 4.4, 4.0)]
EXTENT = shapely.box(0, 0, 6.4, 4.0)
ROBOT = hpop.DifferentialDrive(radius=0.2)
CRITERIA = ["exposure", "turns", "length"]
QUERIES = [
    ((0.6, 0.6, 0.0), (5.8, 0.7, None)),
    ((1.37, 3.21, 0.4), (3.3, 0.6, 1.0)),
    ((5.5, 3.1, -2.0), (0.5, 0.5, None)),
]


def world() -> hpop.World:
    return hpop.World.from_polygons(WALLS, extent=EXTENT)


def planning(planner: Any = None, criteria: Any = CRITERIA, of: hpop.World | None = None) -> hpop.Planning:
    return hpop.Planning(of or world(), ROBOT, criteria, planner or {"lattice": {"step": 0.5}})


@pytest.mark.parametrize(
    ("planner", "same"),
    [
        ({"lattice": {"step": 0.5}}, {"lattice": {"step": 0.5, "anchor": "world"}}),
        ({"exact": {"on": {"lattice": {"step": 0.5}}}}, {"lattice": {"step": 0.5, "anchor": "world"}}),
        (
            {"weighted-sum": {"step": 0.5}},
            {"weighted-sum": {"on": {"lattice": {"step": 0.5, "anchor": "world"}}}},
        ),
        ({"roadmap": {"samples": 20}}, {"roadmap": {"samples": 20}}),
    ],
    ids=["lattice", "exact", "weighted-sum", "roadmap"],
)
def test_each_front_is_that_of_a_fresh_plan_on_the_same_graph(planner: Any, same: Any) -> None:
    many = planning(planner)
    for start, goal in QUERIES:
        front = many.solve(start, goal)
        asked = hpop.Problem(world(), ROBOT, start, goal, CRITERIA)
        assert front.costs.tolist() == asked.solve(same).costs.tolist()
        assert verify(asked, front) == []


def test_arcs_are_costed_once_for_all_queries() -> None:
    """A criterion that counts the motions of which it is asked: the first query asks of all arcs, others of a few."""
    asked = []

    @criterion("counted", group="R", unit="m", aggregate="sum")
    @dataclass(frozen=True)
    class Counted:
        def cost(self, m: Motions) -> Any:
            asked[-1] += m.start.size
            return m.integrate(lambda s: s.speed)

    many = planning(criteria=[Counted(), "turns"])
    for start, goal in QUERIES:
        asked.append(0)
        many.solve(start, goal)
    assert asked[0] > 3_000
    assert max(asked[1:]) < asked[0] / 8


def test_a_world_that_changes_is_planned_on_as_it_is() -> None:
    many = planning()
    start, goal = QUERIES[0]
    before = many.solve(start, goal)
    closed = world().with_content(zones=[Zone("keep-out", shapely.box(2.0, 2.6, 2.4, 4.0))])
    assert many.updated(closed).solve(start, goal).status == "no path"
    assert many.solve(start, goal).costs.tolist() == before.costs.tolist()


def test_states_of_a_trajectory_are_a_start_and_goals() -> None:
    many = planning(criteria=["length"])
    trajectory = many.solve(*QUERIES[0]).trajectories[0]
    on_the_way, later = trajectory.at(trajectory.duration / 2), trajectory.at([trajectory.duration])
    values = ROBOT.space.values(on_the_way)
    for goal in (later, [later], ROBOT.space.values(later)):
        assert many.solve(on_the_way, goal).costs.tolist() == many.solve(values, goal).costs.tolist()
    assert many.problem(values, [later, values]).goals == (ROBOT.space.values(later), values)


def test_ends_that_make_no_sense_are_refused() -> None:
    with pytest.raises(UnknownName, match=r"'exposures'\. Did you mean 'exposure'\?"):
        planning(criteria=["exposures"])
    with pytest.raises(QueryError, match="start"):
        planning().solve((2.2, 1.0, 0.0), (5.8, 0.7, None))
    robot = Joints(3)
    with pytest.raises(UnsupportedModel, match="lattice needs a model with"):
        hpop.Planning(world(), robot, ["duration"]).solve(robot.start, robot.start)


def test_the_positions_of_the_lattice_do_not_depend_on_the_start() -> None:
    many = planning()
    places = []
    for start, goal in QUERIES[:2]:
        trajectory = many.solve(start, goal).knee().trajectory
        inner = np.stack([trajectory.states.x, trajectory.states.y], axis=1)[2:-2]
        places.append(inner / 0.5)
    assert all(np.abs(each - np.rint(each)).max() < 1e-9 for each in places)


def test_a_margin_to_people_who_stand_does_not_make_the_lattice_anew() -> None:
    standing = world().with_content(people=[Person(5.0, 3.0, name="Ann")])
    many = planning({"lattice": {"step": 0.5, "margin": 0.2}}, of=standing)
    kept = standing.keeping(0.2)
    many.solve(*QUERIES[0])
    before = kept.cache.size
    many.solve(*QUERIES[1])
    assert many.problem(*QUERIES[0]).keeping(0.2).world.cache.size == before > 0
