"""Meshes as convex hulls: searched within given folders only, read by trimesh, refused if not convex."""

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
"""Largest number of faces of a mesh; finer ones are not for collisions, and slow to check for convexity."""
MOST_BODIES = 64
"""Largest number of convex pieces of a mesh."""
DEEPEST = 1e-3
"""Largest depth, m, of a convex mesh's surface in its convex hull."""
SAME = 1e-6
"""Tolerance of equal corners, as a share of a mesh's size: a file may repeat corners for each face."""
KINDS = ("stl", "obj", "ply", "off")


def mesh_path(mesh: UrdfMesh, folder: Path, packages: Mapping[str, str]) -> Path:
    """Return the path of a mesh within the URDF's folder or the package that it names; ModelError for other paths."""
    kind, _, rest = mesh.name.partition("://")
    if rest and kind == "package":
        package, _, rest = rest.partition("/")
        if package not in packages:
            raise ModelError(
                f"the mesh {shown(mesh.name)} is in the package {shown(package)}; give its folder in packages, as "
                f"{{{printable(package)[:80]}: FOLDER}}" + did_you_mean(package, packages)
            )
        folder = Path(packages[package])
    elif rest and kind != "file":
        raise ModelError(f"the mesh {shown(mesh.name)} must be the path of a file, or package://NAME/...")
    else:
        rest = rest or mesh.name
    path = folder / rest
    try:
        real, inside = (Path(os.path.realpath(p)) for p in (path, folder))
    except (OSError, ValueError):
        raise ModelError(f"the mesh {shown(mesh.name)} cannot be the path of a file") from None
    if not real.is_relative_to(inside):
        raise ModelError(
            f"the mesh {shown(mesh.name)} is not in the folder {shown(str(folder))}; files elsewhere are read from "
            "packages only: write package://NAME/... in the URDF, and name the folder in packages, as {NAME: FOLDER}"
        )
    return path


def hulls(data: bytes, path: Path, scale: FloatArray) -> list[Hull]:
    """Return the convex pieces of a mesh, in m; ModelError if one is not convex."""
    mesh = _load_mesh(data, path)
    deepest = _depth(mesh, scale, path)
    bodies = [mesh] if deepest <= DEEPEST else mesh.split(only_watertight=False)
    if len(bodies) > MOST_BODIES:
        raise _error(path, f"expected at most {MOST_BODIES} pieces, found {len(bodies)}")
    if deepest > DEEPEST and not (len(bodies) > 1 and all(_is_convex(body, scale, path) for body in bodies)):
        raise _error(
            path,
            "it is neither convex nor made of separate convex pieces: its surface lies up to "
            f"{deepest:.3g} m within its convex hull; cut it into convex pieces (CoACD and V-HACD do), and give each a "
            "<collision> element with its own file; or use boxes, cylinders and spheres, or the mesh's convex hull if "
            "it is not too large",
        )
    return [Hull(_hull(np.asarray(body.vertices) * scale, path).points) for body in bodies]


def _load_mesh(data: bytes, path: Path) -> Any:
    """Return a mesh of one piece or several, with merged vertices."""
    try:
        import trimesh  # of the extra hpop[arm]
    except ImportError:
        raise ModelError(
            f"the mesh {shown(str(path), 400)} is read by trimesh, which is not installed: pip install 'hpop[arm]'; "
            "boxes, cylinders and spheres need no package"
        ) from None
    kind = path.suffix[1:].lower()
    if kind not in KINDS:
        raise _error(
            path,
            f"meshes are read from {', '.join(KINDS)} files, got {shown(path.suffix)}; convert it, as Blender does, or "
            "trimesh with pycollada for .dae: trimesh.load(FILE, force='mesh').export('mesh.stl')",
        )
    try:
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=kind, force="mesh", process=True, skip_materials=True)
        faces, vertices = len(mesh.faces), np.asarray(mesh.vertices, float)
    except Exception as error:  # whatever a reader of foreign files raises
        hint = "write it with triangles alone, as STL"
        raise _error(path, f"it cannot be read ({printable(error)[:80]}); {hint}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise _error(path, "its vertices must have three coordinates each")
    if not 0 < faces <= MOST_FACES:
        raise _error(
            path,
            f"expected 1 to {MOST_FACES:,} faces, found {faces:,}; decimate it (trimesh's simplify_quadric_decimation, "
            "MeshLab and Blender do), or use its convex hull, a box or a cylinder if that is not too large"
            if faces
            else f"expected 1 to {MOST_FACES:,} faces, found none",
        )
    if not np.isfinite(vertices).all():
        raise _error(path, "its coordinates must be finite numbers")
    joined = _merge_vertices(vertices, np.asarray(mesh.faces))
    return trimesh.Trimesh(*joined, process=False)


def _merge_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return vertices (V, 3) and faces (F, 3) without duplicate vertices, flat faces and duplicate faces."""
    size = float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max()) or 1.0
    _, first, number = np.unique(np.rint(vertices / (SAME * size)), axis=0, return_index=True, return_inverse=True)
    corners = number.reshape(-1)[faces]
    solid = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    _, once = np.unique(np.sort(corners[solid], axis=1), axis=0, return_index=True)
    kept = corners[solid][np.sort(once)]
    used, places = np.unique(kept, return_inverse=True)
    return vertices[first][used], places.reshape(-1, 3)


class _Convex(NamedTuple):
    """Convex hull: the points (V, 3) that span it, and its planes (P, 4), n·x + d <= 0 within."""

    points: FloatArray
    planes: FloatArray


def _hull(points: FloatArray, path: Path) -> _Convex:
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        raise _error(path, "it is flat, or has fewer than four vertices, so it is no solid") from None
    return _Convex(points[found.vertices], found.equations)


def _depth(mesh: Any, scale: FloatArray, path: Path) -> float:
    """Return the largest depth, m, of a mesh's surface in its convex hull, at midpoints of faces and edges."""
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
    """Return whether a piece of a mesh is a convex solid; a piece that shares vertices with others is not."""
    try:
        return _depth(piece, scale, path) <= DEEPEST
    except ModelError:
        return False


def _error(path: Path, said: str) -> ModelError:
    return ModelError(f"the mesh {shown(str(path), 400)}: {said}")


def mesh_bytes(path: Path) -> bytes:
    """Return the bytes of a mesh file."""
    return file_bytes(path, "mesh", MOST_BYTES)
