"""Images as numbers, a block of rows at a time: what takes four bytes a pixel is never there as a whole."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import named
from hpop.world.geometry.shapes import MAX_CELLS, check_size

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

FORMATS = ("PPM", "PNG", "BMP", "GIF", "JPEG")
"""Pillow's names of the formats that are read; PPM includes PGM."""
ORIENTATION = 0x0112
"""Tag of EXIF."""
DEEP = ("I", "I;16", "I;16B", "F")
"""Pillow's names of what has more than 8 bits a pixel."""
BLOCK = 1_000_000
"""Pixels that are looked at together."""
DECODED, SHADES = 8, 80
"""Bytes a pixel while an image is read: of the image with its cells, and of those looked at together."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded image, row 0 at the top.

    height, width  pixels
    is_turned      whether it was turned or mirrored as its EXIF orientation says
    """

    height: int
    width: int
    _image: Any
    _path: str | Path
    is_turned: bool = False

    def blocks(self) -> Iterator[tuple[slice, FloatArray, FloatArray | None]]:
        """Rows, about a million pixels at a time: their brightness (h, W, channels) from 0 to 1, and alpha (h, W).

        Grey images have one channel, coloured ones three; alpha is None for an image without.
        """
        step = max(1, BLOCK // self.width)
        for top in range(0, self.height, step):
            limits.check(READING)
            rows = slice(top, min(top + step, self.height))
            pixels, alpha = self._pixels(rows)
            yield rows, shades(pixels), None if alpha is None else shades(alpha)

    def _pixels(self, rows: slice) -> tuple[Pixels, Pixels | None]:
        image = self._image
        try:
            part = image.crop((0, rows.start, self.width, rows.stop))
            if image.mode in DEEP:
                return np.clip(np.asarray(part), 0, 65535).astype(np.uint16)[..., None], None
            alpha = image.has_transparency_data
            mode = ("L" if image.mode in ("1", "L", "LA") else "RGB") + ("A" if alpha else "")
            pixels = np.asarray(part.convert(mode))
        except Exception as error:  # each decoder fails in its own way
            raise _unreadable(image, self._path, error) from None
        pixels = pixels.reshape(rows.stop - rows.start, self.width, -1)
        return (pixels[..., :-1], pixels[..., -1]) if alpha else (pixels, None)


def read_image(data: bytes, path: str | Path, *, upright: bool = False) -> Picture:
    """Decode an image; white is the largest value of 8 or 16 bits. Its size is checked before pixels are decoded.

    Its cells, a byte each, are charged as what stays of it. ``upright`` turns it as its EXIF orientation says, as what
    shows pictures does, and map_server does not.
    """
    from PIL import Image, ImageOps, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=FORMATS)
    except Image.DecompressionBombError:
        raise MapError(
            f"image {named(path)} is too large: at most {MAX_CELLS:,} cells are read. Crop it or lower its resolution."
        ) from None
    except UnidentifiedImageError:
        raise MapError(
            f"image {named(path)} is no image that can be read; expected PGM (P2, P5), PNG, BMP, GIF or JPEG."
        ) from None
    except Exception as error:  # each decoder fails in its own way
        raise MapError(f"image {named(path)} cannot be read ({error}); is its header broken?") from None
    width, height = image.size
    check_size(height, width, f"image {named(path)}")
    pixels = height * width
    limits.hold(READING, pixels, DECODED * pixels + SHADES * min(pixels, BLOCK))
    if not upright or _orientation(image) == 1:
        return Picture(height, width, image, path)
    try:
        ImageOps.exif_transpose(image, in_place=True)
    except Exception as error:  # each decoder fails in its own way
        raise _unreadable(image, path, error) from None
    width, height = image.size
    return Picture(height, width, image, path, is_turned=True)


def _orientation(image: Any) -> int:
    """The EXIF orientation of an image, from 1 to 8; 1 where it says none that is known."""
    try:
        found = image.getexif().get(ORIENTATION, 1)
    except Exception:  # what it says may be anything
        return 1
    return found if found in range(2, 9) else 1


def _unreadable(image: Any, path: str | Path, error: Exception) -> MapError:
    width, height = image.size
    return MapError(
        f"image {named(path)} is {width} x {height} by its header, but its pixels cannot be read ({error}). Is the "
        "file cut off?"
    )


def shades(pixels: Pixels) -> FloatArray:
    """Pixels as brightness from 0 (black) to 1 (white)."""
    return np.asarray(pixels / float(np.iinfo(pixels.dtype).max))
