"""Reader of mesh files of a URDF: each mesh must consist of convex pieces, and is returned as convex hulls.

Files are read by trimesh, and only from the URDF's folder and the folders of packages that the user names.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import printable, shown
from hpop.errors import ModelError, did_you_mean
from hpop.models.serial_arm.urdf import UrdfMesh
from hpop.models.serial_arm.xml import file_bytes
from hpop.world.geometry.solids import Hull

MOST_BYTES = 50_000_000
"""Largest mesh file that is read."""
MOST_FACES = 20_000
"""Largest number of faces of a mesh; finer meshes are meant for pictures and are slow to check for convexity."""
MOST_BODIES = 64
"""Largest number of convex pieces of a mesh."""
DEEPEST = 1e-3
"""A mesh counts as convex if no point of its surface is deeper than this, m, inside its convex hull."""
SAME = 1e-6
"""Tolerance for equal vertices, as a share of a mesh's size; many files repeat the vertices for each face."""
KINDS = ("stl", "obj", "ply", "off")


def mesh_path(mesh: UrdfMesh, folder: Path, packages: Mapping[str, str]) -> Path:
    """Return the path of a mesh file that a URDF names.

    folder    folder of the URDF
    packages  folders of packages, by name

    Raises ModelError if the file is not within the folder of the URDF or of the named package.
    """
    kind, _, rest = mesh.name.partition("://")
    if rest and kind == "package":
        package, _, rest = rest.partition("/")
        if package not in packages:
            raise ModelError(
                f"the folder of package {shown(package)} must be given for the mesh {shown(mesh.name)}; give it in "
                f"packages, as {{{printable(package)[:80]}: FOLDER}}" + did_you_mean(package, packages)
            )
        folder = Path(packages[package])
    elif rest and kind != "file":
        raise ModelError(f"a mesh in a URDF must be the path of a file, or package://NAME/..., got {shown(mesh.name)}")
    else:
        rest = rest or mesh.name
    path = folder / rest
    try:
        real, inside = (Path(os.path.realpath(p)) for p in (path, folder))
    except (OSError, ValueError):
        raise ModelError(
            f"a mesh in a URDF must be the path of a file, but {shown(mesh.name)} is no valid path; correct the URDF"
        ) from None
    if not real.is_relative_to(inside):
        raise ModelError(
            f"the mesh {shown(mesh.name)} is not in the folder {shown(str(folder))}. Meshes elsewhere are read from "
            "packages only: write package://NAME/... in the URDF, and give the folder in packages, as {NAME: FOLDER}"
        )
    return path


def hulls(data: bytes, path: Path, scale: FloatArray) -> list[Hull]:
    """Return the convex pieces of a mesh file as hulls, in m.

    data   bytes of the file
    path   its path, for the type of the file and for messages
    scale  (3,) factors of the coordinates

    Raises ModelError if a piece is not convex, or if the file cannot be read or is too large.
    """
    mesh = _load_mesh(data, path)
    deepest = _depth(mesh, scale, path)
    bodies = [mesh] if deepest <= DEEPEST else mesh.split(only_watertight=False)
    if len(bodies) > MOST_BODIES:
        raise _error(path, f"expected at most {MOST_BODIES} pieces, found {len(bodies)}")
    if deepest > DEEPEST and not (len(bodies) > 1 and all(_is_convex(body, scale, path) for body in bodies)):
        raise _error(
            path,
            "it must be convex or consist of separate convex pieces, but its surface lies up to "
            f"{deepest:.3g} m inside its convex hull; cut it into convex pieces (CoACD and V-HACD do that), and give "
            "each a <collision> element with its own file; or use boxes, cylinders and spheres, or the mesh's convex "
            "hull if that is not too large",
        )
    return [Hull(_hull(np.asarray(body.vertices) * scale, path).points) for body in bodies]


def _load_mesh(data: bytes, path: Path) -> Any:
    """Return a mesh file as a mesh of trimesh, with equal vertices merged; it may consist of several pieces."""
    try:
        import trimesh  # installed by the extra hpop[arm]
    except ImportError:
        raise ModelError(
            f"reading the mesh {shown(str(path), 400)} needs trimesh, which is not installed; run pip install "
            "'hpop[arm]', or use boxes, cylinders and spheres, which need no package"
        ) from None
    kind = path.suffix[1:].lower()
    if kind not in KINDS:
        raise _error(
            path,
            f"a mesh file must be of type {', '.join(KINDS)}, got {shown(path.suffix)}; convert it with Blender, or a "
            ".dae with trimesh and pycollada: trimesh.load(FILE, force='mesh').export('mesh.stl')",
        )
    try:
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=kind, force="mesh", process=True, skip_materials=True)
        faces, vertices = len(mesh.faces), np.asarray(mesh.vertices, float)
    except Exception as error:  # trimesh may raise any error for a damaged file
        hint = "export it as STL, with triangles only"
        raise _error(path, f"it cannot be read ({printable(error)[:80]}); {hint}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise _error(path, "its vertices must have three coordinates each")
    if not 0 < faces <= MOST_FACES:
        raise _error(
            path,
            f"expected 1 to {MOST_FACES:,} faces, found {faces:,}; decimate it (trimesh's simplify_quadric_decimation, "
            "MeshLab and Blender do), or use its convex hull, a box or a cylinder if that is not too large"
            if faces
            else f"expected 1 to {MOST_FACES:,} faces, found none; export the mesh again",
        )
    if not np.isfinite(vertices).all():
        raise _error(path, "its coordinates must be finite numbers")
    joined = _merge_vertices(vertices, np.asarray(mesh.faces))
    return trimesh.Trimesh(*joined, process=False)


def _merge_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the vertices (V, 3) and faces (F, 3) of a mesh without repeated vertices, flat faces or repeated faces."""
    size = float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max()) or 1.0
    _, first, number = np.unique(np.rint(vertices / (SAME * size)), axis=0, return_index=True, return_inverse=True)
    corners = number.reshape(-1)[faces]
    solid = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    _, once = np.unique(np.sort(corners[solid], axis=1), axis=0, return_index=True)
    kept = corners[solid][np.sort(once)]
    used, places = np.unique(kept, return_inverse=True)
    return vertices[first][used], places.reshape(-1, 3)


class _Convex(NamedTuple):
    """Convex hull of points.

    points  (V, 3)  its corners
    planes  (P, 4)  its faces: normal n and offset d, with n·x + d <= 0 for points x inside
    """

    points: FloatArray
    planes: FloatArray


def _hull(points: FloatArray, path: Path) -> _Convex:
    """Return the convex hull of points (N, 3); ModelError, about the file ``path``, if they are in one plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        raise _error(
            path, "a mesh must be a solid, but it is flat or has fewer than four vertices; use a thin box instead"
        ) from None
    return _Convex(points[found.vertices], found.equations)


def _depth(mesh: Any, scale: FloatArray, path: Path) -> float:
    """Return how deep, m, the surface of a mesh lies inside its convex hull at most; 0 for a convex mesh.

    The depth is measured at the corners, and at the midpoints of faces and edges.
    """
    corners = np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)] * scale  # (F, 3, 3)
    planes = _hull(corners.reshape(-1, 3), path).planes
    sides = 0.5 * (corners + np.roll(corners, 1, axis=1))
    points = np.concatenate([corners.mean(axis=1), sides.reshape(-1, 3), corners.reshape(-1, 3)])
    deepest = 0.0
    for part in np.array_split(points, 1 + points.shape[0] * planes.shape[0] // 10**7):
        depths = -(part @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        deepest = max(deepest, float(depths.max(initial=0.0)))
    return deepest


def _is_convex(piece: Any, scale: FloatArray, path: Path) -> bool:
    """Return whether a connected piece of a mesh is a convex solid; a flat piece is not."""
    try:
        return _depth(piece, scale, path) <= DEEPEST
    except ModelError:
        return False


def _error(path: Path, said: str) -> ModelError:
    """Return a ModelError about a mesh file."""
    return ModelError(f"the mesh {shown(str(path), 400)}: {said}")


def mesh_bytes(path: Path) -> bytes:
    """Return the bytes of a mesh file; ModelError if it cannot be read or is too large."""
    return file_bytes(path, "mesh", MOST_BYTES)
