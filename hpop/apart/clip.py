"""What is visible of lines and areas: what lies within the page and the clip paths of a drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

Points = Sequence[tuple[float, float]]
NEAR = 0.01
"""How far a point may be beyond a border and is still on it."""


@dataclass(frozen=True)
class Visible:
    """A rectangle and areas, all in the drawing's coordinates; what is within all of them is visible.

    box    x0, y0, x1, y1
    areas  polygons of shapely, beside rectangles along the axes
    """

    box: tuple[float, float, float, float]
    areas: tuple[Any, ...] = ()

    def cut(self, parts: Sequence[Points]) -> Visible:
        """Return what also lies within a clip path of some parts; nothing where the path has no area."""
        corners = [part for part in parts if len(part) > 2]
        if len(corners) == 1 and _is_box(corners[0]):
            x0, y0, x1, y1 = self.box
            xs, ys = zip(*corners[0], strict=True)
            return replace(self, box=(max(x0, min(xs)), max(y0, min(ys)), min(x1, max(xs)), min(y1, max(ys))))
        return replace(self, areas=(*self.areas, _area(corners)))

    def of(self, parts: Sequence[Points], *, filled: bool) -> list[Points]:
        """Return what is visible of lines, or of the area within an odd number of them."""
        x0, y0, x1, y1 = self.box
        inside = all(x0 - NEAR <= x <= x1 + NEAR and y0 - NEAR <= y <= y1 + NEAR for part in parts for x, y in part)
        if inside and not self.areas:
            return list(parts)
        if x1 <= x0 or y1 <= y0:
            return []
        import shapely  # slow to import, and most drawings lie within their page

        whole: Any = _area(parts) if filled else shapely.MultiLineString([part for part in parts if len(part) > 1])
        for area in (shapely.box(x0 - NEAR, y0 - NEAR, x1 + NEAR, y1 + NEAR), *self.areas):
            whole = shapely.intersection(whole, area)
        rings: Any = shapely.get_parts(whole)
        if filled:
            rings = shapely.get_rings(rings[shapely.get_type_id(rings) == shapely.GeometryType.POLYGON])
        lines = rings[shapely.length(rings) > 0]
        return [[(x, y) for x, y in shapely.get_coordinates(line).tolist()] for line in lines]


def _is_box(corners: Points) -> bool:
    """Whether corners, of which the last may be the first again, are those of a rectangle along the axes."""
    points = list(dict.fromkeys(corners))
    if len(points) != 4:
        return False
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = points
    across = ay == by and bx == cx and cy == dy and dx == ax
    return across or (ax == bx and by == cy and cx == dx and dy == ay)


def _area(parts: Sequence[Points]) -> Any:
    """What lies within an odd number of closed lines."""
    import shapely

    rings = [shapely.LineString([*part, part[0]]) for part in parts if len(part) > 2]
    return shapely.build_area(shapely.union_all(rings)) if rings else shapely.Polygon()
