"""Point clouds of PLY and PCD files and of arrays: boxes that hold every point, and are no larger than its cell."""

import io
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world import World

POINTS = np.array([(0.012, 0.5, -0.3), (0.26, 0.5, -0.3), (2.0, -1.0, 0.25), (2.01, -1.0, 0.25), (-3.5, 0.125, 0.0)])


def ply(kind, points, more="", rows=()):
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    head = (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {len(points)}\nproperty uchar red\n"
        f"property double x\nproperty float64 y\nproperty double z\n{more}end_header\n"
    ).encode()
    if not order:
        return head + "\n".join([f"7 {x} {y} {z}" for x, y, z in points] + [*rows]).encode()
    return head + b"".join(struct.pack(order + "Bddd", 7, *point) for point in points)


def pcd(kind, points):
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb normal\nSIZE 8 8 8 4 4\nTYPE F F F U F\nCOUNT 1 1 1 1 3\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {kind}\n"
    ).encode()
    if kind == "ascii":
        return head + "\n".join(f"{x} {y} {z} 9 0 0 1" for x, y, z in points).encode()
    return head + b"".join(struct.pack("<dddIfff", *point, 9, 0, 0, 1) for point in points)


FACES = "element face 1\nproperty list uchar int vertex_indices\n"
FILES = {
    "a.ply": ply("ascii", POINTS, FACES, ["3 0 1 2"]),
    "l.ply": ply("binary_little_endian", POINTS),
    "b.ply": ply("binary_big_endian", POINTS),
    "a.pcd": pcd("ascii", POINTS),
    "b.pcd": pcd("binary", POINTS),
}


def covered(world, points):
    """Return whether each point is in a box of the world."""
    low, high = np.array([solid.bounds for solid in world.bodies]).transpose(1, 0, 2)
    inside = (points[:, None] >= low - 1e-9) & (points[:, None] <= high + 1e-9)
    return inside.all(axis=2).any(axis=1)


def test_a_viewpoint_of_a_pcd_file_is_noted_unless_it_is_none(tmp_path):
    """PCL states it in the frame of the points, so that it moves none of them."""
    for pose, said in (("0 0 0 1 0 0 0", 0), ("0.0 -0 0 1 0 0 0", 0), ("0 0 1.2 1 0 0 0", 1), ("0 0 0 0 1 0 0", 1)):
        (tmp_path / "a.pcd").write_bytes(FILES["a.pcd"].replace(b"0 0 0 1 0 0 0", pose.encode()))
        world = World.from_file(tmp_path / "a.pcd", resolution=0.05)
        assert sum(f"its VIEWPOINT, {pose}, is not applied" in note for note in world.notes) == said
        assert covered(world, POINTS).all()


@pytest.mark.parametrize("name", FILES)
def test_every_point_of_a_file_is_in_a_box(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    world = World.from_file(tmp_path / name, resolution=0.05)
    assert covered(world, POINTS).all()
    assert len(world.bodies) == 4  # the third and the fourth point are in one cell
    assert "5 points fill 4 cells of 0.05 m, merged into 4 boxes" in world.notes[0]
    expected = World.from_points(POINTS, 0.05)
    assert [s.describe() for s in world.bodies] == [s.describe() for s in expected.bodies]
    again = World.from_description(world.describe())
    assert [s.describe() for s in again.bodies] == [s.describe() for s in world.bodies]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 300), st.sampled_from([0.05, 0.1, 1 / 3]))
def test_boxes_cover_the_cells_of_the_points_and_nothing_else(seed, count, resolution):
    points = np.random.default_rng(seed).normal(scale=[0.4, 0.2, 0.3], size=(count, 3))
    world = World.from_points(points, resolution)
    assert covered(world, points).all()
    cells = {tuple(cell) for cell in np.floor(points / resolution).astype(int).tolist()}
    filled = [np.rint(solid.bounds / resolution).astype(int) for solid in world.bodies]
    listed = [tuple(low + step) for low, high in filled for step in np.ndindex(*(high - low))]
    assert len(listed) == len(set(listed))  # no cell twice
    assert {tuple(int(i) for i in cell) for cell in listed} == cells


def test_a_table_of_points_becomes_few_boxes():
    x, y = np.meshgrid(np.arange(0.005, 1, 0.01), np.arange(0.005, 2, 0.01))
    world = World.from_points(np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.705)], axis=1), 0.05)
    (box,) = world.bodies
    np.testing.assert_allclose(box.bounds, [(0, 0, 0.7), (1, 2, 0.75)], atol=1e-12)


def test_points_that_are_no_numbers_are_left_out_and_counted(tmp_path):
    (tmp_path / "a.pcd").write_bytes(pcd("ascii", [*POINTS, (np.nan, 0, 0), (0, np.inf, 0)]))
    world = World.from_file(tmp_path / "a.pcd", resolution=0.05)
    assert "5 points fill 4 cells" in world.notes[0]
    assert "2 without finite coordinates are left out" in world.notes[0]


def test_a_scenario_reads_a_cloud(tmp_path):
    (tmp_path / "cloud.ply").write_bytes(FILES["l.ply"])
    (tmp_path / "plan.yaml").write_text(
        "world: {point_cloud: {path: cloud.ply, resolution: 0.1}}\nmodel: {differential_drive: {radius: 0.1}}\n"
        "start: [0.5, 1, 0]\ngoal: [1, -0.5, any]\ncriteria: [length]\n"
    )
    assert len(load_scenario(tmp_path / "plan.yaml").problem.world.bodies) == 4


WIDE = np.random.default_rng(1).uniform(-5, 5, (20_000, 3))


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.ply", ply("binary_little_endian", POINTS)[:-1], "expected 5 points as in its header, got 4; .* incomplete"),
        ("a.pcd", pcd("ascii", POINTS).rpartition(b"\n")[0], "expected 5 points as in its header, got 4"),
        ("a.ply", b"ply\n" + b"comment x\n" * 20_000 + b"end_header\n", "a header that ends with end_header"),
        ("a.ply", ply("ascii", POINTS).replace(b"vertex 5", b"vertex 999999999"), "5,000,000 points, got 999,999,999"),
        ("a.ply", ply("ascii", POINTS).replace(b"double x", b"double u"), "must have columns x, y and z"),
        ("a.ply", ply("ascii", POINTS).replace(b"double x", b"quad x"), "one of char, .*, got 'quad'"),
        ("a.ply", ply("ascii", POINTS).replace(b"double x", b"list uchar int x"), "must have no lists"),
        ("a.pcd", pcd("binary", POINTS).replace(b"DATA binary", b"DATA binary_compressed"),
         "compressed points are not read; write them out, by pcl_convert_pcd_ascii_binary"),
        ("a.pcd", pcd("ascii", POINTS).replace(b"COUNT 1 1 1 1 3", b"COUNT 1 1 1"), "must have as many entries"),
        ("a.pcd", pcd("ascii", POINTS).replace(b"0.012", b"x.012"), "its points cannot be read"),
        ("a.pcd", b"nothing of the kind", "expected a PLY or a PCD file, but its header lacks FIELDS"),
        ("a.pcd", pcd("ascii", [(np.nan, 0, 0)]), "must have finite coordinates, got 1 points and none that has"),
        ("a.pcd", pcd("binary", WIDE), r"make [\d,]+ boxes, expected at most 5,000. Give a resolution of 0.4 m"),
        ("a.pcd", pcd("ascii", [(1e9, 0, 0)]), "within 100,000,000 m of the origin"),
        ("map.bt", b"# Octomap OcTree binary file", "octree2pointcloud map.bt map.pcd"),
        ("a.laz", b"", "save it as PLY or PCD, or give an array to World.from_points"),
    ],
)  # fmt: skip
def test_what_is_no_cloud_is_refused_with_the_way_out(tmp_path, name, data, said):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(MapError, match=said):
        World.from_file(tmp_path / name, **({"resolution": 0.1} if name.startswith("a.p") else {}))
    if "octree" in said:
        with pytest.raises(MapError, match=f"expected a PLY or a PCD file, .*{said}"):
            World.from_file(tmp_path / name, reader="point_cloud", resolution=0.1)


@pytest.mark.parametrize("points", [[], [(1, 2)], "abc", np.zeros(3)])
def test_what_is_no_array_of_points_is_refused(points):
    with pytest.raises(MapError, match=r"must be an array \(N, 3\)|must have finite coordinates"):
        World.from_points(points, 0.1)
    with pytest.raises(MapError, match=r"resolution must be the side of a cell in m from 0\.001"):
        World.from_points(POINTS, 0.0)


def test_a_cloud_is_written_as_numpy_and_pcl_do(tmp_path):
    """A file by NumPy's own writer of text, as a second source of the form."""
    rows = io.StringIO()
    np.savetxt(rows, POINTS)
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 5\nHEIGHT 1\nPOINTS 5\nDATA ascii\n"
    (tmp_path / "a.pcd").write_text(head + rows.getvalue())
    assert covered(World.from_file(tmp_path / "a.pcd", resolution=0.1), POINTS).all()
