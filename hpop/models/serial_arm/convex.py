"""Triangles of meshes, their hulls, whether they are convex, how deep hollows are, and simpler hulls around others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray

DEEPEST = 1e-3
"""A mesh counts as convex if no point of its surface is deeper than this, m, inside its convex hull."""
PROBED = 32
"""Number of planes that bound all depths at first."""
AT_ONCE = 512
"""Points whose depths are computed together."""
FULL = 24
"""A simpler hull gets no more planes if it has only this many corners fewer than allowed."""
NEARLY = 2.5e-4
"""Distance, m, by which corners of a simpler hull may lie beyond a face without being cut off."""
MOST_CORNERS = 256
"""Largest number of corners of a hull that is simplified."""
EXACT = 1e-4
"""Precision of the depth of hollows, m."""
SAMPLES = 20_000
"""Points on a mesh from which the distance of its hull is computed."""
SLACK = 1e-9
"""Distance, m, by which planes of a simpler hull are moved outwards, for floating-point errors."""
LARGE = 1_000_000
"""Number of faces beyond which a hull is enclosed without being computed, and gaps are measured on some faces."""
COARSE = 1 / 100
"""Side of cells, as a share of a mesh's size, by which the vertices of a mesh with very many faces are grouped."""
SAME = 1e-6
"""Tolerance for equal vertices, as a share of a mesh's size; many files repeat the vertices for each face."""


class Surface(NamedTuple):
    """Triangles of a mesh.

    Repeated vertices, flat faces and repeated faces have been removed, unless there are more than ``LARGE`` triangles.

    vertices  (V, 3)  m
    faces     (F, 3)  numbers of the vertices
    """

    vertices: FloatArray
    faces: IntArray

    @property
    def corners(self) -> FloatArray:
        """Return the corners (F, 3, 3) of the faces, m."""
        corners: FloatArray = self.vertices[self.faces]
        return corners

    @property
    def volume(self) -> float:
        """Return the volume, m³, that the triangles enclose; negative if they are turned inwards."""
        middle, parts = self.vertices.mean(axis=0), np.array_split(self.faces, 1 + len(self.faces) // LARGE)
        wedges = ((self.vertices[part] - middle).transpose(1, 0, 2) for part in parts)
        return sum(float(np.einsum("ij,ij->", np.cross(a, b), c)) for a, b, c in wedges) / 6

    def thinned(self) -> Surface:
        """Return these triangles, or evenly chosen ones if there are very many."""
        return self._replace(faces=self.faces[:: 1 + len(self.faces) // LARGE])


class ConvexBody(NamedTuple):
    """Convex hull of points.

    points  (V, 3)  its corners
    planes  (P, 4)  its faces: normal n and offset d, with n·x + d <= 0 for points x inside
    volume  m³
    """

    points: FloatArray
    planes: FloatArray
    volume: float


def convex_body(points: FloatArray) -> ConvexBody | None:
    """Return the convex hull of points (N, 3); None if they are in one plane."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    return ConvexBody(points[found.vertices], found.equations, float(found.volume))


def is_convex(corners: FloatArray, body: ConvexBody) -> bool:
    """Return whether faces with these corners (F, 3, 3) are nowhere deeper inside their convex hull than ``DEEPEST``.

    Looked at are the corners, and the middles of faces and edges.
    """
    from scipy.spatial import cKDTree  # slow to import

    if _depth(corners[:, 0], body.planes, batches=1) > DEEPEST:  # most hollow meshes
        return False
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    sides: FloatArray = 0.5 * (corners + np.roll(corners, 1, axis=1))
    points: FloatArray = np.concatenate([corners.mean(axis=1)[:, None], sides, corners], axis=1)  # (F, 7, 3)
    _, alike = cKDTree(body.planes[:, :3]).query(np.concatenate([normals, -normals]))
    bounds = np.full(points.shape[:2], np.inf)  # of depths, by the two faces of the hull that are most alike
    for plane in body.planes[alike].reshape(2, -1, 4):
        bounds = np.minimum(bounds, -(np.einsum("fij,fj->fi", points, plane[:, :3]) + plane[:, 3:]))
    return _depth(points[bounds > DEEPEST], body.planes, least=DEEPEST) <= DEEPEST


def depth(corners: FloatArray, body: ConvexBody) -> float:
    """Return how deep, m, the deepest corner or middle of faces (F, 3, 3) lies inside a convex body.

    The result may be too small by ``EXACT``.
    """
    return _depth(np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)]), body.planes, error=EXACT)


def gap(corners: FloatArray, body: ConvexBody) -> float:
    """Return about how far, m, points on the surface of a convex body are from faces that it contains, at most.

    Both are sampled: it may be too large by the distance of samples on the faces, some hundredths of their size.
    """
    from scipy.spatial import ConvexHull, cKDTree  # slow to import

    around = body.points[ConvexHull(body.points).simplices]
    known = np.concatenate([_samples(corners, SAMPLES), corners.reshape(-1, 3)])
    tree = cKDTree(known, balanced_tree=False, compact_nodes=False)  # built in a third of the time
    return float(np.max(tree.query(_samples(around, SAMPLES // 10))[0]))


def _samples(corners: FloatArray, count: int) -> FloatArray:
    """Return points (N, 3) drawn at random from triangles (F, 3, 3), equally densely on all."""
    rng = np.random.default_rng(0)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[np.searchsorted(np.cumsum(areas) / areas.sum(), rng.random(count)).clip(0, len(corners) - 1)]
    shares = rng.dirichlet((1.0, 1.0, 1.0), count)
    points: FloatArray = np.einsum("ni,nij->nj", shares, chosen)
    return points


def _depth(
    points: FloatArray, planes: FloatArray, *, least: float = 0.0, error: float = 0.0, batches: int = 0
) -> float:
    """Return the depth, m, of the deepest of points (N, 3) in a convex body; ``least`` if no point is deeper.

    planes   (P, 4)  planes of the body's faces: outward unit normal and offset. The depth of a point is its distance
                     from the nearest plane
    error    m, by which the result may be too small
    batches  largest number of batches of ``AT_ONCE`` points that are looked at; 0 for all points

    Some planes bound the depth of each point from above; the points with the largest bounds are looked at first.
    """
    bounds = np.empty(len(points))
    probes = planes[:: max(1, len(planes) // PROBED)]
    for part in np.array_split(np.arange(len(points)), 1 + len(points) * len(probes) // 10**7):
        bounds[part] = -(points[part] @ probes[:, :3].T + probes[:, 3]).max(axis=1)
    order, deepest = np.argsort(-bounds), least
    order = order[: batches * AT_ONCE] if batches else order
    for begin in range(0, len(order), AT_ONCE):
        if bounds[order[begin]] <= deepest + error:
            break
        some = points[order[begin : begin + AT_ONCE]]
        depths = -(some @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        deepest = max(deepest, float(depths.max(initial=0.0)))
    return deepest


def enclosing(body: ConvexBody, most: int = MOST_CORNERS) -> ConvexBody:
    """Return a convex body with at most ``most`` corners that encloses another one; the same if it has no more.

    It is the intersection of half-spaces that each contain all corners of the body. Their planes are faces of the body
    and of its bounding box: at first few, then again and again those faces beyond which the corners lie farthest.
    """
    from scipy.spatial import HalfspaceIntersection  # slow to import

    if len(body.points) <= most:
        return body
    middle = body.points.mean(axis=0)
    faces = _unlike(body.planes)
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    chosen = _supporting(sides, body.points)
    found = body.points
    used = np.zeros(len(faces), bool)
    while True:
        corners = HalfspaceIntersection(chosen, middle).intersections
        corners = corners[np.isfinite(corners).all(axis=1)]
        if len(corners) > most:
            break
        found = corners
        if len(corners) > most - FULL:
            break
        beyond = corners @ faces[:, :3].T + faces[:, 3]  # (corners, faces)
        beyond[:, used] = -np.inf
        worst = np.argsort(-beyond.max(axis=1))[: max(1, (most - len(corners)) // 4)]
        new = np.unique(beyond[worst].argmax(axis=1))
        new = new[beyond[:, new].max(axis=0) > NEARLY]
        if not len(new):
            break
        used[new] = True
        chosen = np.concatenate([chosen, _supporting(faces[new, :3], body.points)])
    larger = convex_body(found)
    return body if larger is None else larger


def around(points: FloatArray) -> ConvexBody | None:
    """Return a convex body with few corners that encloses very many points (N, 3); None if they are in one plane.

    Its faces have the directions of those of a simple body around some of the points, and lie beyond all of them.
    """
    from scipy.spatial import HalfspaceIntersection  # slow to import

    ends = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
    if (inner := convex_body(np.concatenate([points[:: 1 + len(points) // SAMPLES], points[ends]]))) is None:
        return None
    normals = _unlike(enclosing(inner).planes)[:, :3]
    planes = _supporting(normals, _outermost(points, normals))
    corners = HalfspaceIntersection(planes, inner.points.mean(axis=0)).intersections
    return convex_body(corners[np.isfinite(corners).all(axis=1)])


def sticking_out(surface: Surface, body: ConvexBody) -> FloatArray:
    """Return how far, m, each face (F,) of a mesh sticks out of the planes of a convex body."""
    out = np.empty(len(surface.vertices))
    for part in np.array_split(np.arange(len(out)), 1 + len(out) * len(body.planes) // 10**7):
        out[part] = (surface.vertices[part] @ body.planes[:, :3].T + body.planes[:, 3]).max(axis=1)
    farthest: FloatArray = np.maximum(out, 0.0)[surface.faces].max(axis=1)
    return farthest


def _supporting(normals: FloatArray, points: FloatArray) -> FloatArray:
    """Return the planes (P, 4) with these normals that all points are behind; they touch the points but for a slack."""
    parts = np.array_split(points, 1 + len(points) * len(normals) // 10**7)
    farthest = np.maximum.reduce([(part @ normals.T).max(axis=0) for part in parts])
    return np.column_stack([normals, -farthest - SLACK])


def _outermost(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return those of very many points (N, 3) that may lie farthest in one of the directions (P, 3).

    Points are grouped by cells of a grid. A cell is left out if all its points lie behind one point in each direction.
    """
    first, number, step = cells_of(points, COARSE)
    along = points[first] @ normals.T
    ahead = (np.rint(points[first] / step) * step) @ normals.T + 0.5 * (1.0 + SAME) * step * np.abs(normals).sum(axis=1)
    outer = (ahead + SLACK >= along.max(axis=0)).any(axis=1)
    chosen: FloatArray = points[outer[number]]
    return chosen


def _unlike(planes: FloatArray) -> FloatArray:
    """Return planes without repetitions, as of the triangles of one flat face."""
    _, first = np.unique(np.round(planes, 6), axis=0, return_index=True)
    return planes[np.sort(first)]


def merge_vertices(vertices: FloatArray, faces: IntArray, same: float = SAME) -> tuple[FloatArray, IntArray]:
    """Return the vertices (V, 3) and faces (F, 3) of a mesh without repeated vertices, flat faces or repeated faces.

    same  vertices of one cell of a grid with cells of this share of the mesh's size count as repeated
    """
    first, number, _ = cells_of(vertices, same, faces)
    corners = number[faces]
    solid = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    once, _ = _unique_rows(np.sort(corners[solid], axis=1))
    kept = corners[solid][np.sort(once)]
    used, places = np.unique(kept, return_inverse=True)
    return vertices[first][used], places.reshape(-1, 3)


def cells_of(points: FloatArray, share: float, faces: IntArray | None = None) -> tuple[IntArray, IntArray, float]:
    """Group points (N, 3) by cubic cells, whose middles are multiples of their side.

    share  side of a cell, as a share of the size of all points; given ``faces`` (F, 3), of their corners

    Returns the index of the first point of each cell, the number (N,) of each point's cell, and the side, m.
    """
    extent = np.ptp(points if faces is None else points[faces].reshape(-1, 3), axis=0)
    step = share * (float(extent.max()) or 1.0)
    return *_unique_rows(np.rint(points / step)), step


def _unique_rows(rows: FloatArray | IntArray) -> tuple[IntArray, IntArray]:
    """Group equal rows among rows (N, 3) of whole numbers.

    Returns the index of the first row of each group, and the number (N,) of each row's group.

    Rows with numbers of up to 21 bits are packed into one number each, so that sorting takes a fifth of the time. A
    table of all possible rows needs no sorting, if it is short.
    """
    apart = rows - rows.min(axis=0) if len(rows) else rows
    sides = (apart.max(axis=0, initial=0) + 1).astype(float)
    if sides.prod() <= len(rows):
        keys = apart.astype(np.int64) @ np.array([sides[1] * sides[2], sides[2], 1], np.int64)
        table = np.full(int(sides.prod()), -1)
        table[keys[::-1]] = np.arange(len(rows))[::-1]
        used = table >= 0
        return table[used], (np.cumsum(used) - 1)[keys]
    if len(rows) and sides.max() <= 1 << 21:
        keys = apart.astype(np.int64) @ np.array([1 << 42, 1 << 21, 1])
        _, first, kind = np.unique(keys, return_index=True, return_inverse=True)
    else:
        _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, kind.reshape(-1)


def pieces_of(faces: IntArray) -> int:
    """Return the number of connected pieces of faces (F, 3), joined by edges that two of them share."""
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    keys = edges[:, 0].astype(np.int64) * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(keys, kind="stable")
    ranked, owner = keys[order], order // 3
    begins = np.flatnonzero(np.append(True, ranked[1:] != ranked[:-1]))
    pairs = begins[np.diff(np.append(begins, len(ranked))) == 2]
    links = (np.ones(len(pairs)), (owner[pairs], owner[pairs + 1]))
    return int(connected_components(coo_array(links, shape=(len(faces), len(faces))), directed=False)[0])
