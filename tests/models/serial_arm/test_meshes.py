"""Meshes of links: convex ones and convex pieces become hulls, others are refused, as is what lies elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.errors import ModelError
from hpop.models import SerialArm
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
     ("ball.dae", r"got '\.dae'; convert it with Blender, or a \.dae with trimesh and pycollada"),
     ("torn.off", r"cannot be read \(.*\); export it as STL, with triangles only")],
)  # fmt: skip
def test_a_mesh_that_is_not_read_is_refused_with_the_way_out(tmp_path, name, said):
    if name == "ball.stl":
        trimesh.creation.icosphere(5, 100).export(tmp_path / name)
    else:
        (tmp_path / name).write_text("OFF\n1 1 0\n0 0 0\n3 0 1 2\n")
    with pytest.raises(ModelError, match=said):
        with_mesh(tmp_path, name)


def test_a_concave_mesh_is_refused_with_how_deep_it_is(tmp_path):
    ELL.export(tmp_path / "ell.stl")
    with pytest.raises(
        ModelError, match=r"ell.stl': it must be convex or .* up to 0.0\d+ m inside its convex hull; cut it"
    ):
        with_mesh(tmp_path, "ell.stl")


def test_convex_pieces_that_share_corners_are_refused_with_the_way_out(tmp_path):
    """As tools that cut a mesh may write them in one file."""
    shifted = BOX.copy()
    shifted.apply_translation((2 * BOX.bounds[1][0], 0, 0))
    corner = BOX.copy()
    corner.apply_translation((0, 2 * BOX.bounds[1][1], 0))
    trimesh.util.concatenate([BOX, shifted, corner]).export(tmp_path / "touching.obj")
    with pytest.raises(
        ModelError, match=r"separate convex pieces, .* give each a <collision> element with its own file"
    ):
        with_mesh(tmp_path, "touching.obj")


def test_a_package_is_a_folder_that_is_given(tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "meshes").mkdir()
    BOX.export(tmp_path / "meshes/box.stl")
    with pytest.raises(
        ModelError, match=r"folder of package 'parts' must be given .* give it in packages, as {parts: FOLDER}"
    ):
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
        ("box.dae", b"<COLLADA/>", "a mesh file must be of type stl, obj, ply, off"),
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
