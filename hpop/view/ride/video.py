"""Videos of 360 degrees: the viewer's view along a trajectory, frame by frame, as MP4 or as PNG files."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop import __version__
from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.options import MOST_WORKERS, real, whole
from hpop.errors import OptionError, OutputError
from hpop.problems.front import Front
from hpop.problems.named_rows import named_rows
from hpop.problems.problem import Problem
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import Progress, ProgressCallback, progress_callback
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ride.equirect import WIDTH, camera_at, checked_width, draw_at, executed, mark_spherical, panorama, png
from hpop.view.ride.scene import VERSION

if TYPE_CHECKING:
    from hpop.view.ride.panorama import Picture

FPS = 30
SLOWEST, FASTEST = 1.0, 240.0
"""Smallest and largest frame rate, frames a second."""
AHEAD = 2
"""Number of frames for each worker that are being drawn or wait to be written."""
VIDEO_BYTES, PNG_BYTES = 0.06, 1.2
"""Bytes per pixel, a generous estimate of the free space that a disk must have before a video is begun."""
QUALITY = {"crf": "18", "preset": "veryfast"}
"""Options of the encoder x264, with which no differences to the drawn frames are visible."""
AXES = (
    "equirectangular, sRGB; the middle of the picture is ahead of the camera, its left part to the left, its upper "
    "edge overhead; metres, x right, y up in the plane, z height, angles counter-clockwise (REP-103)"
)


@dataclass(frozen=True, eq=False)
class Clip:
    """Video to be made of one trajectory.

    problem  problem whose world is drawn
    planned  the trajectory
    run      the executed trajectory
    rate     frames a second
    width    pixels
    workers  number of threads that draw
    told     description of the trajectory and its front, for the JSON file beside the video
    """

    problem: Problem
    planned: Trajectory
    run: Trajectory
    rate: Fraction
    width: int
    workers: int
    told: dict[str, Any]

    @classmethod
    def of(
        cls,
        problem: Problem,
        of: Front | Trajectory,
        *,
        row: int | str | None = None,
        fps: float = FPS,
        width: int = WIDTH,
        workers: int | None = None,
    ) -> Clip:
        """Check the arguments of `save_video` and return the video to be made."""
        trajectory, told = _trajectory_and_description(problem, of, row)
        rate = Fraction(real("fps", fps, SLOWEST, FASTEST, "a number of frames a second")).limit_denominator(1001)
        several = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        if workers is not None:
            several = int(whole("workers", workers, 1, MOST_WORKERS, "threads"))
        return cls(problem, trajectory, executed(trajectory), rate, checked_width(width), several, told)

    @property
    def count(self) -> int:
        """Return the number of frames, to the end of the executed trajectory."""
        return int(self.run.duration * self.rate + 1e-9) + 1

    @property
    def times(self) -> list[float]:
        """Return the times of the frames, s: k / fps."""
        return [k * self.rate.denominator / self.rate.numerator for k in range(self.count)]

    def frames(self) -> Iterator[Picture]:
        """Yield the frames in order; several frames are drawn in parallel."""
        drawn = panorama(self.problem, self.width)
        first, *others = self.times
        yield draw_at(drawn, self.run, first)  # compiles kernels, interruptible by Ctrl-C
        waiting: deque[Future[Picture]] = deque()
        with ThreadPoolExecutor(self.workers, "hpop-frame") as pool:
            try:
                for t in others:
                    with interrupts_held():  # an interrupt would leave a lock of futures held
                        waiting.append(pool.submit(draw_at, drawn, self.run, t))
                        done = waiting.popleft().result() if len(waiting) > AHEAD * self.workers else None
                    if done is not None:
                        yield done
                while waiting:
                    with interrupts_held():
                        done = waiting.popleft().result()
                    yield done
            finally:
                for frame in waiting:
                    frame.cancel()

    def described(self, file: str) -> dict[str, Any]:
        """Return the content of the JSON file beside a video, with the trajectory, the axes and the frames' times."""
        heights = [camera_at(self.run, t).position[2] for t in (0.0, 0.5 * self.run.duration, self.run.duration)]
        return {
            "schema": "hpop-360",
            "version": 1,
            "file": file,
            "projection": "equirectangular",
            "axes": AXES,
            "field_of_view": {"horizontal": 360, "vertical": 180, "unit": "deg"},
            "width": self.width,
            "height": self.width // 2,
            "frames_per_second": str(self.rate),
            "frame_times": {"unit": "s", "values": [round(t, 9) for t in self.times]},
            "camera_height": {"unit": "m", "values": sorted({round(float(z), 6) for z in heights})},
            "executed": True,
            "duration": {"unit": "s", "value": self.run.duration},
            **self.told,
            "scene_notes": list(panorama(self.problem, self.width).scene.notes),
            "renderer": f"hpop {__version__}, scene {VERSION}",
        }


@checked_arguments
def save_video(
    problem: Problem,
    of: Front | Trajectory,
    path: str | os.PathLike[str],
    *,
    row: int | str | None = None,
    fps: float = FPS,
    width: int = WIDTH,
    workers: int | None = None,
    progress: ProgressCallback | bool | None = None,
) -> Path:
    """Write a 360 degree video along the executed trajectory, with metadata for players, and return its path.

    Before encoding (H.264, in MP4), frame k equals the picture of `render_360` at the time k / fps. A file
    ``NAME.mp4.json`` beside it has axes, times of frames, row and costs of the trajectory, and a
    description of the front.

    Parameters
    ----------
    of : a front, or a trajectory
    row : row of the front: a number, "knee" or "least NAME"; the knee by default
    fps : frames a second
    width : pixels, a multiple of 4; there are half as many rows
    workers : threads that draw; one for each core by default. The frames are the same with any
    progress : True shows a line on the terminal; a function is called with each frame

    Raises OptionError for a name that does not end in .mp4, OutputError if PyAV, the extra ``hpop[video]``, is missing,
    or the disk has too little room. After an error or interruption no file remains.
    """
    clip = Clip.of(problem, of, row=row, fps=fps, width=width, workers=workers)
    av = _encoder()
    target = Path(path)
    if target.suffix.lower() != ".mp4":
        raise OptionError(f"expected a file name that ends in .mp4, got {target.name!r}; videos are MP4 files")
    with (
        _writing(target),
        _folder(target.parent, clip, VIDEO_BYTES),
        progress_callback(progress) as tell,
        replacing(target) as file,
        replacing(target.with_name(f"{target.name}.json")) as beside,
    ):
        with av.open(file.name, "w", format="mp4") as container:
            _encode(av, container, clip, tell)
        with open(file.name, "r+b") as whole_file:
            mark_spherical(whole_file)
        beside.write(_json(clip.described(target.name)))
    return target


@checked_arguments
def save_frames(
    problem: Problem,
    of: Front | Trajectory,
    folder: str | os.PathLike[str],
    *,
    row: int | str | None = None,
    fps: float = FPS,
    width: int = WIDTH,
    workers: int | None = None,
    progress: ProgressCallback | bool | None = None,
) -> Path:
    """Write the frames of a 360 degree video as ``frame_00000.png``, ..., without the package that videos need.

    The folder must be new or empty, and appears once all frames are written, with ``frames.json``. Returns its path.
    """
    clip = Clip.of(problem, of, row=row, fps=fps, width=width, workers=workers)
    target = Path(folder)
    with _writing(target), _folder(target.parent, clip, PNG_BYTES), progress_callback(progress) as tell:
        if target.exists() and (not target.is_dir() or any(target.iterdir())):
            raise OutputError(f"expected a new or empty folder, but {target} exists; remove it, or choose another")
        partial = Path(mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        try:
            count = clip.count
            for k, picture in enumerate(clip.frames()):
                (partial / f"frame_{k:05}.png").write_bytes(png(picture))
                _tell(tell, k + 1, count)
            (partial / "frames.json").write_bytes(_json(clip.described("frame_00000.png")))
            partial.chmod(0o755)
            partial.replace(target)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
    return target


def _trajectory_and_description(
    problem: Problem, of: Front | Trajectory, row: int | str | None
) -> tuple[Trajectory, dict[str, Any]]:
    """Return the trajectory to film, and its row, costs and front as a dict for JSON."""
    if not isinstance(of, Front):
        executed(of)
        if row is not None:
            raise OptionError("row chooses a trajectory of a front, but a trajectory was given; leave row out")
        return of, {"row": None, "costs": problem.evaluate(of), "units": {c.name: c.unit for c in problem.criteria}}
    (chosen,) = named_rows(of, ["knee" if row is None else row])
    point = chosen.point
    costs = dict(zip(of.names, of.costs.T.tolist(), strict=True))
    digest = hashlib.sha256(json.dumps(costs, separators=(",", ":")).encode())
    return point.item, {
        "row": point.index,
        "costs": point.costs,
        "units": dict(zip(of.names, of.units, strict=True)),
        "front": {
            "trajectories": len(of),
            "certificate": of.certificate,
            "sha256": digest.hexdigest(),
            "sha256_of": "points.costs of the front's file, as JSON without blanks",
        },
    }


def _encoder() -> Any:
    """Return the module PyAV, or raise an OutputError that says how to install it or do without."""
    try:
        import av
    except ImportError as error:
        raise OutputError(
            f"videos need the package PyAV, which is missing ({error}); pip install 'hpop[video]', or write PNG frames "
            "instead: hpop.view.save_frames, hpop ride --frames FOLDER"
        ) from None
    return av


def _encode(av: Any, container: Any, clip: Clip, tell: ProgressCallback | None) -> None:
    """Draw all frames of a video and encode them into an open container."""
    stream = container.add_stream("libx264", rate=clip.rate, options=QUALITY)
    stream.width, stream.height, stream.pix_fmt = clip.width, clip.width // 2, "yuv420p"
    context = stream.codec_context
    context.colorspace = context.color_primaries = context.color_trc = 1  # BT.709
    context.color_range = 1  # 16 to 235
    count = clip.count
    for k, picture in enumerate(clip.frames()):
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        container.mux(stream.encode(frame.reformat(format="yuv420p", dst_colorspace="ITU709")))
        _tell(tell, k + 1, count)
    container.mux(stream.encode(None))


def _tell(tell: ProgressCallback | None, done: int, count: int) -> None:
    if tell is not None:
        tell(Progress("drawing", detail=f"frame {done:,} of {count:,}"))


@contextmanager
def _folder(folder: Path, clip: Clip, per_pixel: float) -> Iterator[None]:
    """Create a folder, after checking that its disk has room for the frames; remove created folders after an error.

    ``per_pixel`` is the largest expected size of a pixel in the file, bytes.
    """
    made = [one for one in (folder, *folder.absolute().parents) if not one.exists()]
    needed = clip.count * clip.width * clip.width // 2 * per_pixel
    free = shutil.disk_usage(next(one for one in (folder, *folder.absolute().parents) if one.exists())).free
    if needed > free:
        raise OutputError(
            f"{clip.count:,} frames of {clip.width} x {clip.width // 2} may take {needed / 1e6:,.0f} MB, but "
            f"{folder} has room for {free / 1e6:,.0f} MB; choose a smaller width, a lower rate, or another disk"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for empty in made:
            with suppress(OSError):
                empty.rmdir()
        raise


def _json(told: dict[str, Any]) -> bytes:
    """Return a dict as JSON with one line for each key, to keep thousands of times on one line."""
    lines = (f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in told.items())
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


@contextmanager
def _writing(target: Path) -> Iterator[None]:
    """Turn OSError into one OutputError message that says that nothing was written."""
    try:
        yield
    except OutputError:  # already complete
        raise
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}; nothing was written") from None
