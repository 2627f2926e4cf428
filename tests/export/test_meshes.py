"""Meshes are closed and as large as what they show: volumes by the divergence theorem, areas by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import hpop
from hpop.export.glb import extruded, meshes_of
from hpop.view.ride.scene import ViewScene
from tests.export.given import FRAME, TABLE, problem


def volume(corners):
    """Return the volume enclosed by triangles (T, 3, 3), counter-clockwise seen from outside."""
    return np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0


def closed(corners):
    """Check that each edge occurs as often in one direction as in the other."""
    edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)]).reshape(-1, 6).round(9) + 0.0
    back = edges[:, [3, 4, 5, 0, 1, 2]]
    order = [each[np.lexsort(each.T)] for each in (edges, back)]
    return np.array_equal(*order)


def rings(polygon):
    turned = shapely.orient_polygons(polygon)
    return [shapely.get_coordinates(ring)[:-1] for ring in (turned.exterior, *turned.interiors)]


@given(st.integers(3, 12), st.floats(0.1, 0.9), st.integers(0, 10**6))
@settings(max_examples=settings.default.max_examples // 2)
def test_a_prism_with_a_hole_is_closed_and_has_its_volume(sides, hole, seed):
    angles = np.sort(np.random.default_rng(seed).uniform(0, 2 * np.pi, sides))
    outline = shapely.Polygon(np.column_stack([np.cos(angles), np.sin(angles)]) * 5 + 20)
    inner = shapely.affinity.scale(outline, hole, hole)
    polygon = outline.difference(inner)
    if not outline.is_valid or outline.area < 1e-3 or polygon.geom_type != "Polygon":
        return
    corners = extruded(rings(polygon), -1.0, 2.5)
    assert volume(corners) == pytest.approx(3.5 * polygon.area, rel=1e-6)
    assert closed(corners)


def test_a_world_is_as_large_as_its_meshes():
    found = {}
    for mesh in meshes_of(ViewScene.of(problem())):
        found.setdefault(mesh.name.split(" ")[0], []).append(mesh)
    (wall,) = found["wall"]
    assert volume(wall.corners) == pytest.approx(3.0 * FRAME.area)
    (table,) = [mesh for name, several in found.items() for mesh in several if name.startswith("</script>")]
    assert volume(table.corners) == pytest.approx(0.05 * TABLE.area)
    (floor,) = found["floor"]
    assert set(floor.corners[..., 2].ravel()) == {0.0}
    assert (floor.normals[:, 2] == 1.0).all()
    assert len(found["person"]) == 6
    assert all(volume(mesh.corners) > 0 and closed(mesh.corners) for mesh in found["person"])
    assert {mesh.person.velocity for mesh in found["person"]} == {(-0.5, 0.25), (0.0, 0.0)}
    facing, all_round = found["landmark"]
    assert (len(facing.corners), len(all_round.corners)) == (4, 8)
    assert len(found["zone"]) == 1


def test_cells_are_boxes_of_their_volume():
    cells = np.random.default_rng(2).random((12, 17)) < 0.4
    world = hpop.World.from_cells(cells, 0.25, origin=(1.0, 2.0, 0.3), height=(0.0, 1.5))
    stays = (*_middle(np.argwhere(~cells)[0]), 0.3)
    asked = hpop.Problem(world, hpop.DifferentialDrive(radius=0.01), stays, stays, ["length"])
    (mesh,) = [mesh for mesh in meshes_of(ViewScene.of(asked)) if mesh.name == "cells"]
    assert volume(mesh.corners) == pytest.approx(1.5 * 0.25**2 * cells.sum())


def _middle(cell):
    """Return the middle of a cell: row and column, turned by 0.3 rad about the origin."""
    y, x = (cell + 0.5) * 0.25
    return 1.0 + x * np.cos(0.3) - y * np.sin(0.3), 2.0 + x * np.sin(0.3) + y * np.cos(0.3)
