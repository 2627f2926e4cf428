"""Panoramas along a trajectory, as arrays and PNG files, and metadata that mark a video as 360 degrees.

Players recognise a panoramic video by the boxes (data blocks) st3d and sv3d of Spherical Video V2 in its MP4 file,
https://github.com/google/spatial-media/blob/master/docs/spherical-video-v2-rfc.md: mono, equirectangular, not rotated.
The boxes belong to the description of the track's samples, inside the box moov. That box is the last one of the file,
so no offset of a sample changes when the box grows.
"""

from __future__ import annotations

import math
import os
import struct
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.files import replacing
from hpop.base.options import real, whole
from hpop.base.text import shown
from hpop.errors import OptionError, OutputError, QueryError
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ride.scene import ViewScene

if TYPE_CHECKING:
    from hpop.view.ride.panorama import Panorama, Picture

WIDTH = 2048
LEAST_WIDTH, MOST_WIDTH = 64, 16384
LEVEL = 1e-9
"""Deviation of the camera's axes from the level above which it counts as tilted."""
XMP = """<?xpacket begin="\N{ZERO WIDTH NO-BREAK SPACE}" id="W5M0MpCehiHzreSzNTczkc9d"?>
<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="" xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"
 GPano:ProjectionType="equirectangular" GPano:UsePanoramaViewer="True"
 GPano:FullPanoWidthPixels="{width}" GPano:FullPanoHeightPixels="{height}"
 GPano:CroppedAreaImageWidthPixels="{width}" GPano:CroppedAreaImageHeightPixels="{height}"
 GPano:CroppedAreaLeftPixels="0" GPano:CroppedAreaTopPixels="0"/>
</rdf:RDF></x:xmpmeta>
<?xpacket end="w"?>"""


class CameraPose(NamedTuple):
    """Position and orientation of a camera.

    position  (3,)    m
    axes      (3, 3)  unit vectors ahead, left and up, in the columns
    """

    position: FloatArray
    axes: FloatArray

    @property
    def is_level(self) -> bool:
        """Return whether the camera is neither tilted nor rolled."""
        return bool(self.axes[2, 2] >= 1.0 - LEVEL and abs(self.axes[2, 0]) <= LEVEL)

    @property
    def yaw(self) -> float:
        """Return the heading, rad."""
        return math.atan2(self.axes[1, 0], self.axes[0, 0])


@checked_arguments
def render_360(problem: Problem, trajectory: Trajectory, t: float, *, width: int = WIDTH) -> Picture:
    """Render the 360 degree view of the camera at a time, as an array (width/2, width, 3) of uint8, sRGB.

    The camera follows the executed trajectory (:meth:`Trajectory.execution`); people are at their predicted positions.

    The projection is equirectangular, in the frame of the camera: the middle of the picture, between columns
    width/2 - 1 and width/2, is where the camera points, its left part is to the left, and its upper edge is overhead.
    If the camera is tilted or rolled, this frame is too: the horizon of the world is then no level line.

    Obstacles are drawn as upright prisms, 3 m high if unlimited; the ``notes`` of
    :class:`hpop.view.ride.scene.ViewScene` list inexact shapes. The same arguments give the same bytes.

    Parameters
    ----------
    t : s, from 0 to the end of the executed trajectory
    width : pixels, a multiple of 4

    Raises OptionError for an invalid time or width.
    """
    run = executed(trajectory)
    _check_time(t, run)
    return draw_at(panorama(problem, checked_width(width)), run, t)


@checked_arguments
def save_360(
    problem: Problem, trajectory: Trajectory, t: float, path: str | os.PathLike[str], *, width: int = WIDTH
) -> Path:
    """Write the panorama of `render_360` as a PNG with metadata for panorama viewers (GPano), and return its path.

    Raises the errors of `render_360`, and OutputError if it cannot be written; no partial file remains.
    """
    picture = render_360(problem, trajectory, t, width=width)
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(png(picture))
    except OSError as error:
        raise OutputError(
            f"the picture cannot be written to {target}: {error.strerror or error}; choose another file"
        ) from None
    return target


def png(picture: Picture) -> bytes:
    """Return a panorama as the bytes of a PNG file, with metadata for panorama viewers."""
    height, width = picture.shape[:2]
    told, buffer = PngInfo(), BytesIO()
    told.add_itxt("XML:com.adobe.xmp", XMP.format(width=width, height=height))
    Image.fromarray(picture).save(buffer, format="png", pnginfo=told, compress_level=4)
    return buffer.getvalue()


def executed(trajectory: Trajectory) -> Trajectory:
    """Return the executed trajectory, with speed ramps, of a planned one; raise QueryError for other values."""
    if not isinstance(trajectory, Trajectory):
        raise QueryError(f"expected a trajectory, such as front.knee().trajectory, got {shown(trajectory)}")
    return trajectory.execution()


def checked_width(width: int) -> int:
    """Return the width of a panorama, pixels; raise OptionError unless it is a multiple of 4 within limits."""
    width = whole("width", width, LEAST_WIDTH, MOST_WIDTH, "pixels of a picture all round,")
    if width % 4:
        raise OptionError(f"width must be a multiple of 4, got {width}; {width - width % 4} is one")
    return int(width)


@lru_cache(maxsize=2)
def panorama(problem: Problem, width: int) -> Panorama:
    """Return the renderer of 360 degree pictures of a problem's world; the last two renderers are cached."""
    from hpop.view.ride.panorama import Panorama  # with kernels: half a second that pictures of the plane do not need

    return Panorama(ViewScene.of(problem), width)


def draw_at(drawn: Panorama, run: Trajectory, t: float) -> Picture:
    """Render the view of the camera at a time t, s, of an executed trajectory."""
    camera = camera_at(run, t)
    if camera.is_level:
        return drawn.draw(camera.position, camera.yaw, t)
    return drawn.draw_turned(camera.position, camera.axes, t)


def camera_at(run: Trajectory, t: float) -> CameraPose:
    """Return the camera's pose at a time of an executed trajectory.

    Each time is evaluated alone, so that the result does not depend on other times.
    """
    pose = run.model.pose("camera", run.at(np.array([t])))

    def column(vector: tuple[FloatArray | float, ...]) -> list[float]:
        return [float(np.broadcast_to(value, 1)[0]) for value in vector]

    axes = np.array([column(pose.ahead), column(pose.left), column(pose.up)]).T
    return CameraPose(np.array(column((pose.x, pose.y, pose.z))), axes)


def _check_time(t: float, run: Trajectory) -> None:
    """Raise OptionError unless t, s, is within the executed trajectory."""
    t = real("t", t, 0.0, run.duration, "a time of the executed trajectory, in s,")


MADE_BY = b"hpop\0"
PATH = (b"trak", b"mdia", b"minf", b"stbl", b"stsd")
DESCRIPTIONS = 16  # bytes of stsd before its entries: size, type, version and flags, number of entries
SAMPLE_ENTRY = b"avc1"


def mark_spherical(file: BinaryIO) -> None:
    """Mark an open MP4 file as a 360 degree video; raise ValueError unless its last box is moov."""
    start, moov = _last_box(file)
    if moov[4:8] != b"moov":
        raise ValueError(f"expected an MP4 file whose last box is moov, got {moov[4:8]!r}")
    grown = _with_added(moov, PATH, _full_box(b"st3d", bytes(1)) + _spherical())  # st3d 0: monoscopic
    file.seek(start)
    file.write(grown)


def _last_box(file: BinaryIO) -> tuple[int, bytes]:
    """Return the last box (data block) of an MP4 file, with its offset."""
    end, start = file.seek(0, 2), 0
    while True:
        file.seek(start)
        size, _ = struct.unpack(">I4s", file.read(8))
        if size == 1:  # a long one: its size follows
            (size,) = struct.unpack(">Q", file.read(8))
        if start + size >= end:
            file.seek(start)
            return start, file.read(size)
        start += size


def _with_added(box: bytes, path: tuple[bytes, ...], added: bytes) -> bytes:
    """Return an MP4 box with ``added`` appended to the sample entry inside it.

    ``path`` holds the names of the nested boxes that lead to that entry.
    """
    head = DESCRIPTIONS if box[4:8] == b"stsd" else 8
    kind = path[0] if path else SAMPLE_ENTRY
    parts = [box[:head]]
    at, is_found = head, False
    while at < len(box):
        size, name = struct.unpack(">I4s", box[at : at + 8])
        child = box[at : at + size]
        if name == kind and not is_found:
            child = _with_added(child, path[1:], added) if path else _box(name, child[8:] + added)
            is_found = True
        parts.append(child)
        at += size
    if not is_found:
        raise ValueError(f"expected a box {kind!r} in {box[4:8]!r}")
    body = b"".join(parts)
    return struct.pack(">I", len(body)) + body[4:]


def _box(name: bytes, content: bytes) -> bytes:
    """Return an MP4 box: size, name and content."""
    return struct.pack(">I4s", 8 + len(content), name) + content


def _full_box(name: bytes, content: bytes) -> bytes:
    """Return an MP4 box whose content begins with version 0 and no flags."""
    return _box(name, bytes(4) + content)


def _spherical() -> bytes:
    """Return the MP4 box that marks a video as equirectangular over the whole sphere, with yaw, pitch and roll 0."""
    projection = _full_box(b"prhd", bytes(12)) + _full_box(b"equi", bytes(16))
    return _box(b"sv3d", _full_box(b"svhd", MADE_BY) + _box(b"proj", projection))
