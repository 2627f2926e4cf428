"""Meshes of a URDF: where their files lie, how trimesh reads them, and their convex hulls, whole or in convex pieces.

Files are read only from the URDF's folder and the folders of packages that the user names.
"""

from __future__ import annotations

import importlib.util
import io
import os
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import printable, shown
from hpop.errors import MapError, ModelError
from hpop.models.serial_arm.convex import (
    COARSE,
    LARGE,
    ConvexBody,
    Surface,
    around,
    cells_of,
    convex_body,
    depth,
    enclosing,
    gap,
    is_convex,
    merge_vertices,
    pieces_of,
    sticking_out,
)
from hpop.models.serial_arm.urdf import Robot, UrdfMesh
from hpop.models.serial_arm.xml import XmlFile, file_bytes
from hpop.runtime.limits import one_numpy_thread
from hpop.world.files import extract, sha256
from hpop.world.geometry.solids import Hull

MOST_BYTES = 100_000_000
"""Largest mesh file that is read, unless it is a binary STL file."""
SMALL = 50_000_000
"""Size of files up to which trimesh joins vertices before hpop does."""
MOST_STL_BYTES = 500_000_000
HEADER, FACE = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""Bytes before the faces of a binary STL file, and a face."""
KINDS = ("stl", "obj", "ply", "off", "dae")


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
                f"the mesh {shown(mesh.name)} is in package {shown(package)}, whose folder is unknown: add packages="
                f"{{{printable(package)[:80]}: FOLDER}}"
                + (f" (packages names only {', '.join(map(shown, packages))})" if packages else "")
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


def read_surface(data: bytes, path: Path, scale: FloatArray) -> Surface:
    """Return the triangles of a mesh file, in m.

    data   bytes of the file
    path   its path, for the type of the file and for messages
    scale  (3,) factors of the coordinates

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
        if len(data) > LARGE * FACE.itemsize and _is_binary_stl(data, kind):  # in a third of trimesh's memory
            vertices = np.frombuffer(data, FACE, offset=HEADER)["corners"].reshape(-1, 3).astype(float)
            faces = np.arange(len(vertices)).reshape(-1, 3)
        else:
            mesh: Any = trimesh.load(
                io.BytesIO(data), file_type=kind, force="mesh", process=len(data) <= SMALL, skip_materials=True
            )
            faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, float)
    except ImportError:
        raise mesh_error(path, "reading a .dae file needs pycollada; run pip install 'hpop[arm]'") from None
    except Exception as error:  # trimesh may raise any error for a damaged file
        hint = "export it as STL, with triangles only"
        raise mesh_error(path, f"it cannot be read ({printable(error)[:80]}); {hint}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise mesh_error(path, "its vertices must have three coordinates each")
    if not 0 < len(faces) <= MOST_FACES:
        remedy = "decimate it (trimesh's simplify_quadric_decimation, MeshLab and Blender do)"
        raise mesh_error(
            path,
            f"expected 1 to {MOST_FACES:,} faces, found {len(faces):,}; "
            f"{remedy if len(faces) else 'export the mesh again'}",
        )
    if not np.isfinite(vertices).all():
        raise mesh_error(path, "all coordinates of the file must be finite numbers")
    if len(faces) <= LARGE:
        vertices, faces = merge_vertices(vertices, faces)
    return Surface(vertices * (unit * scale), faces)


def _is_binary_stl(data: bytes, kind: str) -> bool:
    """Return whether the bytes of a file are those of a binary STL file with the number of faces that it says."""
    return kind == "stl" and len(data) == HEADER + FACE.itemsize * int.from_bytes(data[HEADER - 4 : HEADER], "little")


def _collada_unit(path: Path) -> float:
    """Return the unit, m, of a COLLADA file. ModelError if it is no XML, or has document types or entities."""
    file = XmlFile(path, "COLLADA file", "", MOST_BYTES)
    unit = next((element.get("meter") for element in file.root.iter() if element.tag.split("}")[-1] == "unit"), None)
    return 1.0 if unit is None else file.number("its unit", unit)


def mesh_error(path: Path, said: str) -> ModelError:
    """Return a ModelError about a mesh file."""
    return ModelError(f"the mesh {shown(str(path), 400)}: {said}")


def mesh_bytes(path: Path) -> bytes:
    """Return the bytes of a mesh file; ModelError if it cannot be read or is too large."""
    kind = path.suffix[1:].lower()
    data = file_bytes(path, "mesh", MOST_STL_BYTES if kind == "stl" else MOST_BYTES)
    if len(data) > MOST_BYTES and not _is_binary_stl(data, kind):
        raise mesh_error(path, f"a text of at most {MOST_BYTES // 10**6} MB is read; save it as binary STL")
    return data


Way = Literal["hull", "decompose", "exact"]
WAYS: tuple[Way, ...] = ("hull", "decompose", "exact")
"""Ways to treat meshes that are not convex: their hull, a decomposition into convex pieces, or an error."""
MOST_FACES = 10_000_000
"""Largest number of faces of a mesh."""
FINE = 20_000
"""Number of faces up to which the hull of a convex mesh is not simplified."""
FEW = 64
"""Number of corners of the simple bodies by which the pieces of very many faces are chosen."""
MOST_BODIES = 64
"""Largest number of convex pieces of a mesh."""
MOST_PIECES = 16
"""Largest number of pieces into which a mesh is cut."""
MOST_KEPT = 256
"""Largest number of meshes whose hulls are kept in memory for arms that are read later."""
MOST_SAID = 8
"""Largest number of meshes that a note or an error names."""


class MeshHulls(NamedTuple):
    """Convex hulls that stand for a mesh.

    pieces  the hulls
    added   what they add to the mesh, in words: volume, and the largest gap or the number of pieces; "" for a mesh that
            is convex or consists of separate convex pieces
    widest  m, about the largest distance of a point of a single hull from a mesh that is not convex; else 0
    """

    pieces: tuple[Hull, ...]
    added: str = ""
    widest: float = 0.0


class ReadMeshes(NamedTuple):
    """Meshes of a robot.

    hulls   by name of the file in the URDF and by scale
    hashes  SHA-256 of the files, by path
    notes   sentences for the user on meshes that are not convex
    """

    hulls: Mapping[tuple[str, tuple[float, ...]], tuple[Hull, ...]]
    hashes: Mapping[Path, str]
    notes: tuple[str, ...]

    def of(self, mesh: UrdfMesh) -> tuple[Hull, ...]:
        """Return the hulls of a mesh of the robot."""
        return self.hulls[mesh.name, tuple(mesh.scale.tolist())]


_kept: OrderedDict[tuple[Any, ...], MeshHulls] = OrderedDict()


@one_numpy_thread()
def read_meshes(robot: Robot, packages: Mapping[str, str], way: Way) -> ReadMeshes:
    """Read all meshes of a robot's collision geometry; ModelError, which names all that cannot be used."""
    found: dict[tuple[str, tuple[float, ...]], tuple[Hull, ...]] = {}
    hashes: dict[Path, str] = {}
    faults: dict[str, tuple[str, set[str]]] = {}
    hollow: dict[str, MeshHulls] = {}
    for mesh in _meshes(robot):
        key = mesh.name, tuple(mesh.scale.tolist())
        if key in found:
            continue
        try:
            path = mesh_path(mesh, robot.file.path.parent, packages)
            data = mesh_bytes(path)
            hashes[path] = sha256(data)
            read = _hulls_once((hashes[path], *key[1]), data, path, mesh.scale, way)
        except ModelError as error:
            alike = str(error).replace(shown(mesh.name), "")  # as for all meshes of a package without a folder
            said = f"the collision geometry of link {shown(mesh.link)}: {error}"
            faults.setdefault(alike, (said, set()))[1].add(mesh.name)
            continue
        found[key] = read.pieces
        if read.added:
            hollow[path.name] = read
    if faults:
        told = [
            said + (f" ({len(names) - 1} more for this reason)" if len(names) > 1 else "")
            for said, names in faults.values()
        ]
        count, more = sum(len(names) for _, names in faults.values()), len(told) - MOST_SAID
        several = f"{count} of its meshes cannot be used. " if count > 1 else ""
        raise robot.file.error(several + ". ".join(told[:MOST_SAID] + [f"and {more} more"] * (more > 0)))
    return ReadMeshes(found, hashes, tuple(_notes(hollow, way)))


def _meshes(robot: Robot) -> Iterator[UrdfMesh]:
    for geometries in robot.links.values():
        yield from (geometry.shape for geometry in geometries if isinstance(geometry.shape, UrdfMesh))


def _notes(hollow: Mapping[str, MeshHulls], way: Way) -> Iterator[str]:
    """Yield a note on meshes that are not convex, the one with the widest gap first."""
    if hollow:
        ordered = sorted(hollow, key=lambda name: -hollow[name].widest)
        listed = [f"{shown(name)} {hollow[name].added}" for name in ordered[:MOST_SAID]]
        more = [f"{len(hollow) - MOST_SAID} more"] if len(hollow) > MOST_SAID else []
        stands = "their convex hulls stand" if way == "hull" else "convex pieces stand"
        closer = "; meshes: decompose fits closer" if way == "hull" else ""
        yield (
            f"{stands} for meshes that are not convex: {', '.join([*listed, *more])}. Motions that need the filled "
            f"gaps are not found{closer}"
        )


def _hulls_once(content: tuple[Any, ...], data: bytes, path: Path, scale: FloatArray, way: Way) -> MeshHulls:
    """Return the hulls of a mesh, which are kept for meshes of equal ``content`` (hash and scale)."""
    key = (*content, path.suffix.lower(), way)
    if key not in _kept:
        _kept[key] = hulls(data, path, scale, way)
        while len(_kept) > MOST_KEPT:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key]


def hulls(data: bytes, path: Path, scale: FloatArray, way: Way = "hull") -> MeshHulls:
    """Return the convex hulls that stand for a mesh file.

    data   bytes of the file
    path   its path, for the type of the file and for messages
    scale  (3,) factors of the coordinates
    way    what to do with a mesh that is not convex and does not consist of separate convex pieces: take its convex
           hull ("hull"), cut it into convex pieces ("decompose") or refuse it ("exact")

    Raises ModelError if the file cannot be read or is too large, is flat, or is refused.
    """
    surface = read_surface(data, path, scale)
    whole = _solid(surface.vertices, path)
    if is_convex(surface.thinned().corners, whole):
        return MeshHulls((Hull((enclosing(whole) if len(surface.faces) > FINE else whole).points),))
    if len(surface.faces) <= LARGE and (pieces := _convex_pieces(surface, path)) is not None:
        return MeshHulls(tuple(Hull(piece.points) for piece in pieces))
    if way == "exact":
        raise mesh_error(
            path,
            "it must be convex or consist of separate convex pieces, but its surface lies up to "
            f"{depth(surface.thinned().corners, whole):.3g} m inside its convex hull; give meshes: hull, to use "
            "its convex hull, or meshes: decompose, to cut it into convex pieces; or use boxes, cylinders and spheres",
        )
    bodies, reason = _decomposed(surface, path) if way == "decompose" else ([], "")
    if not 0.0 < sum(body.volume for body in bodies) < whole.volume:
        bodies = [enclosing(whole)]
    return _filled(surface, bodies, reason)


def _decomposed(surface: Surface, path: Path) -> tuple[list[ConvexBody], str]:
    """Return at most 16 convex bodies that together contain the surface of a mesh; or none, and the reason.

    CoACD cuts the mesh, in a process of its own with limits of time and memory; vertices of a mesh with very many faces
    are joined before. Its pieces may leave out parts of the surface. So each triangle of the mesh is given to the piece
    that it sticks out of least, and this piece grows to contain it.
    """
    if importlib.util.find_spec("coacd") is None:
        raise ModelError(
            "meshes: decompose needs coacd, which is not installed; run pip install 'hpop[arm]', or give meshes: hull"
        )
    large, probes = len(surface.faces) > LARGE, surface
    if large:  # one vertex for each cell decides to which piece a face is given
        first, number, _ = cells_of(surface.vertices, COARSE / 2)
        probes = Surface(surface.vertices[first], number[surface.faces])
    vertices, faces = merge_vertices(*probes, COARSE) if large else surface
    data = vertices.astype("<f8").tobytes() + faces.astype("<i8").tobytes()
    options = {"vertices": len(vertices), "most": MOST_PIECES}
    try:
        answer = extract("pieces", path, data, options)
    except MapError:
        return [], "not cut into pieces within the limits of time and memory, "
    ends = np.cumsum(answer.words["sizes"])[:-1]
    pieces = [body for part in np.split(answer.arrays["points"], ends) if (body := convex_body(part)) is not None]
    if not pieces:
        return [], "no pieces found, "
    owner, least = np.zeros(len(surface.faces), np.int8), np.full(len(surface.faces), np.inf)
    for place, body in enumerate(pieces):
        beyond = sticking_out(probes, enclosing(body, FEW) if large else body)
        owner[beyond < least] = place
        np.minimum(least, beyond, out=least)
    grown = []
    for place, body in enumerate(pieces):
        corners = surface.vertices[surface.faces[owner == place]].reshape(-1, 3)
        within = np.concatenate([body.points, corners])
        grown.append((around(within) if large else None) or enclosing(_solid(within, path)))
    return grown, ""


def _filled(surface: Surface, bodies: Sequence[ConvexBody], reason: str) -> MeshHulls:
    """Return convex bodies that stand for a mesh, with what they add to it; ``reason`` begins the words on that."""
    widest = gap(surface.thinned().corners, bodies[0]) if len(bodies) == 1 else 0.0
    volume, filled = abs(surface.volume), sum(body.volume for body in bodies)
    share = f"+{100 * (filled / volume - 1):.0f} % volume, " if 0 < volume <= filled else ""
    pieces = tuple(Hull(body.points) for body in bodies)
    what = f"gaps up to {float(f'{1000 * widest:.2g}'):g} mm" if len(bodies) == 1 else f"{len(bodies)} pieces"
    return MeshHulls(pieces, f"({reason}{share}{what})", widest)


def _convex_pieces(surface: Surface, path: Path) -> list[ConvexBody] | None:
    """Return the hulls of the pieces of a mesh, if it consists of at most 64 separate convex pieces; else None."""
    if not 1 < pieces_of(surface.faces) <= MOST_BODIES:
        return None
    import trimesh  # installed by the extra hpop[arm]

    found = []
    for piece in trimesh.Trimesh(*surface, process=False).split(only_watertight=False):
        vertices, faces = np.asarray(piece.vertices, float), np.asarray(piece.faces)
        body = convex_body(vertices)
        if body is None or not is_convex(vertices[faces], body):
            return None
        found.append(body)
    return found if len(found) > 1 else None


def _solid(points: FloatArray, path: Path) -> ConvexBody:
    """Return the convex hull of points (N, 3); a body around it if they are very many.

    Raises ModelError, about the file ``path``, if they are in one plane.
    """
    body = around(points) if len(points) > LARGE else convex_body(points)
    if body is None:
        raise mesh_error(
            path, "a mesh must be a solid, but it is flat or has fewer than four vertices; use a thin box instead"
        )
    return body
