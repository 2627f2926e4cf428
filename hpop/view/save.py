"""Pictures and pages as files, each written completely or not at all, and pictures and explorer in notebooks."""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from PIL import Image

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.lazy import library
from hpop.base.options import real
from hpop.base.table import PICTURES
from hpop.errors import OutputError
from hpop.frontier.choices import Preferring
from hpop.planners.spending import Spending
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime import limits
from hpop.runtime.limits import Budget
from hpop.view.content import draw_content
from hpop.view.explorer import SCRIPT, payload
from hpop.view.felt import draw_felt
from hpop.view.front_plot import draw_front
from hpop.view.ground import View, draw_scale_bar, outline
from hpop.view.map import draw_map
from hpop.view.marks import draw_ends, end_poses
from hpop.view.moments import draw_encounters
from hpop.view.page import new_figure, png_of
from hpop.view.side import draw_side
from hpop.view.single_page import bundle, page_file, single_page
from hpop.view.style import SMALL, camera_heights, drawn_rows, marks, plain, whole_ticks
from hpop.view.trace import changing, draw_states, draw_trace
from hpop.view.where import draw_where
from hpop.world import World
from hpop.world.files import place_seen_from

DPI = 200
LEAST_DPI, MOST_DPI = 10, 1200  # a map is up to some 13 inches wide: of more pixels it takes gigabytes
MOST_FIELD = 500_000_000  # default memory limit of the map's shading, bytes; a fine raster takes 1 GB, and 20 s
OTHERS = {
    "front.png",
    "trace.png",
    "where.png",
    "felt.png",
    "side.png",
    "states.png",
    "encounters.png",
}  # beside the map, which there always is
COMPRESSION = 4  # of 9: a third of the time of zlib's usual 6, for a tenth of the bytes


@checked_arguments
def save_pictures(
    problem: Problem,
    front: Front,
    folder: str | os.PathLike[str],
    *,
    dpi: float = DPI,
    map_alone: bool = False,
    max_memory: int | None = None,
    preference: Preferring | None = None,
) -> list[Path]:
    """Write pictures of a problem and its front to a folder, and return the paths of the files.

    For an empty front, or with ``map_alone``, this is only ``map.png``. Otherwise also ``front.png``, and for the knee
    ``trace.png`` and ``where.png``, unless it has no motion. If people move, ``encounters.png`` shows the knee over
    time among them. If the camera rises or sinks, ``side.png`` is a view from the side. If states change that maps do
    not show, such as joints, ``states.png`` shows them. If the robot has a seat, ``felt.png`` shows what a passenger
    feels along the way.

    With a person's ``preference`` the best trajectory for that person is marked too. If the shading of the map by
    obstruction takes more than ``max_memory`` bytes (by default 500 MB), it is left out, and the map says so. The
    folder is created if missing. Existing pictures are replaced, or removed if this front has none of that name. All
    are drawn before the first is written.

    Raises
    ------
    OptionError
        If ``dpi`` is not from 10 to 1,200.
    OutputError
        If the folder cannot be created or written to; no partial picture remains.
    """
    dpi = real("dpi", dpi, LEAST_DPI, MOST_DPI, "a number of pixels per inch")
    target = Path(folder)
    chosen = None if preference is None else {name: p.index for name, p in front.named(preference).items()}
    with ThreadPoolExecutor(1) as beside:  # one picture is compressed while the next is drawn
        pictures = {}

        def add(name: str, figure: Figure) -> None:
            pictures[name] = beside.submit(_png(figure, dpi))

        with limits.within(Spending(Budget(max_memory=max_memory or MOST_FIELD))):
            add("map.png", draw_map(problem, front, chosen=chosen))
        if len(front) and not map_alone:
            add("front.png", draw_front(front, chosen=chosen))
            knee = front.knee().item
            if len(knee):
                add("trace.png", draw_trace(problem, knee, name="the knee"))
                add("where.png", draw_where(problem, knee, name="the knee"))
                if any(person.moves for person in problem.world.content.people):
                    add("encounters.png", draw_encounters(problem, knee, name="the knee"))
            if camera_heights(problem, [front.trajectories[row] for row in drawn_rows(front)]).vary:
                add("side.png", draw_side(problem, front, chosen=chosen))
            if changing(problem.model, [front.trajectories[mark.row] for mark in marks(front, chosen)]):
                add("states.png", draw_states(front, chosen=chosen))
            if "seat" in problem.model.provides:
                add("felt.png", draw_felt(front, chosen=chosen))
    try:
        target.mkdir(parents=True, exist_ok=True)
        for name in OTHERS - pictures.keys():
            (target / name).unlink(missing_ok=True)
        return [_write(target / name, data.result()) for name, data in pictures.items()]
    except OSError as error:
        raise OutputError(f"the pictures cannot be written to {target}: {error}; choose another folder") from error


def save_figure(figure: Figure, path: Path, dpi: float = DPI) -> None:
    """Write a figure to a PNG file, creating its folder if missing; raises OSError if this fails."""
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path, _png(figure, dpi)())


def _png(figure: Figure, dpi: float) -> Callable[[], bytes]:
    """Draw a figure once (`savefig` would draw it twice), and return a function that compresses it to PNG bytes."""
    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    with warnings.catch_warnings():  # about letters missing in the font, which become boxes
        warnings.filterwarnings("ignore", r"Glyph .* missing from", UserWarning)
        canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")

    def compressed() -> bytes:
        buffer = io.BytesIO()
        picture.save(buffer, format="png", dpi=(dpi, dpi), compress_level=COMPRESSION)
        return buffer.getvalue()

    return compressed


def _write(path: Path, data: bytes) -> Path:
    """Write data to a file, completely or not at all, and return its path; an existing file is replaced."""
    with replacing(path) as file:
        file.write(data)
    return path


SIDE = 4.5  # inches, of the longer side of a map
WORDS = 0.8  # inches round it
NOTEBOOK_DPI = 72
ROOM = 0.02  # round a world, as a share of its longer side
SOLID: dict[str, Any] = {"facecolor": "#b3aa9a", "edgecolor": "#6f675a", "linewidth": 0.6}


@plain
def small_map(world: World, problem: Problem | None = None) -> Figure:
    """Draw a small map for notebooks: obstacles, people, landmarks and zones; start and goal if a problem is given."""
    x0, y0, x1, y1 = shapely.total_bounds([world.extent, *(obstacle.polygon for obstacle in world.obstacles)]).tolist()
    room = ROOM * max(x1 - x0, y1 - y0)
    view = View(x0 - room, y0 - room, x1 + room, y1 + room)
    scale = SIDE / max(view.width, view.height)
    axes = new_figure(scale * view.width + WORDS, scale * view.height + WORDS).add_subplot(label="small map")
    _draw_ground(axes, world)
    draw_content(axes, world, view, small=True)
    if problem is not None:
        start, goals = end_poses(problem)
        draw_ends(axes, start[:2], [goal[:2] for goal in goals] if problem.target.listed else [])
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_xlabel("x (m)", fontsize=SMALL)
    axes.set_ylabel("y (m)", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    for axis in (axes.xaxis, axes.yaxis):
        whole_ticks(axis, False)
    draw_scale_bar(axes, view)
    axes.set_title(" ", fontsize=SMALL)  # room for it
    return axes.figure  # type: ignore[return-value]  # of a figure, not of a part of one


def _draw_ground(axes: Axes, world: World) -> None:
    """Draw obstacles, keep-out areas and the outline of a world."""
    solid = [*(obstacle.polygon for obstacle in world.obstacles), world.ground.raster_solid(), world.keep_out]
    outlines = [outline(geometry) for geometry in solid if not geometry.is_empty]
    axes.add_collection(PathCollection(outlines, zorder=1.0, gid="obstacles", **SOLID), autolim=False)
    axes.add_collection(PathCollection([outline(world.extent)], facecolor="none", edgecolor="#555555"), autolim=False)


def provide() -> None:
    """Register the small pictures of worlds, problems and fronts, so that notebooks show them."""
    PICTURES[World] = lambda world: png_of(small_map(world), NOTEBOOK_DPI)
    PICTURES[Problem] = lambda problem: png_of(small_map(problem.world, problem), NOTEBOOK_DPI)
    PICTURES[Front] = lambda front: png_of(draw_front(front), NOTEBOOK_DPI) if len(front) else None


@checked_arguments
def save_explorer(
    problem: Problem,
    front: Front,
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    saved: str | os.PathLike[str] | None = None,
    preference: Preferring | None = None,
) -> Path:
    """Write a web page to choose a trajectory from a front, and return its path.

    The page has linked axes of costs, a map, a table, and charts along trajectories. It is one file, which any current
    browser opens from the disk without a network. The folder is created if missing; an existing page is replaced.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories; none, one or thousands: 8,000 are a page of 2 MB at most.
    path : path
        The file, such as "front.html".
    title : str, optional
        Title of the page; by default the traded costs.
    saved : path, optional
        The file that holds the front, for the Python code that the page offers. It is shown as given, but an absolute
        path, which may contain a user's name, becomes relative to the page's folder.
    preference : Preference, optional
        Preference of a person: the best trajectory for this person is marked "for you".

    Raises
    ------
    OptionError
        If the file's name does not end in .html.
    OutputError
        If the file cannot be written, or its folder cannot be created. No partial file remains.
    """
    target = page_file(path)
    place = None if saved is None else os.fspath(saved)
    if place is not None and os.path.isabs(place):
        place = place_seen_from(str(target.parent.absolute()), place)
    given = payload(problem, front, title=title, saved=place, preference=preference)
    page = single_page(SCRIPT, given["title"], given).encode(errors="backslashreplace")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(page)
    except OSError as error:
        raise OutputError(
            f"the explorer cannot be written to {target}: {error.strerror or error}; choose another file"
        ) from error
    return target


MODULE = "widget.js"
HEIGHT = 900  # pixels


@checked_arguments
def widget(problem: Problem, front: Front, *, title: str | None = None, height: int = HEIGHT) -> Any:
    """Return the explorer as a notebook widget, which a cell shows as its last value; needs ``hpop[notebook]``.

    While the widget is shown, its attributes follow the page: ``selected`` (rows), ``hovered`` (a row or None) and
    ``pinned`` (rows, A first). ``chosen`` is the front of the selected rows. ``observe`` registers a function that is
    called at changes.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories.
    title : str, optional
        Title of the page; by default the traded costs.
    height : int
        Height of the page, pixels.

    Raises
    ------
    ImportError
        If anywidget is not installed; the message says how to install it.
    """
    given = payload(problem, front, title=title)
    page = single_page(SCRIPT, given["title"], {**given, "embedded": True})
    return _explorer()(front, page=page, height=height, selected=list(range(len(front))))


@cache
def _explorer() -> type[Any]:
    """Return the widget's class, defined at first use because its base class is in an optional package."""
    base: Any = library("anywidget", "hpop.view.widget", "notebook").AnyWidget
    traitlets = library("traitlets", "hpop.view.widget", "notebook")

    class Explorer(base):  # type: ignore[misc]  # of a package that may not be there
        """Explorer of a front as a notebook widget."""

        _esm = bundle(MODULE)
        page = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int().tag(sync=True)
        selected = traitlets.List(traitlets.Int()).tag(sync=True)
        hovered = traitlets.Int(None, allow_none=True).tag(sync=True)
        pinned = traitlets.List(traitlets.Int()).tag(sync=True)

        def __init__(self, front: Front, **shown: Any) -> None:
            super().__init__(**shown)
            self.front = front

        @property
        def chosen(self) -> Front:
            """The front that consists of the selected rows."""
            return self.front[np.isin(np.arange(len(self.front)), self.selected)]

    return Explorer
