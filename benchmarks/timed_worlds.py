"""Museums with people who walk through them, as the lattice planner puts them on a clock; and pictures of both.

Costs are turns, length and time in people's zones, counted in whole turns, millimetres and hundredths of a second; or
in the criteria's own quanta, which are a thousand and ten thousand times as fine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

import hpop
import hpop.examples
from hpop.base.arrays import FloatArray
from hpop.criteria import HallZones, Length, Turns
from hpop.planners import Lattice
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.search.timed import PathSteps, TimedGraph, TimedPaths
from hpop.view.ground import outline
from hpop.world import Person

STEP = 0.25  # m
MARGIN = 0.1  # m kept from people
HOLD = 1.0  # s
SHOWN = 2.0  # s between two places of a person that the picture names
WAYS = (("#000000", 5.0), ("#d95e00", 3.0), ("#0072b2", 1.5))  # of the ways drawn, and points
PEOPLE = ("#8c4a6b", "#b8860b", "#56b4e9", "#e07a5f")


class Millimetres(Length):
    """The length, counted more coarsely."""

    quantum = 1e-3


class Hundredths(HallZones):
    """Time in people's zones, counted more coarsely."""

    quantum = 1e-2


class Query(NamedTuple):
    """Query of a benchmark: a timed graph, its ends and its clock."""

    graph: TimedGraph
    source: int
    targets: list[int]


@dataclass(frozen=True)
class Museum:
    """A place, people in it, and a way through; arrive_by in s."""

    name: str
    problem: hpop.Problem
    arrive_by: float

    @cached_property
    def lattice(self) -> StateLattice:
        """States and motions, without time."""
        return Lattice(step=STEP).lattice(self.problem)

    def planner(self, tick: float) -> Lattice:
        """Return the planner of this lattice, on a clock of ``tick`` seconds."""
        return Lattice(step=STEP, clock=tick, hold=HOLD, arrive_by=self.arrive_by, margin=MARGIN)

    def query(self, tick: float, *, fine: bool = False) -> Query:
        """Return the lattice on a clock of ``tick`` seconds; ``fine``: in the criteria's own quanta."""
        space, start, goals = Lattice(step=STEP).ends(self.lattice, self.problem)
        criteria = (Turns(), Length(), HallZones()) if fine else (Turns(), Millimetres(), Hundredths())
        options = TimeOptions(clock=tick, hold=HOLD, arrive_by=self.arrive_by, margin=MARGIN)
        timed = timed_graph(space, criteria, start, goals, options)
        return Query(timed.graph, timed.start, goals)

    def way(self, steps: PathSteps, tick: float) -> tuple[FloatArray, FloatArray]:
        """Places (N, 2), m, that a path comes through, and those at which it holds, each with the seconds (h, 3)."""
        start = Lattice(step=STEP).ends(self.lattice, self.problem).start
        states = self.lattice.states(np.where(steps.nodes < self.lattice.size, steps.nodes, start))  # begins beside it
        places, held = np.column_stack([states.x, states.y]), steps.arcs < 0
        return places, np.column_stack([places[:-1][held], np.diff(steps.departures)[held] * tick])


def small() -> Museum:
    """15 x 10 m, three rooms with a door in each wall; two visitors come through both doors towards the robot."""
    walls = [shapely.box(x - 0.1, low, x + 0.1, high) for x in (5.0, 10.0) for low, high in ((0.0, 4.2), (5.8, 10.0))]
    exhibits = [shapely.box(2.4, 2.0, 3.2, 3.0), shapely.box(7.0, 3.9, 8.0, 4.4), shapely.box(7.0, 5.6, 8.0, 6.1)]
    exhibits.append(shapely.box(12.0, 7.0, 13.0, 8.0))
    world = hpop.World.from_polygons([*walls, *exhibits], extent=shapely.box(0, 0, 15, 10))
    people = [
        Person(9.0, 5.0, velocity=(-1.0, 0.0), until=8.0, name="ahead"),
        Person(14.0, 5.0, velocity=(-0.9, 0.0), until=14.0, name="behind"),
    ]
    return Museum("museum of 15 x 10 m", _among(world, people, (1.25, 5.0, 0.0), (13.75, 5.0, 0.0)), 40.0)


def large() -> Museum:
    """Return the example museum, 30 x 20 m, and four people: in the hallway, the upper rooms and two doors."""
    given = hpop.examples.museum()
    people = [
        Person(26.0, 10.0, velocity=(-1.0, 0.0), until=20.0, name="hallway"),
        Person(3.0, 16.0, velocity=(0.9, 0.0), until=22.0, name="upper rooms"),
        Person(24.9, 3.0, velocity=(0.0, 0.8), until=12.0, name="lower door"),
        Person(4.7, 14.0, velocity=(0.0, -0.7), until=15.0, name="upper door"),
    ]
    return Museum("museum of 30 x 20 m", _among(given.world, people, given.start, given.goal), 60.0)


def _among(world: hpop.World, people: list[Person], start: tuple[float, ...], goal: tuple[float, ...]) -> hpop.Problem:
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    return hpop.Problem(world.with_content(people=people), robot, start, goal, [Turns(), Length(), HallZones()])


MUSEUMS = {"small": small, "large": large}


def best(paths: TimedPaths) -> dict[str, int]:
    """Rows of a front: the fewest turns, the shortest way, the least time in zones; of several the first."""
    names = "fewest turns", "shortest", "least time in zones"
    return {} if not len(paths) else {name: int(np.argmin(paths.costs[:, j])) for j, name in enumerate(names)}


def picture(museums: Mapping[str, tuple[Museum, dict[str, tuple[list[int], FloatArray, FloatArray]]]]) -> Figure:
    """Every museum with its people's tracks, and the ways named: costs, places, holds."""
    figure = Figure(figsize=(10, 15), layout="constrained")
    for axes, (museum, ways) in zip(np.ravel([figure.subplots(len(museums), 1)]), museums.values(), strict=True):
        _draw(axes, museum, ways)
    return figure


def _draw(axes: Axes, museum: Museum, ways: Mapping[str, tuple[list[int], FloatArray, FloatArray]]) -> None:
    world = museum.problem.world
    x_min, y_min, x_max, y_max = world.bounds
    axes.add_patch(PathPatch(outline(world.solid()), facecolor="#4a4a4a", linewidth=0))
    for (colour, width), (name, (costs, places, holds)) in zip(WAYS, ways.items(), strict=False):
        turns, length, zones = costs[0], costs[1] * Millimetres.quantum, costs[2] * Hundredths.quantum
        label = f"{name}: {turns} turns, {length:.1f} m, {zones:.2f} s in zones"
        if len(holds):
            label += f", holds {', '.join(f'{seconds:.1f}' for seconds in holds[:, 2])} s"
        axes.plot(*places.T, color=colour, linewidth=width, label=label, zorder=3)
        axes.plot(*holds[:, :2].T, "s", color=colour, markersize=9, markerfacecolor="none", zorder=4)
    for number, person in enumerate(world.content.people):
        until = float(person.until or 0.0)
        _draw_track(axes, person, np.append(np.arange(0.0, until, SHOWN), until), number)
    for name, (x, y, _), mark in (("start", museum.problem.start, "o"), ("goal", museum.problem.goal, "*")):
        axes.plot(x, y, mark, color="#009e73", markersize=13, label=name, zorder=6)
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.set_title(f"{museum.name}: three ways of its exact front; squares are holds", loc="left")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), fontsize=8, ncols=2, frameon=False, labelspacing=0.8)


def _draw_track(axes: Axes, person: Person, times: FloatArray, number: int) -> None:
    """Draw a person's track, with the time here and there, and a cross where the prediction ends."""
    x, y = (np.broadcast_to(column, times.shape) for column in person.at(times))
    colour = PEOPLE[number % len(PEOPLE)]
    label = f"visitor, {person.name}: where at which second, gone after {times[-1]:g} s"
    axes.plot(x, y, "-o", color=colour, linewidth=1.5, markersize=4, zorder=2, label=label)
    axes.plot(x[-1], y[-1], "x", color=colour, markersize=11, markeredgewidth=3, zorder=4)
    for at_x, at_y, t in zip(x, y, times, strict=True):
        below = (2, 5) if number % 2 == 0 else (2, -11)
        axes.annotate(f"{t:g}", (at_x, at_y), below, textcoords="offset points", color=colour, fontsize=7, zorder=4)
