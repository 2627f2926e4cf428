"""How a criterion declares that it is convex in the vertices of a polyline, as an atom of cvxpy declares its curvature.

A criterion that can be minimised by convex programs has one more method::

    def convex(self, path: ConvexPath) -> ConvexCost:
        return ConvexCost(path.length, exact=True)

Each segment of the path stays in a convex region of free space, so a constraint or a cost that is convex in its ends
holds all along it.
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
    """A convex cvxpy expression, and what it is of the cost.

    expression  scalar, >= 0, in the criterion's unit
    exact       whether it equals the cost of every trajectory along the path; else it is an upper bound
    """

    expression: Any
    exact: bool


class ConvexPath(Protocol):
    """A polyline of n segments whose vertices are cvxpy expressions.

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
        """Upper bound of max (enough - d)₊ along the path, m: convex. d is a body's distance to a space's border.

        In a convex region that the border does not enter, the distance to the region's own border is concave and no
        greater than d. Equal to d where the nearest obstacle is a straight wall.
        """
