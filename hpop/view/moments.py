"""Maps at several times: one for each event of a drive, or along a trajectory among moving people.

The lower panel of :func:`draw_encounters` shows the distance driven, m, over time. Its line rises while the robot
drives, and is level while the robot turns or waits. The background shows, for each position on the path and each time,
how near the nearest person is. A person who crosses the path appears as a coloured band; where the line passes beside a
band, the robot has let that person pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.criteria.others import reach
from hpop.drive.closings import Closing
from hpop.drive.execution import Execution
from hpop.drive.script import Happening
from hpop.errors import OptionError, QueryError
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.content import INK, SKIN
from hpop.view.ground import KEEP_OUT, View, draw_bare_floor, outline, view_of
from hpop.view.marks import draw_stops
from hpop.view.outlines import draw_map_obstacles
from hpop.view.page import figure_for, new_figure, whole
from hpop.view.style import (
    COLOURS,
    HALO,
    LARGE,
    NORMAL,
    POINT,
    QUIET,
    SMALL,
    camera_heights,
    mapped_points,
    path_points,
    plain,
)
from hpop.world import Person
from hpop.world.content.proxemics import HALL

COLUMNS = 3
MOST = 12  # maps
WIDE = 3.4  # inches, a map
DRIVEN, PLANNED, TAKEN = COLOURS[0], COLOURS[1], COLOURS[2]


@checked_arguments
@plain
def draw_drive(drive: Execution, happenings: Sequence[Happening]) -> Figure:
    """Draw a drive: a map for each of the first twelve events, and one of the whole drive.

    Each map shows the path driven until then, the plan before the event, all options, and the option taken.

    Raises OptionError if there are no events.
    """
    if not happenings:
        raise OptionError("expected a drive with at least one event, got none; hpop.view.draw_map draws its plan")
    shown = happenings[:MOST]
    problem = drive.problem
    ways = [path_points(option.item) for happening in shown for option in happening.options]
    view = view_of(problem, [path_points(drive.plan), *ways])
    rows = -(-(len(shown) + 1) // COLUMNS)
    figure = new_figure(COLUMNS * WIDE, rows * (WIDE * view.height / view.width + 0.55) + 0.9)
    panels = np.ravel(figure.subplots(rows, COLUMNS, sharey=True, squeeze=False))
    for number, (axes, happening) in enumerate(zip(panels, shown, strict=False), start=1):
        _draw_map(axes, problem, view, drive.plan, happening.closed, happening.people)
        _draw_options(axes, happening)
        _draw_robot(axes, problem, happening)
        axes.set_title(f"{number}  {happening.event.at:.1f} s: {printable(str(happening.event))}", fontsize=NORMAL)
    last = panels[len(shown)]
    there = drive.surroundings
    ended = max(0.0, drive.begin + drive.plan.duration - there.since)
    people = [person.later(ended) for person in there.people]
    stops = _draw_map(last, problem, view, drive.plan, there.closings, people)
    last.plot(*path_points(drive.plan).T, color=DRIVEN, linewidth=2.4, zorder=4, gid="driven")
    arrives = drive.plan.duration >= drive.announced.duration
    end = f"driven in {drive.plan.duration:.1f} s" if arrives else "it stops before a closed area"
    last.set_title(f"in the end: {end}", fontsize=NORMAL)
    for axes in panels[len(shown) + 1 :]:
        axes.remove()
    more = f", the first {MOST} of {len(happenings)} events" if len(happenings) > MOST else ""
    figure.suptitle(f"A drive, and the options at its events{more}", fontsize=LARGE)
    disc = {"linestyle": "none", "marker": "o", "markersize": 8}
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=DRIVEN, label="robot", **disc),  # type: ignore[arg-type]
        Line2D([], [], color=DRIVEN, linewidth=2.4, label="driven"),
        Line2D([], [], color=PLANNED, linewidth=1.6, linestyle=(0, (4, 2)), label="plan until then"),
    ]
    if any(len(happening.options) for happening in shown):
        handles.append(Line2D([], [], color=POINT, linewidth=0.8, label="option"))
    if any(happening.taken is not None for happening in shown):
        handles.append(Line2D([], [], color=TAKEN, linewidth=2.4, label="option taken"))
    if any(happening.closed for happening in shown):
        handles.append(Patch(facecolor="none", edgecolor=KEEP_OUT, hatch=r"\\\\", label="closed"))
    if any(happening.people for happening in shown):
        look = {"markerfacecolor": SKIN, "markeredgecolor": INK, **disc}
        handles.append(Line2D([], [], label="person", **look))  # type: ignore[arg-type]
    handles += stops
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=SMALL, frameon=False)
    return figure


def _draw_map(
    axes: Axes, problem: Problem, view: View, plan: Trajectory, closed: Sequence[Closing], people: Sequence[Person]
) -> list[Line2D]:
    """Draw the map with obstacles, closed areas, people and stops at one moment; return the legend entry of stops."""
    draw_bare_floor(axes, problem.world)
    draw_map_obstacles(axes, problem, camera_heights(problem, [plan]), view)
    for closing in closed:
        patch = PathPatch(outline(closing.area), facecolor="none", edgecolor=KEEP_OUT, hatch=r"\\\\", zorder=2.5)
        patch.set_gid("closed")
        axes.add_patch(patch)
    stops = draw_stops(axes, problem)
    for person in people:
        if any(float(one.there(np.float64(0.0))) > 0 for _, one in person.hypotheses):
            body = Circle((person.x, person.y), person.radius, facecolor=SKIN, edgecolor=INK, zorder=6)
            body.set_gid("person")
            axes.add_patch(body)
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_xlabel("x (m)", fontsize=SMALL)
    if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
        axes.set_ylabel("y (m)", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    return stops


def _draw_options(axes: Axes, happening: Happening) -> None:
    """Draw the options at an event as thin lines, the plan before it dashed, and the option taken thick."""
    options = happening.options
    for option in options:
        axes.plot(*path_points(option.item).T, color=POINT, linewidth=0.8, zorder=3, gid="option")
    axes.plot(*path_points(happening.before).T, color=PLANNED, linewidth=1.6, linestyle=(0, (4, 2)), zorder=3.5)
    if happening.taken is not None:
        axes.plot(*path_points(happening.taken.item).T, color=TAKEN, linewidth=2.4, zorder=4, gid="taken")


def _draw_robot(axes: Axes, problem: Problem, happening: Happening) -> None:
    """Draw the path driven until an event, and the robot at its end."""
    driven = mapped_points(problem.model, happening.driven.states)
    axes.plot(*driven.T, color=DRIVEN, linewidth=2.4, zorder=4.1)
    x, y = driven[-1]
    axes.add_patch(Circle((x, y), max(reach(problem.model, None), 0.05), facecolor=DRIVEN, edgecolor=QUIET, zorder=5))


TIMES, PLACES = 400, 300  # samples of the lower panel: times, and positions along the path
MOMENTS = 4  # maps above the lower panel
TRAIL = 2.0  # s of path shown behind each person
NEARNESS = ("#7f1d1d", "#e8956d", "#f6cf9f", "#fbf0dc", "#ffffff")  # touching, then Hall's zones from near to far
WORDS = ("robot and person would touch", *(f"{zone} zone, to {limit:g} m" for zone, limit in HALL.items()))
ROBOT = COLOURS[2]


@checked_arguments
@plain
def draw_encounters(
    problem: Problem, trajectory: Trajectory, *, name: str = "the trajectory", ax: Axes | None = None
) -> Figure:
    """Draw a trajectory over time among moving people, with maps at the start and when people are nearest.

    The chart below the maps has time, s, across, and the position on the robot's path, m from its start, upwards. Its
    line is the robot. Its background colour shows how near the nearest person is to that position at that time.
    Distances are between surfaces, with a round robot. Each hypothesis of a person is drawn; people of uncertain
    position are drawn at the predicted position.

    Parameters
    ----------
    problem : Problem
        Its world has the people.
    trajectory : Trajectory
        A planned trajectory of the problem's model.
    name : str
        Name in the title.
    ax : Axes, optional
        Axes of a grid, such as those of `plt.subplots`; by default a new figure.

    Raises QueryError without moving people.
    """
    walkers = _walkers(problem)
    if not walkers:
        raise QueryError("expected a world with moving people, got none; hpop.view.draw_map draws the map")
    driven = _Driven.of(trajectory)
    view = view_of(problem, [path_points(trajectory)])
    wide = view.width >= view.height
    figure = figure_for(ax, 9.0, (2.2 + 7.6 / MOMENTS * view.height / view.width if wide else 4.6) + 3.4)
    above, below = figure.subfigures(2, 1, height_ratios=(1, 1.25))  # type: ignore[misc]  # two of them
    nearness = [_gap(problem, person, driven) for person in walkers]
    moments = _moments(walkers, driven, np.min(nearness, axis=0))
    maps = np.atleast_1d(above.subplots(1, moments.size, sharey=True))
    for axes, moment in zip(maps, moments, strict=True):
        _draw_moment(axes, problem, trajectory, walkers, view, float(moment))
    way = below.subplots()
    _draw_progress(way, driven, np.min(nearness, axis=0), moments)
    for person, gaps in zip(walkers, nearness, strict=True):
        _write_person_name(way, person, driven, gaps)
    figure.suptitle(f"Among people who move, {name}: {trajectory.duration:.1f} s", fontsize=LARGE)
    handles = [
        Line2D([], [], color=ROBOT, linewidth=2.2, label="robot, level where it turns or stands"),
        Line2D([], [], color=INK, linewidth=1.1, linestyle=":", label="person, path of the last 2 s"),
        *(Patch(facecolor=c, edgecolor=QUIET, linewidth=0.4, label=w) for c, w in zip(NEARNESS, WORDS, strict=False)),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=SMALL, frameon=False)
    return whole(figure)


class _Driven(NamedTuple):
    """Trajectory sampled over time, for the lower panel.

    times   (T,)    s
    points  (T, 2)  m, of the body that maps show
    along   (T,)    m, distance driven until then
    """

    times: FloatArray
    points: FloatArray
    along: FloatArray

    @classmethod
    def of(cls, trajectory: Trajectory) -> _Driven:
        times = np.union1d(np.linspace(0.0, trajectory.duration, TIMES), trajectory.times)
        points = mapped_points(trajectory.model, trajectory.at(times))
        steps = np.hypot(*np.diff(points, axis=0).T)
        return cls(times, points, np.append(0.0, np.cumsum(steps)))


def _walkers(problem: Problem) -> list[Person]:
    """Return the moving people; a person with several hypotheses appears once for each hypothesis."""
    people = problem.world.content.people
    return [one for person in people if person.moves for _, one in person.hypotheses]


def _gap(problem: Problem, person: Person, driven: _Driven) -> FloatArray:
    """Return the gap (PLACES, TIMES), m, between a person and the robot, for each position on its path and each time.

    It is inf while the person is absent.
    """
    along = np.linspace(0.0, driven.along[-1], PLACES)
    rising = np.append(True, np.diff(driven.along) > 0)
    x, y = (np.interp(along, driven.along[rising], column[rising]) for column in driven.points.T)
    t = np.linspace(0.0, driven.times[-1], TIMES)
    at_x, at_y = person.at(t)
    apart: FloatArray = np.hypot(x[:, None] - at_x, y[:, None] - at_y) - person.radius - reach(problem.model, None)
    return np.where(person.there(t) > 0, apart, np.inf)


def _moments(walkers: Sequence[Person], driven: _Driven, gaps: FloatArray) -> FloatArray:
    """Return the times, s, of the maps, at most ``MOMENTS``: the start, and times when a person is near.

    The time in which people move is divided into equal parts; each part contributes the time when a person is nearest
    to the robot.

    gaps  (PLACES, TIMES)  m  gap between robot and nearest person, for each position on the path and each time
    """
    t = np.linspace(0.0, driven.times[-1], TIMES)
    changing = np.flatnonzero(t <= max(person.settled for person in walkers))
    places = np.interp(t, driven.times, driven.along) / max(driven.along[-1], 1e-9) * (PLACES - 1)
    met = gaps[np.round(places).astype(np.int64), np.arange(TIMES)]
    apart = changing.size // (3 * MOMENTS)  # maps of almost equal moments add nothing
    parts = [part[apart:] for part in np.array_split(changing, MOMENTS - 1)]
    return np.array([0.0, *(t[part[np.argmin(met[part])]] for part in parts if part.size)])


def _draw_moment(
    axes: Axes, problem: Problem, trajectory: Trajectory, walkers: Sequence[Person], view: View, moment: float
) -> None:
    """Draw a map at a time: the path driven until then, the robot, and the people."""
    draw_bare_floor(axes, problem.world)
    draw_map_obstacles(axes, problem, camera_heights(problem, [trajectory]), view)
    axes.plot(*path_points(trajectory).T, color=ROBOT, linewidth=0.8, alpha=0.5, zorder=3)
    until = mapped_points(trajectory.model, trajectory.at(np.linspace(0.0, moment, TIMES)))
    axes.plot(*until.T, color=ROBOT, linewidth=2.2, zorder=3.1)
    axes.add_patch(Circle(tuple(until[-1]), reach(problem.model, None), facecolor=ROBOT, edgecolor="white", zorder=5))
    for person in problem.world.content.people:
        for weight, one in person.hypotheses:
            _draw_person(axes, one, moment, weight)
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_title(f"{moment:.1f} s", fontsize=NORMAL)
    axes.tick_params(labelsize=SMALL)
    axes.set_xlabel("x (m)", fontsize=SMALL)
    if axes.get_subplotspec() is not None and axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
        axes.set_ylabel("y (m)", fontsize=SMALL)


def _draw_person(axes: Axes, person: Person, moment: float, weight: float) -> None:
    """Draw a person at a time as a disc, with a dotted line along the last two seconds of the walk.

    Less likely hypotheses are fainter; people who are absent are omitted.
    """
    t = np.linspace(max(0.0, moment - TRAIL), moment, 40)
    x, y = (np.broadcast_to(column, t.shape) for column in person.at(t))
    there = np.broadcast_to(person.there(t), t.shape) > 0
    if person.moves:
        axes.plot(x[there], y[there], color=INK, linewidth=1.1, linestyle=":", alpha=weight, zorder=5.5)
    if there[-1]:
        disc = {"facecolor": SKIN, "edgecolor": INK, "alpha": max(weight, 0.3), "zorder": 6}
        axes.add_patch(Circle((x[-1], y[-1]), person.radius, gid="person", **disc))
        if person.name:
            text = axes.annotate(
                printable(person.name), (x[-1], y[-1]), (4, 4), textcoords="offset points", fontsize=SMALL, zorder=6.5,
                annotation_clip=True,
            )  # fmt: skip
            text.set_path_effects(list(HALO))


def _draw_progress(axes: Axes, driven: _Driven, gaps: FloatArray, moments: FloatArray) -> None:
    """Draw the distance driven over time, and dashed lines at ``moments``, s.

    The background shows how near people are to each position on the path at each time (``gaps``, m).
    """
    levels = [-1e9, 0.0, *HALL.values(), 1e9]
    axes.imshow(
        gaps,
        cmap=ListedColormap(list(NEARNESS)),
        norm=BoundaryNorm(levels, len(NEARNESS)),
        extent=(0.0, driven.times[-1], 0.0, driven.along[-1]),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        zorder=0,
    )
    axes.plot(driven.times, driven.along, color="white", linewidth=4.0, zorder=3)
    axes.plot(driven.times, driven.along, color=ROBOT, linewidth=2.2, zorder=3.1, gid="way")
    for moment in moments:
        axes.axvline(moment, color=QUIET, linewidth=0.7, linestyle=(0, (3, 3)), zorder=2)
    axes.set_xlabel("time (s); dashed: the moments of the maps", fontsize=NORMAL)
    axes.set_ylabel("path of the robot (m)", fontsize=NORMAL)
    axes.tick_params(labelsize=SMALL)
    words = "colour: distance of the nearest person to each position of the path"
    axes.set_title(words, fontsize=SMALL, color=QUIET, loc="left", pad=2)


def _write_person_name(axes: Axes, person: Person, driven: _Driven, gaps: FloatArray) -> None:
    """Write a person's name in the chart of the position on the robot's path over time.

    The name is where the person would be nearest to the robot, if the robot were at that position at that time. It is
    left out if that distance is beyond Hall's social zone.

    gaps  (PLACES, TIMES)  m  gap between person and robot, for each position on the path and each time
    """
    touching = max(float(gaps.min()), 0.0)
    moments, places = np.nonzero((gaps <= touching).T)  # by time
    middle = moments.size // 2
    moment, place = moments[middle], places[middle]
    if person.name and gaps[place, moment] < HALL["social"]:
        t, along = moment / TIMES * driven.times[-1], place / PLACES * driven.along[-1]
        text = axes.annotate(
            printable(person.name), (t, along), fontsize=SMALL, ha="center", va="center", zorder=4, annotation_clip=True
        )
        text.set_path_effects(list(HALO))
