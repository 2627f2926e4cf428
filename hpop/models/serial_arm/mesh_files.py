"""Mesh files of a URDF: where they lie, and their corners and triangles as trimesh reads them.

Files are read only from the URDF's folder and the folders of packages that the user names.
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
from hpop.models.serial_arm.xml import XmlFile, file_bytes

MOST_BYTES = 50_000_000
"""Largest mesh file that is read."""
SAME = 1e-6
"""Tolerance for equal vertices, as a share of a mesh's size; many files repeat the vertices for each face."""
KINDS = ("stl", "obj", "ply", "off", "dae")


class Surface(NamedTuple):
    """Triangles of a mesh, without repeated vertices, flat faces or repeated faces.

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


def read_surface(data: bytes, path: Path, scale: FloatArray, most_faces: int) -> Surface:
    """Return the triangles of a mesh file, in m.

    data        bytes of the file
    path        its path, for the type of the file and for messages
    scale       (3,) factors of the coordinates
    most_faces  largest number of faces

    A COLLADA file is read in its unit, and as if its z axis were up, as RViz and MoveIt do. Raises ModelError if the
    file cannot be read or is too large.
    """
    try:
        import trimesh  # installed by the extra hpop[arm]
    except ImportError:
        raise ModelError(
            f"reading the mesh {shown(str(path), 400)} needs trimesh, which is not installed; run pip install "
            "'hpop[arm]', or use boxes, cylinders and spheres, which need no package"
        ) from None
    kind = path.suffix[1:].lower()
    if kind not in KINDS:
        raise mesh_error(
            path,
            f"a mesh file must be of type {', '.join(KINDS)}, got {shown(path.suffix)}; convert it with Blender, or by "
            "trimesh.load(FILE, force='mesh').export('mesh.stl')",
        )
    unit = _collada_unit(path) if kind == "dae" else 1.0
    try:
        if kind == "dae":
            import collada  # noqa: F401  # trimesh reads by it; installed by the extra hpop[arm]
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=kind, force="mesh", process=True, skip_materials=True)
        faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, float)
    except ImportError:
        raise mesh_error(path, "reading a .dae file needs pycollada; run pip install 'hpop[arm]'") from None
    except Exception as error:  # trimesh may raise any error for a damaged file
        hint = "export it as STL, with triangles only"
        raise mesh_error(path, f"it cannot be read ({printable(error)[:80]}); {hint}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise mesh_error(path, "its vertices must have three coordinates each")
    if not 0 < len(faces) <= most_faces:
        raise mesh_error(
            path,
            f"expected 1 to {most_faces:,} faces, found {len(faces):,}; decimate it (trimesh's "
            "simplify_quadric_decimation, MeshLab and Blender do), or give meshes: hull"
            if len(faces)
            else f"expected 1 to {most_faces:,} faces, found none; export the mesh again",
        )
    if not np.isfinite(vertices).all():
        raise mesh_error(path, "its coordinates must be finite numbers")
    joined = _merge_vertices(vertices, faces)
    return Surface(joined[0] * (unit * scale), joined[1])


def _collada_unit(path: Path) -> float:
    """Return the unit, m, of a COLLADA file. ModelError if it is no XML, or has document types or entities."""
    file = XmlFile(path, "COLLADA file", "", MOST_BYTES)
    unit = next((element.get("meter") for element in file.root.iter() if element.tag.split("}")[-1] == "unit"), None)
    return 1.0 if unit is None else file.number("its unit", unit)


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


def mesh_error(path: Path, said: str) -> ModelError:
    """Return a ModelError about a mesh file."""
    return ModelError(f"the mesh {shown(str(path), 400)}: {said}")


def mesh_bytes(path: Path) -> bytes:
    """Return the bytes of a mesh file; ModelError if it cannot be read or is too large."""
    return file_bytes(path, "mesh", MOST_BYTES)
