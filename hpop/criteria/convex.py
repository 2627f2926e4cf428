"""Convex forms of criteria for polylines, declared as an atom of cvxpy declares its curvature.

A criterion that can be minimised by convex programs has one more method::

    def convex(self, path: ConvexPath) -> ConvexCost:
        return ConvexCost(path.length, exact=True)

Each segment of the path stays in a convex region of free space. So a constraint or a cost that is convex in the ends of
a segment holds all along it.
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
    """Convex cvxpy expression of a cost.

    expression  scalar, >= 0, in the criterion's unit
    exact       whether it equals the cost of every trajectory along the path; else it is an upper bound
    """

    expression: Any
    exact: bool


class ConvexPath(Protocol):
    """Polyline of n segments with vertices that are cvxpy expressions.

    world, model
    start     the state at the start, (1,)
    vertices  expression (n+1, 2), m; the first and the last row are constants
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
        """Sum of the segments' lengths, m: convex."""

    def shortfall(self, enough: float, space: FreeSpace, body: str) -> Any:
        """Return a convex upper bound of max (enough - d)₊ along the path, m, d being a body's distance to the border.

        In a convex region that the border does not enter, the distance to the region's own border is concave and no
        greater than d. It equals d where the nearest obstacle is a straight wall.
        """
