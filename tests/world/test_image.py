"""Blueprint images: dark is obstacle."""

import tracemalloc

import numpy as np
import pytest
from PIL import Image

from hpop.errors import MapError
from hpop.world import World


def save(folder, pixels):
    path = folder / "plan.png"
    Image.fromarray(np.array(pixels, dtype=np.uint8)).save(path)
    return path


def test_dark_pixels_are_obstacles_and_the_first_row_is_on_top(tmp_path):
    world = World.from_image(save(tmp_path, [[0, 255, 120], [255, 255, 140]]), 0.5, origin=(1, 2, 0))
    assert world.raster.cells.tolist() == [[False, False, False], [True, False, True]]
    assert world.bounds == (1, 2, 2.5, 3)


def test_the_threshold_is_a_brightness(tmp_path):
    path = save(tmp_path, [[0, 100, 200, 255]])
    assert World.from_image(path, 1, threshold=0.0).raster.cells.sum() == 0
    assert World.from_image(path, 1, threshold=0.9).raster.cells.tolist() == [[True, True, True, False]]


def test_colours_are_averaged_and_transparent_ink_is_white_paper(tmp_path):
    world = World.from_image(save(tmp_path, [[[0, 0, 0, 0], [0, 0, 0, 255], [255, 255, 0, 255]]]), 1)
    assert world.raster.cells.tolist() == [[False, True, False]]


def test_heights_and_the_outside_can_be_chosen(tmp_path):
    world = World.from_image(save(tmp_path, [[0, 255]]), 1, height=(0, 2), outside_is_obstacle=False)
    assert world.raster.heights == (0, 2)
    assert not world.outside_is_obstacle


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resolution": 0}, "resolution"),
        ({"resolution": 1e-9}, r"\.png: a resolution of 1e-09 m makes 2 x 1 cells a map 2e-09 m across"),
        ({"resolution": float("nan")}, "resolution"),
        ({"threshold": 1.5}, "threshold"),
        ({"threshold": "dark"}, "threshold"),
        ({"origin": (0, 0)}, "origin"),
        ({"height": (1, 0)}, "z_min"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    with pytest.raises(MapError, match=message):
        World.from_image(save(tmp_path, [[0, 255]]), **{"resolution": 1.0, **options})


def test_a_truncated_png_and_a_huge_one_are_refused(tmp_path):
    path = save(tmp_path, np.random.default_rng(0).integers(0, 255, (60, 60)))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(MapError, match="cut off"):
        World.from_image(path, 1.0)
    Image.new("1", (12_000, 12_000)).save(path)
    with pytest.raises(MapError, match="at most"):
        World.from_image(path, 1.0)


def test_memory_of_reading_is_that_of_a_block_and_the_cells(tmp_path):
    """Beside the decoder's own four bytes a pixel, which are not counted here."""
    pixels = np.full((2000, 2000, 3), 255, np.uint8)
    pixels[::100] = 0
    path = tmp_path / "large.png"
    Image.fromarray(pixels).save(path)
    tracemalloc.start()
    world = World.from_image(path, 0.05)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert world.raster.cells.sum() == 20 * 2000
    assert taken < 3 * pixels[..., 0].size + 60 * 1_000_000  # cells, read and kept, and a block of brightness
