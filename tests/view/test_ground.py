"""Claims: what is drawn of a raster is what a picture can show, however many cells the map has."""

import numpy as np
import shapely
from matplotlib.figure import Figure

import hpop
from hpop.view.ground import CELLS, View, draw_obstacles
from hpop.view.style import Heights

FINE = 0.002  # m
THIN = 4321  # the one column of a wall


def drawn(view: View):
    """Drawn cells of a hall with a wall one cell thin, and the rectangle (left, right, bottom, top), m, of them."""
    cells = np.zeros((100, 3 * CELLS), dtype=bool)
    cells[:, THIN] = True
    figure = Figure()
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_obstacles(axes, hpop.World.from_cells(cells, FINE), Heights(1.2, 1.2), view)
    (image,) = axes.images
    left, right, bottom, top = image.get_extent()
    return ~np.ma.getmaskarray(image.get_array()), FINE * np.array([left, right, bottom, top])


def test_more_cells_than_pixels_are_drawn_together_and_no_thin_wall_is_lost():
    cells, (left, right, _, _) = drawn(View(-1.0, -1.0, 3 * CELLS * FINE + 1.0, 1.2))
    assert max(cells.shape) <= CELLS
    assert (left, right) == (0.0, 3 * CELLS * FINE)
    width = (right - left) / cells.shape[1]
    assert cells.all(axis=0).nonzero()[0].tolist() == [int(THIN * FINE / width)]


def test_of_a_part_in_view_every_cell_is_drawn():
    wall = shapely.box(THIN * FINE, 0.0, (THIN + 1) * FINE, 0.2)
    near = View(wall.bounds[0] - 0.5, 0.05, wall.bounds[2] + 0.5, 0.15)
    cells, (left, right, bottom, top) = drawn(near)
    assert abs((right - left) / cells.shape[1] - FINE) < 1e-12
    assert left <= near.x_min
    assert right >= near.x_max
    assert bottom <= near.y_min
    assert top >= near.y_max
    (column,) = cells.all(axis=0).nonzero()[0]
    assert abs(left + FINE * column - wall.bounds[0]) < 1e-9
