"""Meshes of links: convex ones and convex pieces become hulls, others are refused, as is what lies elsewhere."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

from hpop.errors import ModelError
from hpop.models import SerialArm
from hpop.models.serial_arm.convex import (
    DEEPEST,
    EXACT,
    LARGE,
    MOST_CORNERS,
    around,
    convex_body,
    depth,
    enclosing,
    is_convex,
)
from hpop.models.serial_arm.meshes import MOST_BYTES, MOST_STL_BYTES
from tests.models.serial_arm.arms import CRANE

trimesh = pytest.importorskip("trimesh")
SPHERE = '<sphere radius="0.03"/>'


def with_mesh(folder, name, **parameters):
    path = folder / "arm.urdf"
    path.write_text(CRANE.replace(SPHERE, f'<mesh filename="{name}" scale="0.001 0.001 0.001"/>'))
    return SerialArm.from_urdf(path, tip="eye", acceleration=2.0, **parameters)


def box(size, at=(0.0, 0.0, 0.0)):
    found = trimesh.creation.box(size)
    found.apply_translation(at)
    return found


BOX = box((100, 40, 40))
PIECES = trimesh.util.concatenate([box((100, 40, 40)), box((20, 20, 20), (0, 0, 90))])
# An L, 90 mm long and wide: outlines at both ends, triangles by hand.
RIM = np.array([(0, 0), (90, 0), (90, 20), (20, 20), (20, 90), (0, 90)], float)
LID = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
SIDES = [face for i in range(6) for face in ((i, (i + 1) % 6, i + 6), ((i + 1) % 6, (i + 1) % 6 + 6, i + 6))]
ELL = trimesh.Trimesh(
    np.concatenate([np.c_[RIM, np.full(6, z)] for z in (0.0, 30.0)]),
    [tuple(reversed(face)) for face in LID] + [tuple(c + 6 for c in face) for face in LID] + SIDES,
)


def jibs(arm):
    return [part.solid.shape for part in arm.parts if part.link == "jib"]


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "off"])
def test_a_convex_mesh_is_its_hull_in_metres(tmp_path, kind):
    BOX.export(tmp_path / f"box.{kind}")
    (hull,) = jibs(with_mesh(tmp_path, f"box.{kind}"))
    assert len(hull.points) == 8
    np.testing.assert_allclose(np.abs(hull.points).max(axis=0), [0.05, 0.02, 0.02], atol=1e-9)


def test_pieces_that_are_convex_are_hulls_each(tmp_path):
    PIECES.export(tmp_path / "two.stl")
    assert sorted(len(hull.points) for hull in jibs(with_mesh(tmp_path, "two.stl"))) == [8, 8]


def obj(mesh):
    """Return a mesh as most programs write it: a normal for each face, and a material for every third face."""
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in mesh.vertices] + [
        f"vn {x:g} {y:g} {z:g}" for x, y, z in mesh.face_normals
    ]
    for number, face in enumerate(mesh.faces, 1):
        lines += [f"o part{number}\nusemtl m{number}"] * (number % 3 == 0)
        lines.append("f " + " ".join(f"{corner + 1}//{number}" for corner in face))
    return "\n".join(lines)


def ply(mesh):
    """Return a mesh with three corners of its own for each face, and their normals."""
    rows = [
        (*mesh.vertices[corner], *normal)
        for face, normal in zip(mesh.faces, mesh.face_normals, strict=True)
        for corner in face
    ]
    head = [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *head, f"element face {len(mesh.faces)}"]
    lines += ["property list uchar int vertex_indices", "end_header", *(" ".join(map(str, row)) for row in rows)]
    return "\n".join([*lines, *(f"3 {3 * i} {3 * i + 1} {3 * i + 2}" for i in range(len(mesh.faces)))])


def off(mesh):
    """Return a mesh with corners that no face has, faces without an area, and one twice."""
    faces = [*mesh.faces.tolist(), [0, 0, 1], [3, 3, 3], mesh.faces[0].tolist()]
    rows = [" ".join(map(str, corner)) for corner in [*mesh.vertices, (900, 900, 900)]]
    return "\n".join(["OFF", f"{len(rows)} {len(faces)} 0", *rows, *(f"3 {a} {b} {c}" for a, b, c in faces)])


@pytest.mark.parametrize("write", [obj, ply, off])
@pytest.mark.parametrize(("mesh", "pieces"), [(BOX, 1), (PIECES, 2)], ids=["one", "two"])
def test_corners_are_one_by_their_places_whatever_else_a_file_says(tmp_path, write, mesh, pieces):
    (tmp_path / f"mesh.{write.__name__}").write_text(write(mesh))
    assert [len(hull.points) for hull in jibs(with_mesh(tmp_path, f"mesh.{write.__name__}"))] == [8] * pieces


def test_a_mesh_of_quadrilaterals_is_read_and_its_mirror_image_too(tmp_path):
    corners = [f"v {x} {y} {z}" for x in (0, 100) for y in (0, 40) for z in (0, 40)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    (tmp_path / "quads.obj").write_text("\n".join([*corners, *(f"f {face}" for face in faces)]))
    (hull,) = jibs(with_mesh(tmp_path, "quads.obj"))
    (tmp_path / "arm.urdf").write_text(CRANE.replace(SPHERE, '<mesh filename="quads.obj" scale="-.001 .001 .001"/>'))
    (turned,) = jibs(SerialArm.from_urdf(tmp_path / "arm.urdf", tip="eye", acceleration=2.0))
    np.testing.assert_allclose(sorted((turned.points * (-1, 1, 1)).tolist()), sorted(hull.points.tolist()))


@pytest.mark.parametrize(
    ("name", "said"),
    [("ball.stl", r"expected 1 to 20,000 faces, found 20,480; decimate it \(.*simplify_quadric_decimation"),
     ("ball.glb", r"got '\.glb'; convert it with Blender, or by trimesh.load"),
     ("torn.off", r"cannot be read \(.*\); export it as STL, with triangles only")],
)  # fmt: skip
def test_a_mesh_that_is_not_read_is_refused_with_the_way_out(tmp_path, monkeypatch, name, said):
    monkeypatch.setattr("hpop.models.serial_arm.meshes.MOST_FACES", 20_000)
    if name == "ball.stl":
        trimesh.creation.icosphere(5, 100).export(tmp_path / name)
    else:
        (tmp_path / name).write_text("OFF\n1 1 0\n0 0 0\n3 0 1 2\n")
    with pytest.raises(ModelError, match=said):
        with_mesh(tmp_path, name, meshes="exact")


def test_a_convex_mesh_of_very_many_faces_is_enclosed_by_a_body_of_few_corners(tmp_path):
    ball = trimesh.creation.icosphere(5, 100)
    ball.export(tmp_path / "ball.stl")
    (body,) = jibs(with_mesh(tmp_path, "ball.stl", meshes="exact"))
    assert len(ball.faces) > 20_000
    assert len(body.points) <= MOST_CORNERS
    assert outside(body, ball.vertices / 1000.0) < 1e-6  # the file has single precision


def test_a_mesh_that_is_too_large_is_to_be_decimated(tmp_path):
    with (tmp_path / "big.stl").open("wb") as file:
        file.truncate(MOST_STL_BYTES + 1)
    with pytest.raises(ModelError, match=r"big.stl' cannot be opened: expected at most .*; make it smaller \(decimate"):
        with_mesh(tmp_path, "big.stl")
    os.truncate(tmp_path / "big.stl", MOST_BYTES + 1)
    with pytest.raises(ModelError, match=r"big.stl': a text of at most 100 MB is read; save it as binary STL"):
        with_mesh(tmp_path, "big.stl")


def outside(hull: Any, points: np.ndarray) -> float:
    """Return how far points stick out of the convex hull of others, by trimesh."""
    mesh = trimesh.convex.convex_hull(np.asarray(hull.points))
    return float(max(((part - mesh.triangles_center) * mesh.face_normals).sum(axis=1).max() for part in points))


def bent_tube(count: int) -> trimesh.Trimesh:
    """Return a bent tube with uneven walls, of some 2 * count * count faces."""
    u, v = np.meshgrid(np.linspace(0, 3.8, count), np.linspace(0, 2 * np.pi, count, endpoint=False), indexing="ij")
    thick = 0.05 + 0.005 * np.sin(20 * u)
    across = 0.2 + thick * np.cos(v)
    points = np.stack([across * np.cos(u), across * np.sin(u), thick * np.sin(v)], axis=-1).reshape(-1, 3)
    row, column = np.arange(count - 1)[:, None] * count, np.arange(count)
    a, b = (row + column).ravel(), (row + (column + 1) % count).ravel()
    return trimesh.Trimesh(points, np.concatenate([np.c_[a, a + count, b], np.c_[b, a + count, b + count]]))


def test_a_body_around_very_many_points_contains_them_and_is_close_to_their_hull():
    points = bent_tube(100).vertices
    body = around(points)
    assert len(body.points) < 400
    assert outside(body, points) < 1e-8
    assert 0.0 < body.volume / trimesh.convex.convex_hull(points).volume - 1.0 < 0.02
    assert around(points * (1, 1, 0)) is None


@pytest.mark.proof
@pytest.mark.parametrize("way", ["hull", "decompose"])
def test_a_mesh_of_more_than_a_million_faces_is_within_its_pieces(tmp_path, way):
    tube = bent_tube(750)
    trimesh.Trimesh(1000.0 * tube.vertices, tube.faces, process=False).export(tmp_path / "tube.stl")
    arm = with_mesh(tmp_path, "tube.stl", meshes=way)
    assert len(tube.faces) > LARGE
    (note,) = [note for note in arm.notes if "tube.stl" in note]
    assert "gaps up to 1" in note if way == "hull" else " pieces)" in note
    middles = tube.triangles_center[::499]
    assert max(min(outside(hull, point[None]) for hull in jibs(arm)) for point in middles) < 1e-7


def test_a_concave_mesh_is_refused_with_how_deep_it_is(tmp_path):
    ELL.export(tmp_path / "ell.stl")
    with pytest.raises(
        ModelError, match=r"ell.stl': it must be convex or .* up to 0.0\d+ m inside its convex hull; give meshes: hull"
    ):
        with_mesh(tmp_path, "ell.stl", meshes="exact")


def test_convex_pieces_that_share_corners_are_refused_with_the_way_out(tmp_path):
    """As tools that cut a mesh may write them in one file."""
    shifted = BOX.copy()
    shifted.apply_translation((2 * BOX.bounds[1][0], 0, 0))
    corner = BOX.copy()
    corner.apply_translation((0, 2 * BOX.bounds[1][1], 0))
    trimesh.util.concatenate([BOX, shifted, corner]).export(tmp_path / "touching.obj")
    with pytest.raises(ModelError, match=r"separate convex pieces, .*; give meshes: hull, .* or meshes: decompose"):
        with_mesh(tmp_path, "touching.obj", meshes="exact")


def test_a_package_is_a_folder_that_is_given(tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "meshes").mkdir()
    BOX.export(tmp_path / "meshes/box.stl")
    with pytest.raises(ModelError, match=r"in package 'parts', whose folder is unknown: add packages={parts: FOLDER}"):
        with_mesh(tmp_path / "robot", "package://parts/box.stl")
    arm = with_mesh(tmp_path / "robot", "package://parts/box.stl", packages={"parts": tmp_path / "meshes"})
    assert len(jibs(arm)) == 1
    hashes = arm.describe()["serial_arm"]["urdf"]["sha256"]
    assert len(hashes) == 2  # of the URDF and of the mesh


@pytest.mark.parametrize("name", ["../box.stl", "/etc/passwd", "file:///etc/passwd", "http://example.org/box.stl"])
def test_no_file_is_read_from_outside_the_folder(tmp_path, name):
    BOX.export(tmp_path / "box.stl")
    (tmp_path / "robot").mkdir()
    with pytest.raises(ModelError, match=r"is not in the folder|must be the path of a file, or package"):
        with_mesh(tmp_path / "robot", name)


def test_a_link_to_elsewhere_is_not_followed(tmp_path):
    (tmp_path / "robot").mkdir()
    BOX.export(tmp_path / "box.stl")
    (tmp_path / "robot/box.stl").symlink_to(tmp_path / "box.stl")
    with pytest.raises(ModelError, match="is not in the folder"):
        with_mesh(tmp_path / "robot", "box.stl")
    with pytest.raises(ModelError, match="is not in the folder"):
        with_mesh(tmp_path, "package://robot/../../box.stl", packages={"robot": tmp_path / "robot"})


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("lost.stl", None, "cannot be opened"),
        ("box.dae", b"<COLLADA/>", r"cannot be read .*; export it as STL|needs pycollada"),
        (
            "box.dae",
            b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA>&b;</COLLADA>',
            "must not have a document type or entities",
        ),
        ("box.glb", b"glTF", "a mesh file must be of type stl, obj, ply, off, dae"),
        ("box.stl", b"solid\n\x00\xff" * 9, "box.stl': "),
        ("flat.off", b"OFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n", "flat"),
        ("box.stl", b"", "must not be empty"),
    ],
)
def test_a_mesh_that_is_none_is_refused_by_name(tmp_path, name, data, said):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(ModelError, match=rf"URDF '.*urdf': .* of link 'jib': .*{said}"):
        with_mesh(tmp_path, name)


# Meshes that are not convex


def contains(hulls, points, tolerance=1e-8):
    """Return whether each point is behind all faces of some hull, by trimesh's hulls."""
    inside = np.zeros(len(points), bool)
    for hull in hulls:
        around = trimesh.Trimesh(hull.points).convex_hull
        away = np.einsum("pfi,fi->pf", points[:, None] - around.triangles[None, :, 0], around.face_normals)
        inside |= away.max(axis=1) <= tolerance
    return inside


def test_a_concave_mesh_is_its_hull_and_a_note_says_what_that_adds(tmp_path):
    """The L of 90 mm by 90 mm by 30 mm, 20 mm thick: 3,200 mm² of it; its hull has 5,650 mm²."""
    ELL.export(tmp_path / "ell.stl")
    arm = with_mesh(tmp_path, "ell.stl")
    (hull,) = jibs(arm)
    assert hull.volume == pytest.approx(5650 * 30 * 1e-9)
    assert contains([hull], ELL.vertices / 1000).all()
    (note,) = (note for note in arm.notes if "not convex" in note)
    share = round(100 * (5650 / 3200 - 1))
    assert f"'ell.stl' (+{share} % volume, gaps up to " in note
    gap = float(note.partition("gaps up to ")[2].partition(" mm")[0])
    assert gap == pytest.approx((90 + 20) / 2 - 20, abs=1.0)  # from the middle of the slanting face to a leg
    assert "meshes: decompose fits closer" in note
    assert arm.describe()["serial_arm"].get("meshes") is None
    assert with_mesh(tmp_path, "ell.stl") == arm


def test_a_mesh_that_was_read_is_not_read_again(tmp_path):
    ELL.export(tmp_path / "ell.stl")
    first, second = (jibs(with_mesh(tmp_path, "ell.stl"))[0] for _ in range(2))
    assert first is second
    ELL.copy().apply_scale(2.0).export(tmp_path / "ell.stl")
    (larger,) = jibs(with_mesh(tmp_path, "ell.stl"))
    assert larger.volume == pytest.approx(8 * first.volume)


def test_a_concave_mesh_is_cut_into_pieces_that_hold_its_surface(tmp_path):
    pytest.importorskip("coacd")
    ELL.export(tmp_path / "ell.stl")
    arm = with_mesh(tmp_path, "ell.stl", meshes="decompose")
    pieces = jibs(arm)
    assert 2 <= len(pieces) <= 16
    surface, _ = trimesh.sample.sample_surface(ELL, 2000, seed=1)
    assert contains(pieces, surface / 1000).all()
    assert sum(piece.volume for piece in pieces) < 1.2 * 3200 * 30 * 1e-9
    assert "convex pieces stand for meshes that are not convex: 'ell.stl'" in " ".join(arm.notes)
    assert SerialArm(**arm.describe()["serial_arm"]) == arm != with_mesh(tmp_path, "ell.stl")


def test_a_collada_file_is_read_in_its_unit_with_the_poses_of_its_nodes(tmp_path):
    pytest.importorskip("collada")
    data = trimesh.exchange.dae.export_collada(box((0.1, 0.04, 0.04), (0.0, 0.0, 0.5))).decode()
    assert "<node" in data
    moved = data.replace("<instance_geometry", "<translate>0 0 1</translate><instance_geometry", 1)
    for text, unit, z in ((data, 1.0, 0.5), (moved, 1.0, 1.5), (data, 0.5, 0.25)):
        begin = text.index("<unit") if "<unit" in text else text.index("<up_axis")
        end = text.index("/>", begin) + 2 if "<unit" in text else begin
        (tmp_path / "box.dae").write_text(text[:begin] + f'<unit name="u" meter="{unit}"/>' + text[end:])
        (hull,) = jibs(with_mesh(tmp_path, "box.dae"))
        np.testing.assert_allclose(np.ptp(hull.points, axis=0) * 1000, unit * np.array([0.1, 0.04, 0.04]), rtol=1e-6)
        assert hull.points[:, 2].mean() * 1000 == pytest.approx(z, rel=1e-6)


def test_all_meshes_that_cannot_be_used_are_named_in_one_message(tmp_path):
    ELL.export(tmp_path / "ell.stl")
    (tmp_path / "flat.off").write_text("OFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n")
    more = "".join(
        f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        for name in ("flat.off", "gone.stl", "package://far/a.stl", "package://far/b.stl")
    )
    (tmp_path / "arm.urdf").write_text(
        CRANE.replace(f'<collision><origin xyz="0.1 0 0"/><geometry>{SPHERE}', more + f"<collision><geometry>{SPHERE}")
    )
    with pytest.raises(
        ModelError,
        match=r"4 of its meshes cannot be used\. .*flat.off.*thin box.*gone.stl.* opened.*package 'far', whose folder "
        r"is unknown.*\(1 more for this reason\)",
    ) as error:
        SerialArm.from_urdf(tmp_path / "arm.urdf", tip="eye", acceleration=2.0)
    assert "b.stl" not in str(error.value)  # the folder of the package is missing for both


def test_a_way_that_is_none_is_refused(tmp_path):
    BOX.export(tmp_path / "box.stl")
    with pytest.raises(ModelError, match=r"meshes must be one of .*hull.*decompose.*exact.*, got 'hulls'"):
        with_mesh(tmp_path, "box.stl", meshes="hulls")


def brute_depth(corners, planes):
    sides = 0.5 * (corners + np.roll(corners, 1, axis=1))
    points = np.concatenate([corners.mean(axis=1), sides.reshape(-1, 3), corners.reshape(-1, 3)])
    return float((-(points @ planes[:, :3].T + planes[:, 3]).max(axis=1)).max())


@pytest.mark.seeds(2, of=60)
def test_a_mesh_counts_as_convex_as_all_depths_say(seed):
    """Bodies with dents about as deep as is allowed, of some hundred faces."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(3, rng.uniform(0.05, 0.3))
    corners = ball.vertices * rng.uniform(0.3, 1.0, 3)
    if seed % 2:
        some = rng.integers(len(corners), size=3)
        corners[some] *= 1 - rng.uniform(0.0, 0.02, (3, 1))
    body, faces = convex_body(corners), corners[ball.faces]
    exact = brute_depth(faces, body.planes)
    assert is_convex(faces, body) == (exact <= DEEPEST)
    places = np.concatenate([faces.reshape(-1, 3), faces.mean(axis=1)])
    deepest = float(-(places @ body.planes[:, :3].T + body.planes[:, 3]).max(axis=1).min())
    largest = float((-(places @ body.planes[:, :3].T + body.planes[:, 3]).max(axis=1)).max())
    assert largest - EXACT <= depth(faces, body) <= largest + 1e-12 or deepest > 0


@pytest.mark.seeds(2, of=60)
def test_a_simpler_hull_encloses_all_points_and_is_hardly_larger(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(4000, 3))
    points *= rng.uniform(0.05, 0.2, 3) / np.linalg.norm(points, axis=1)[:, None]
    body = convex_body(points)
    simple = enclosing(body)
    assert len(body.points) > MOST_CORNERS >= len(simple.points)
    around = trimesh.Trimesh(simple.points).convex_hull
    away = np.einsum("pfi,fi->pf", points[:, None] - around.triangles[None, :, 0], around.face_normals)
    assert away.max() <= 1e-9
    assert simple.volume <= 1.05 * body.volume
    assert enclosing(simple) is simple
