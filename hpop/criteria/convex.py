"""Convex costs of polylines, for planners that solve convex programs with cvxpy.

A criterion that such planners can minimise has one more method::

    def convex(self, path: ConvexPath) -> ConvexCost:
        return ConvexCost(path.length, exact=True)

Each segment of the polyline stays in a convex region of free space. A convex bound that holds at both ends of a segment
therefore holds all along it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from hpop.motions import Model, States

if TYPE_CHECKING:
    from hpop.world import World
    from hpop.world.geometry.planar import FreeSpace


@dataclass(frozen=True, eq=False)
class ConvexCost:
    """Cost of a polyline as a convex expression of cvxpy.

    expression  scalar, >= 0, in the criterion's unit
    exact       True if it equals the cost of every trajectory along the polyline; False if it is an upper bound
    """

    expression: Any
    exact: bool


class ConvexPath(Protocol):
    """Polyline of n segments whose vertices are variables of a convex program.

    world, model  the world and the robot
    start         state (1,) at the start
    vertices      expression of cvxpy (n+1, 2), m; the first and the last row are constants
    """

    @property
    def world(self) -> World: ...
    @property
    def model(self) -> Model: ...
    @property
    def start(self) -> States: ...
    @property
    def vertices(self) -> Any: ...
    @property
    def length(self) -> Any:
        """Length of the polyline, m, as a convex expression of cvxpy."""

    def shortfall(self, enough: float, space: FreeSpace, body: str) -> Any:
        """Return a convex upper bound, m, on the largest shortfall (enough - d)₊ of a body's distance d to obstacles.

        enough  m, distance that is enough
        space   free space; d is the distance to its border
        body    body of the robot: "base" or "camera"

        Each segment lies in a convex region of the free space. The distance to the border of this region is concave and
        at most d. It equals d where the nearest obstacle is a straight wall.
        """
