"""What is closed while a robot drives: doors and other areas, and which arcs of a graph lead through them.

Whether a robot hits one area does not depend on what else there is. So an area is looked at in a world of its own, and
only arcs near it are: the graph, with all that is known of it, stays.
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
from hpop.models.collision.leaving import Leaving, alone
from hpop.motions import Collision, Model, States
from hpop.planners.graphs.arcs import MOVE, Chains
from hpop.planners.graphs.state_graph import StateGraph
from hpop.world import World
from hpop.world.content.content import Zone

BESIDE = 1.0  # m of room round an area in the world of its own, beyond all that a robot reaches


def polygon_of(given: Any, what: str) -> BaseGeometry:
    """A shapely polygon, or one of corners ((x, y), ...), m, checked as zones are; DriveError for anything else."""
    area = given
    if not isinstance(given, BaseGeometry):
        try:
            corners = np.array([(float(x), float(y)) for x, y in given])
        except (TypeError, ValueError, OverflowError):
            corners = np.zeros((0, 2))
        if len(corners) < 3 or not np.isfinite(corners).all():
            raise DriveError(f"{what} must be a polygon, or three or more corners (x, y) in m, got {shown(given)}")
        area = Polygon(corners)
    try:
        return Zone("keep-out", area).area
    except MapError as error:
        raise DriveError(f"{what}: {error}") from None


@dataclass(frozen=True, eq=False)
class Closing:
    """An area, m, that is closed to the robot.

    name  by which it is opened again; "" for one that is known by its polygon alone
    who   whose body it is, who stands there: a name, or "somebody"; "" for an area
    place  (x, y) m, where that is
    """

    area: BaseGeometry
    name: str = ""
    who: str = ""
    place: tuple[float, float] = (0.0, 0.0)

    def __str__(self) -> str:
        x, y = self.area.centroid.x, self.area.centroid.y
        if self.who:
            return f"{self.who} who stands at ({x:.2f}, {y:.2f})"
        return repr(self.name) if self.name else f"an area about ({x:.2f}, {y:.2f})"

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return {"name": self.name, "area": mapping(self.area)}

    @cached_property
    def alone(self) -> World:
        """A world in which nothing else is."""
        return alone(self.area)

    def collision(self, model: Model) -> Collision:
        """What tells which states and motions do not touch it; those too that leave contact with somebody."""
        collision = model.collision(self.alone)
        if not self.who:
            return collision
        return Leaving(model.platform, self.place, collision)

    @cached_property
    def zone(self) -> Zone:
        """The same as a zone of a world."""
        return Zone("keep-out", self.area, name=self.name)


def named_areas(world: World) -> dict[str, BaseGeometry]:
    """The areas of a world that have names, m: its named zones, of which keep-out ones are closed."""
    areas: dict[str, list[BaseGeometry]] = {}
    for zone in world.content.zones:
        if zone.name:
            areas.setdefault(zone.name, []).append(zone.area)
    return {name: shapely.union_all(several) for name, several in areas.items()}


def to_close(given: Any, name: str, known: Mapping[str, BaseGeometry], closed: Sequence[Closing]) -> Closing:
    """The closing of a polygon, or of an area that is known by its name; DriveError for what is neither.

    known   areas by name
    closed  what is closed already: a name stands for one area
    """
    if isinstance(given, str):
        if given not in known:
            raise DriveError(_no_door(given, known, "give a polygon, with name= to open it by"))
        closing = Closing(known[given], given)
    else:
        closing = Closing(polygon_of(given, "what is closed"), name)
    if closing.name and any(other.name == closing.name for other in closed):
        raise DriveError(f"{closing} is closed already; open it first, or give another name")
    return closing


def to_open(given: Any, known: Mapping[str, BaseGeometry], closed: Sequence[Closing]) -> list[Closing]:
    """Which of the closings an opening opens: those of the name, or of the very area.

    Raises DriveError where there are none.
    """
    if isinstance(given, str):
        if found := [closing for closing in closed if closing.name == given]:
            return found
        if given in known:
            raise DriveError(f"{given!r} is not closed, so there is nothing to open; closed are {listed(closed)}")
        names = [closing.name for closing in closed if closing.name]
        raise DriveError(_no_door(given, [*known, *names], f"closed are {listed(closed)}"))
    area = polygon_of(given, "what is opened")
    found = [closing for closing in closed if closing.area.equals(area)]
    if not found:
        raise DriveError(
            f"no closing has the area {shown(area.wkt)}; open one by its name, or by the polygon with which it was "
            f"closed; closed are {listed(closed)}"
        )
    return found


def refuse_covered(closings: Sequence[Closing], model: Model, here: States) -> None:
    """Raise CoversRobot where a robot, in a state (1,), is within an area that is closed; people may be left."""
    for closing in closings:
        if not closing.who and not closing.collision(model).states_free(here)[0]:
            raise CoversRobot(
                f"{closing} covers the robot, at ({here.x[0]:.2f}, {here.y[0]:.2f}), from where nothing could be "
                "planned; tell of what is beside it"
            )


def _no_door(name: str, known: Any, hint: str) -> str:
    names = list(known)
    listed = ", ".join(names) if names else "none: name zones of the world"
    return f"no door or zone of the map is called {shown(name)}.{did_you_mean(name, names)} Known: {listed}; {hint}"


def listed(closed: Sequence[Closing]) -> str:
    """What is closed, in words."""
    return ", ".join(map(str, closed)) if closed else "none"


def reach_of(model: PlanarModel) -> float:
    """How far, m, a robot reaches from its place."""
    return max(float(part.reach) for part in model.platform)


def states_by_place(graph: StateGraph) -> tuple[States, float]:
    """All states of a graph, and the length, m, of its longest move."""
    states, longest = graph.states(np.arange(graph.size)), 0.0
    arcs = graph.arcs
    tails = np.repeat(np.arange(graph.size), np.diff(arcs.start))
    moves = arcs.kinds == MOVE
    if moves.any():
        tails, heads = tails[moves], arcs.heads[moves]
        longest = float(np.hypot(states.x[heads] - states.x[tails], states.y[heads] - states.y[tails]).max())
    return states, longest


def closed_arcs(graph: StateGraph, closing: Closing, states: States, longest: float) -> IntArray:
    """Which arcs (c,) of a graph, by number, lead through a closing, or past it where corners may not be cut.

    states, longest  of the graph, as :func:`states_by_place` gives them
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
    found: IntArray = places[closed]
    return found


def chains_closed(chains: Chains, closing: Closing) -> BoolArray:
    """Which chains (C,) of motions touch a closing."""
    collision = closing.collision(chains.graph.model)
    closed: BoolArray = ~collision.states_free(chains.corners[0]) & (not closing.who)  # contact may be left
    for rows, motions in chains.motions():
        free: BoolArray = collision.motions_free(motions)
        closed[rows] |= ~free
    return closed
