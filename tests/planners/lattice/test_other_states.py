"""Lattices of robots with states that are no angles, or of which nothing says where they are on a lattice."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import ModelError, QueryError, UnsupportedModel
from hpop.models.base import Stations
from hpop.models.laws import linear, rest_to_rest
from hpop.motions import Law, Leg, States, StateSpace
from hpop.problems.verify import verify

WORLD = hpop.World.from_polygons([], extent=shapely.box(0, 0, 3, 2))


@dataclass(frozen=True)
class Rise:
    """The mast rises or sinks, the base stands."""

    kind = "rise"
    varies = frozenset({"mast"})

    def phases(self, start, end):
        return rest_to_rest(np.abs(end.mast - start.mast), 0.5, 1.0)

    def interpolate(self, name, start, end, share):
        return linear(name, start, end, share)


@dataclass(frozen=True)
class Fixed(hpop.DifferentialDrive):
    """A base whose mast has a height, m, that nothing changes."""

    name = "fixed"

    @cached_property
    def space(self) -> StateSpace:
        p = super().space
        columns = ((*p.names, "mast"), (*p.units, "m"), (*p.low, 0.0), (*p.high, 1.0), (*p.weights, 1.0))
        return StateSpace(*columns, p.turning)


@dataclass(frozen=True)
class Unconnected(Fixed):
    """A base whose mast is down or up at each heading of a lattice; how it gets elsewhere is not said."""

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        return {**super().laws, "rise": Rise()}

    def stations(self, yaw):
        heading, up = (index.ravel() for index in np.indices((yaw.size, 2)))
        number = np.arange(heading.size).reshape(yaw.size, 2)
        a, b = np.nonzero(~np.eye(yaw.size, dtype=bool))
        zero = np.zeros(heading.size)
        return Stations(
            States(x=zero, y=zero, yaw=yaw[heading], mast=0.5 * up),
            heading,
            {
                "turn": (number[a].ravel(), number[b].ravel()),
                "rise": (number.ravel(), number[:, ::-1].ravel()),
            },
        )


@dataclass(frozen=True)
class Rising(Unconnected):
    """Robot without connecting turns whose mast moves at the end of each chain."""

    def connect(self, a: States, b: States) -> list[Leg]:
        legs = super().connect(a, b)
        end = States(**legs[-1].end.__dict__ | {"mast": b.mast})
        return [*legs, Leg("rise", end, np.abs(b.mast - a.mast) > 0.0)]


def asked(robot: hpop.DifferentialDrive, start: float, goal: float) -> hpop.Problem:
    ends = (0.5, 0.5, 0.0, start), (2.5, 1.5, math.pi / 2, goal)
    return hpop.Problem(WORLD, robot, *ends, ["length", "duration"])


@pytest.mark.parametrize(("start", "goal"), [(0.3, 0.5), (0.0, 0.2), (0.3, 0.2), (0.5, 0.0)])
def test_an_end_is_a_state_of_the_lattice_only_if_its_mast_is_as_high(start: float, goal: float) -> None:
    problem = asked(Rising(radius=0.2), start, goal)
    front = problem.solve("lattice", step=0.5, headings=4)
    assert verify(problem, front) == []
    for trajectory in front.trajectories:
        assert trajectory.states.mast[[0, -1]].tolist() == [start, goal]


def test_a_robot_that_says_nothing_of_its_other_states_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(UnsupportedModel, match=r"the model fixed also has the states mast; give it a method stations"):
        asked(Fixed(radius=0.2), 0.0, 0.0).solve("lattice", step=0.5)


@pytest.mark.parametrize(("start", "goal", "end"), [(0.3, 0.0, "start"), (0.0, 0.3, "goal")])
def test_an_end_to_which_no_motions_lead_is_refused(start: float, goal: float, end: str) -> None:
    with pytest.raises(QueryError, match=f"the {end} .* is not usable"):
        asked(Unconnected(radius=0.2), start, goal).solve("lattice", step=0.5, headings=4)


@dataclass(frozen=True)
class Crossing(Rising):
    """Robot with a rising mast that never looks along +y."""

    def stations(self, yaw):
        states, headings, motions = super().stations(yaw)
        kept = np.flatnonzero(headings != 1)
        number = np.full(headings.size, -1)
        number[kept] = np.arange(kept.size)
        joined = {kind: number[np.stack(ends)] for kind, ends in motions.items()}
        return Stations(
            states.take(kept),
            headings[kept],
            {kind: tuple(ends[:, (ends >= 0).all(axis=0)]) for kind, ends in joined.items()},
        )


@pytest.mark.parametrize("radius", [0.2, None])
def test_a_heading_without_a_station_is_one_along_which_nothing_goes(radius: float | None) -> None:
    shape = {"footprint": ((0.5, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.5, -0.1))} if radius is None else {}
    robot = Crossing(radius=radius or 1.0, **shape)
    problem = hpop.Problem(WORLD, robot, (0.5, 1.5, 0.0, 0.0), (2.0, 1.0, 0.0, 0.5), ["length"])
    front = problem.solve("lattice", step=0.5, headings=4)
    assert verify(problem, front) == []
    assert front.costs.tolist() == [[2.0]]


@dataclass(frozen=True)
class Undecided(Rising):
    """Robot with a rising mast and a slow turn beside each turn."""

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        return {**super().laws, "slow": replace(super().laws["turn"], kind="slow", turn_rate=0.1)}

    def stations(self, yaw):
        found = super().stations(yaw)
        return found._replace(motions={**found.motions, "slow": found.motions["turn"]})


def test_two_motions_between_the_same_stations_are_refused() -> None:
    with pytest.raises(ModelError, match="in fixed both a turn and a slow lead from station 0 to station 2"):
        asked(Undecided(radius=0.2), 0.0, 0.0).solve("lattice", step=0.5, headings=4)
