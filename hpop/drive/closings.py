"""Closed areas of a drive, such as doors, and the arcs of a graph that lead through them.

A collision with an area does not depend on the other obstacles. So each area is checked in a world of its own, only
against the arcs near it; the graph stays unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon, mapping
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, IntArray
from hpop.base.text import shown
from hpop.errors import CoversRobot, DriveError, MapError, did_you_mean
from hpop.models.base import PlanarModel
from hpop.models.collision.leaving import Leaving, world_of_area
from hpop.motions import Collision, Model, States
from hpop.planners.graphs.arcs import MOVE, MotionChains
from hpop.planners.graphs.state_graph import StateGraph
from hpop.world import World
from hpop.world.content.content import Zone

BESIDE = 1.0  # m beyond the robot's reach within which the states near an area are checked
NEAR = 1.0  # m from the robot's outline up to which a message counts a closed area as near the robot


def polygon_of(shape: Any, what: str) -> BaseGeometry:
    """Return a valid polygon from a shapely polygon or from corners ((x, y), ...), m; DriveError for anything else.

    what  name of the area in the message of the error
    """
    area = shape
    if not isinstance(shape, BaseGeometry):
        try:
            corners = np.array([(float(x), float(y)) for x, y in shape])
        except (TypeError, ValueError, OverflowError):
            corners = np.zeros((0, 2))
        if len(corners) < 3 or not np.isfinite(corners).all():
            raise DriveError(f"{what} must be a polygon, or three or more corners (x, y) in m, got {shown(shape)}")
        area = Polygon(corners)
    try:
        return Zone("keep-out", area).area
    except MapError as error:
        raise DriveError(f"{what}: {error}") from None


@dataclass(frozen=True, eq=False)
class Closing:
    """An area, m, that is closed to the robot, such as a door or the body of a standing person.

    name    name by which it can be opened; "" for an area without a name
    person  name of the standing person, if the area is the body of a person; else ""
    place   (x, y) m, position of that person
    """

    area: BaseGeometry
    name: str = ""
    person: str = ""
    place: tuple[float, float] = (0.0, 0.0)

    def __str__(self) -> str:
        x, y = self.area.centroid.x, self.area.centroid.y
        if self.person:
            return f"{self.person} who stands at ({x:.2f}, {y:.2f})"
        return repr(self.name) if self.name else f"an area about ({x:.2f}, {y:.2f})"

    def describe(self) -> dict[str, Any]:
        """Return the name, and the area as GeoJSON."""
        return {"name": self.name, "area": mapping(self.area)}

    @cached_property
    def world_of_area(self) -> World:
        """A world with this area as its only obstacle."""
        return world_of_area(self.area)

    def collision(self, model: Model) -> Collision:
        """Return the collision check of a robot with this area.

        If the area is the body of a person, a robot in contact may move as long as the gap does not shrink.
        """
        collision = model.collision(self.world_of_area)
        if not self.person:
            return collision
        return Leaving.of(model.platform, self.place, self.area, collision)

    @cached_property
    def zone(self) -> Zone:
        """The area as a keep-out zone of a world."""
        return Zone("keep-out", self.area, name=self.name)


def named_areas(world: World) -> dict[str, BaseGeometry]:
    """Return the areas, m, of all named zones of a world by name, also of zones that are not closed to the robot.

    Zones with the same name are joined to one area.
    """
    areas: dict[str, list[BaseGeometry]] = {}
    for zone in world.content.zones:
        if zone.name:
            areas.setdefault(zone.name, []).append(zone.area)
    return {name: shapely.union_all(several) for name, several in areas.items()}


def to_close(area: Any, name: str, areas: Mapping[str, BaseGeometry], closed: Sequence[Closing]) -> Closing:
    """Return the `Closing` of an area, given as a polygon or by its name; DriveError if that is not possible.

    name    name of the polygon, by which it can be opened; "" for none
    areas   areas that can be closed by name
    closed  areas that are closed already; the new one must have another name
    """
    if isinstance(area, str):
        if area not in areas:
            raise DriveError(_no_door(area, areas, "give a polygon, with name= to open it by"))
        closing = Closing(areas[area], area)
    else:
        closing = Closing(polygon_of(area, "an area to close"), name)
    if closing.name and any(other.name == closing.name for other in closed):
        raise DriveError(f"{closing} is closed already; open it first, or give another name")
    return closing


def to_open(area: Any, areas: Mapping[str, BaseGeometry], closed: Sequence[Closing]) -> list[Closing]:
    """Return those of the ``closed`` areas whose name or polygon is ``area``; DriveError if there are none.

    areas  areas that can be closed by name, for the message of the error
    """
    if isinstance(area, str):
        if opened := [closing for closing in closed if closing.name == area]:
            return opened
        if area in areas:
            raise DriveError(f"{area!r} is not closed, so there is nothing to open; closed areas: {listed(closed)}")
        names = [closing.name for closing in closed if closing.name]
        raise DriveError(_no_door(area, [*areas, *names], f"closed areas: {listed(closed)}"))
    polygon = polygon_of(area, "an area to open")
    opened = [closing for closing in closed if closing.area.equals(polygon)]
    if not opened:
        raise DriveError(
            f"no closed area equals {shown(polygon.wkt)}; open an area by its name, or by the polygon with which it "
            f"was closed; closed areas: {listed(closed)}"
        )
    return opened


def refuse_covered(closings: Sequence[Closing], model: Model, here: States) -> None:
    """Raise CoversRobot if a closed area covers the robot in the state ``here`` (1,); bodies of people do not count."""
    for closing in closings:
        if not closing.person and not closing.collision(model).states_free(here)[0]:
            raise CoversRobot(
                f"{closing} covers the robot, at ({here.x[0]:.2f}, {here.y[0]:.2f}), so no path leads on; close an "
                "area that does not cover it"
            )


def _no_door(name: str, known: Any, hint: str) -> str:
    names = list(known)
    listed = ", ".join(names) if names else "none (give zones of the world a name)"
    return f"no door or zone of the map is called {shown(name)}.{did_you_mean(name, names)} Known: {listed}; {hint}"


def listed(closed: Sequence[Closing]) -> str:
    """Return the closed areas as text for a message."""
    return ", ".join(map(str, closed)) if closed else "none"


def no_way_out(closings: Sequence[Closing], here: States, model: PlanarModel) -> str:
    """Return a message that no path leads to the goal from a state (1,), with the closed areas near it and elsewhere.

    Return "" if no area is closed.
    """
    place = shapely.Point(float(here.x[0]), float(here.y[0]))
    ordered = sorted(closings, key=lambda closing: closing.area.distance(place))
    near = [closing for closing in ordered if closing.area.distance(place) <= reach_of(model) + NEAR]
    words = [("near the robot", near), ("elsewhere", ordered[len(near) :])]
    each = "; ".join(f"closed {where}: {listed(several)}" for where, several in words if several)
    return f"no path: none is open from where the robot may change its plan; {each}" if each else ""


def reach_of(model: PlanarModel) -> float:
    """Return the largest distance, m, from the position of a robot to a point of its body."""
    return max(float(part.reach) for part in model.platform)


def states_by_place(graph: StateGraph) -> tuple[States, float]:
    """Return all states of a graph, and the length of its longest move, m; :func:`closed_arcs` needs both."""
    states, longest = graph.states(np.arange(graph.size)), 0.0
    arcs = graph.arcs
    tails = np.repeat(np.arange(graph.size), np.diff(arcs.start))
    moves = arcs.kinds == MOVE
    if moves.any():
        tails, heads = tails[moves], arcs.heads[moves]
        longest = float(np.hypot(states.x[heads] - states.x[tails], states.y[heads] - states.y[tails]).max())
    return states, longest


def closed_arcs(graph: StateGraph, closing: Closing, states: States, longest: float) -> IntArray:
    """Return the indices (c,) of the arcs of a graph that a closed area blocks.

    These are motions that collide with it, and on a lattice also diagonal moves past positions in it
    (:meth:`.StateGraph.cut_corners`). ``states`` and ``longest`` come from :func:`states_by_place` for this graph.
    """
    collision = closing.collision(graph.model)
    x_min, y_min, x_max, y_max = closing.area.bounds
    room = reach_of(graph.model) + longest + BESIDE
    near = np.flatnonzero(
        (states.x >= x_min - room)
        & (states.x <= x_max + room)
        & (states.y >= y_min - room)
        & (states.y <= y_max + room)
    )
    begins, ends = graph.arcs.start[near], graph.arcs.start[near + 1]
    tails = np.repeat(near, ends - begins)
    within = np.arange(tails.size) - np.repeat(np.cumsum(ends - begins) - (ends - begins), ends - begins)
    places = graph.arcs.start[tails] + within
    heads, kinds = graph.arcs.heads[places].astype(np.int64), graph.arcs.kinds[places]
    closed = np.zeros(places.size, dtype=np.bool_)
    for number, kind in enumerate(graph.kinds):
        own = np.flatnonzero(kinds == number)
        if own.size:
            closed[own] = ~collision.motions_free(graph.motions(kind, tails[own], heads[own]))
    closed |= graph.cut_corners(tails, kinds, near[~collision.states_free(states.take(near))])
    arcs: IntArray = places[closed]
    return arcs


def chains_closed(chains: MotionChains, closing: Closing) -> BoolArray:
    """Return which chains of motions (C,), by which start and goal are joined to a graph, collide with a closed area.

    A chain that begins in contact with a standing person does not collide if it leads out of contact.
    """
    collision = closing.collision(chains.graph.model)
    closed: BoolArray = ~collision.states_free(chains.corners[0]) & (not closing.person)  # contact may be left
    for rows, motions in chains.motions():
        free: BoolArray = collision.motions_free(motions)
        closed[rows] |= ~free
    return closed
