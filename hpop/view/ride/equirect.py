"""Pictures all round along a trajectory: what its viewer sees at a time, as an array or a PNG."""

from __future__ import annotations

import math
import os
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

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
from hpop.view.ride.scene import Scene

if TYPE_CHECKING:
    from hpop.view.ride.panorama import Panorama, Picture

WIDTH = 2048
LEAST_WIDTH, MOST_WIDTH = 64, 16384
LEVEL = 1e-9
"""Cosines from the vertical beyond which a camera is tilted."""
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
    """Where a camera is and how it is turned.

    position  (3,)    m
    axes      (3, 3)  ahead, left and up in the columns
    """

    position: FloatArray
    axes: FloatArray

    @property
    def is_level(self) -> bool:
        """Whether it is neither tilted nor rolled."""
        return bool(self.axes[2, 2] >= 1.0 - LEVEL and abs(self.axes[2, 0]) <= LEVEL)

    @property
    def yaw(self) -> float:
        """Heading, rad."""
        return math.atan2(self.axes[1, 0], self.axes[0, 0])


@checked_arguments
def render_360(problem: Problem, trajectory: Trajectory, t: float, *, width: int = WIDTH) -> Picture:
    """What the viewer of a trajectory sees all round at a time, as an array (width/2, width, 3) of uint8, sRGB.

    The camera is where the executed trajectory has it (:meth:`Trajectory.execution`); people are where they are
    predicted to be. Equirectangular: the middle of the picture, between columns width/2 - 1 and width/2, is ahead, its
    left part to the left; the upper edge is overhead. The same arguments give the same bytes.

    Obstacles are drawn as upright prisms, those without an upper end 3 m high; see :class:`hpop.view.ride.scene.Scene`,
    whose ``notes`` say what is drawn otherwise than it is. A camera that is tilted or rolled sees a turned picture.

    Parameters
    ----------
    t : s, from 0 to the end of the executed trajectory
    width : pixels, a multiple of 4

    Raises OptionError for a time or a width that cannot be.
    """
    run = executed(trajectory)
    _check_time(t, run)
    return draw_at(panorama(problem, checked_width(width)), run, t)


@checked_arguments
def save_360(
    problem: Problem, trajectory: Trajectory, t: float, path: str | os.PathLike[str], *, width: int = WIDTH
) -> Path:
    """Write what `render_360` draws as a PNG that viewers know to be all round (GPano); its path.

    Raises OutputError where it cannot be written; nothing is then half-written.
    """
    picture = render_360(problem, trajectory, t, width=width)
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(png(picture))
    except OSError as error:
        raise OutputError(f"the picture cannot be written to {target}: {error.strerror or error}") from None
    return target


def png(picture: Picture) -> bytes:
    """A picture all round as PNG, with the metadata by which viewers know it."""
    height, width = picture.shape[:2]
    told, buffer = PngInfo(), BytesIO()
    told.add_itxt("XML:com.adobe.xmp", XMP.format(width=width, height=height))
    Image.fromarray(picture).save(buffer, format="png", pnginfo=told, compress_level=4)
    return buffer.getvalue()


def executed(trajectory: Trajectory) -> Trajectory:
    """What the robot does of a trajectory; QueryError for what is none."""
    if not isinstance(trajectory, Trajectory):
        raise QueryError(f"expected a trajectory, such as front.knee().trajectory, got {shown(trajectory)}")
    return trajectory.execution()


def checked_width(width: int) -> int:
    """A width, or OptionError."""
    width = whole("width", width, LEAST_WIDTH, MOST_WIDTH, "pixels of a picture all round,")
    if width % 4:
        raise OptionError(f"width must be a multiple of 4, got {width}; {width - width % 4} is one")
    return int(width)


@lru_cache(maxsize=2)
def panorama(problem: Problem, width: int) -> Panorama:
    """What draws a problem's world; that of the last one or two is kept."""
    from hpop.view.ride.panorama import Panorama  # with kernels: half a second that pictures of the plane do not need

    return Panorama(Scene.of(problem), width)


def draw_at(drawn: Panorama, run: Trajectory, t: float) -> Picture:
    """The picture at a time of an executed trajectory."""
    camera = camera_at(run, t)
    if camera.is_level:
        return drawn.draw(camera.position, camera.yaw, t)
    return drawn.draw_turned(camera.position, camera.axes, t)


def camera_at(run: Trajectory, t: float) -> CameraPose:
    """Where the camera is at a time of an executed trajectory: asked alone, so that it is the same whoever asks."""
    pose = run.model.pose("camera", run.at(np.array([t])))

    def column(vector: tuple[FloatArray | float, ...]) -> list[float]:
        return [float(np.broadcast_to(value, 1)[0]) for value in vector]

    axes = np.array([column(pose.ahead), column(pose.left), column(pose.up)]).T
    return CameraPose(np.array(column((pose.x, pose.y, pose.z))), axes)


def _check_time(t: float, run: Trajectory) -> None:
    t = real("t", t, 0.0, run.duration, "a time of the executed trajectory, in s,")
