"""Symbols on a map: start and goal, targets to look at, stops of a tour, and clocks where the robot waits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.path import Path
from matplotlib.transforms import offset_copy

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.text import printable
from hpop.motions import HOLD, States
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.style import GOAL, HALO, QUIET, SMALL, START, mapped_points, mapped_pose, positions

if TYPE_CHECKING:
    from hpop.view.ground import View

CIRCLE = 12.0  # points across
RING = 19.0  # points across
LOOKS = {"start": ("S", START), "goal": ("G", GOAL)}
END_DIGITS = 6  # decimals of m to which two ends are compared
Place = Sequence[float]


class EndPose(NamedTuple):
    """Pose, at the start or at a goal, of the body that the map shows (or of the camera): m, m, rad.

    ``yaw`` is None if the heading is free. For the body that a map shows, it is also None if the robot has no base.
    """

    x: float
    y: float
    yaw: float | None


Ends = tuple[EndPose, tuple[EndPose, ...]]


def end_poses(problem: Problem, found: Sequence[Trajectory] = ()) -> Ends:
    """Return the pose of the start and the poses of the goals, for a map.

    For a goal that is not a list of states, the last poses of the ``found`` trajectories are returned.
    """
    model, poses = problem.model, []
    for state in _end_states(problem, found):
        pose = mapped_pose(model, state)
        x, y, yaw = (float(column[0]) for column in (pose.x, pose.y, pose.yaw))
        if not math.isnan(x + y):
            poses.append(EndPose(x, y, None if math.isnan(yaw) or "base" not in model.provides else yaw))
    return poses[0], tuple(dict.fromkeys(poses[1:]))


def end_positions(problem: Problem, found: Sequence[Trajectory] = ()) -> tuple[FloatArray, FloatArray]:
    """Return the camera's positions at the start (3,) and at the goals (n, 3), m; see :func:`end_poses`."""
    poses = [positions(problem.model.pose("camera", state)) for state in _end_states(problem, found)]
    places = np.concatenate(poses)
    known = places[1:][~np.isnan(places[1:]).any(axis=1)]
    return places[0], np.unique(known.round(END_DIGITS), axis=0)


def camera_ends(problem: Problem, found: Sequence[Trajectory] = ()) -> Ends:
    """Return the camera's poses at the start and at the goals, seen from above; see :func:`end_poses`.

    A free heading is None. If a free heading would move the camera, the last poses of the ``found`` trajectories are
    returned for the goals.
    """
    states, poses = _end_states(problem, found), []
    start, *listed = (problem.model.pose("camera", state) for state in states)
    if any(np.isnan(pose.x).any() for pose in listed):
        listed = [problem.model.pose("camera", trajectory.states.take([-1])) for trajectory in found]
    for pose in (start, *listed):
        x, y, yaw = (float(np.broadcast_to(column, (1,))[0]) for column in (pose.x, pose.y, pose.yaw))
        poses.append(EndPose(x, y, None if math.isnan(yaw) else yaw))
    spots = {
        (round(pose.x, END_DIGITS), round(pose.y, END_DIGITS), pose.yaw and round(pose.yaw, END_DIGITS)): pose
        for pose in poses[1:]
    }
    return poses[0], tuple(spots.values())


def goal_words(problem: Problem, count: int) -> str:
    """Return the words that follow "goal" in the legend, such as ", any of 3"; "" for a single listed goal."""
    if not problem.target.listed:
        return ", where trajectories end"
    return f", any of {count}" * (count > 1)


def _end_states(problem: Problem, found: Sequence[Trajectory]) -> list[States]:
    """Return the state of the start, then the states of the listed goals, in which free values are NaN.

    For a goal that is not a list of states, the last states of the ``found`` trajectories follow instead.
    """
    space = problem.model.space
    states = [space.state(problem.start)]
    if problem.target.listed:
        return states + [space.state(values, free=space.angles) for values in problem.goals]
    return states + [trajectory.states.take([-1]) for trajectory in found]


def draw_ends(axes: Axes, start: Place, goals: Sequence[Place], words: tuple[str, str] = ("", "")) -> list[Line2D]:
    """Draw the letters S and G at start and goals, and return the legend entries, with ``words`` added to each."""
    handles = []
    for (name, (letter, fill)), places, more in zip(LOOKS.items(), ([start], goals), words, strict=True):
        look: dict[str, Any] = {"marker": "o", "markerfacecolor": fill, "markeredgecolor": "black"}
        for x, y in places:
            ring = name == "goal" and (x, y) == tuple(start)
            size = RING if ring else CIRCLE
            axes.plot([x], [y], linestyle="none", markersize=size, zorder=7.9 if ring else 8, gid=name, **look)
            if not ring:
                axes.text(x, y, letter, ha="center", va="center_baseline", fontsize=7.5, weight="bold", zorder=9)
        if len(places):
            entry = f"{letter}: {name}{more}"
            handles.append(Line2D([], [], linestyle="none", markersize=8, label=entry, **look))
    return handles


STOP = "#7a0177"
DISC: dict[str, Any] = {"facecolor": "none", "edgecolor": STOP, "linewidth": 0.9, "linestyle": ":"}
DISC_ENTRY: dict[str, Any] = {
    "linestyle": "none", "marker": "o", "markersize": 9, "markerfacecolor": "none", "markeredgecolor": STOP,
}  # fmt: skip
TARGET: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markeredgecolor": "#d62728"}
SIZE, WIDTH = 14.0, 2.0  # points: round the star of a landmark that is the target


def targets_of(problem: Problem) -> FloatArray:
    """Return the distinct points (n, 3), m, that criteria or goals refer to, such as a landmark to look at."""
    places = dict.fromkeys(place for _, place in _named_targets(problem))
    return np.array(list(places), float).reshape(-1, 3)


def targets_by_name(problem: Problem) -> list[tuple[str, tuple[float, float, float]]]:
    """Return the distinct targets, m, each with the names of the criteria or goals that it belongs to."""
    names: dict[tuple[float, float, float], list[str]] = {}
    for name, place in _named_targets(problem):
        names.setdefault(place, []).append(name)
    return [(", ".join(dict.fromkeys(several)), place) for place, several in names.items()]


def draw_targets(axes: Axes, problem: Problem, flatten: Callable[[FloatArray], FloatArray]) -> list[Line2D]:
    """Draw a ring round each target, projected to the picture by ``flatten``, and return the legend entry."""
    places = targets_of(problem)
    if not len(places):
        return []
    axes.plot(*flatten(places).T, markersize=SIZE, markeredgewidth=WIDTH, zorder=5.8, gid="targets", **TARGET)
    names = ", ".join(dict.fromkeys(name for name, _ in _named_targets(problem)))
    return [Line2D([], [], markersize=0.7 * SIZE, markeredgewidth=WIDTH, label=f"target of {names}", **TARGET)]


def _named_targets(problem: Problem) -> list[tuple[str, tuple[float, float, float]]]:
    """Return each target, m, with the name of its criterion, or "the goal"."""
    named = [(criterion.name, place) for criterion in problem.criteria for place in criterion.places]
    return [*named, *(("the goal", place) for place in problem.target.places)]


def draw_stops(axes: Axes, problem: Problem, flatten: Callable[[FloatArray], FloatArray] | None = None) -> list[Line2D]:
    """Draw the numbers of a tour's stops, and circles within which they count as visited; return the legend entry.

    flatten  projects points (3,) to a side view, which shows stops with a landmark or target; None for maps
    """
    if problem.tour is None:
        return []
    for number, stop in enumerate(problem.tour.stops, 1):
        place = stop.place(problem.world)
        if flatten is not None:
            point = stop.place_in_space(problem.world)
            place = None if point is None else tuple(flatten(np.array(point)).tolist())
        if place is None:
            continue
        if flatten is None and stop.at is not None and stop.within is not None:
            axes.add_patch(Circle(place, stop.within, zorder=3.5, gid="stop disc", **DISC))
        axes.annotate(
            str(number), place, xytext=(-7, 7), textcoords="offset points", ha="center", va="center",
            fontsize=SMALL, weight="bold", color=STOP, zorder=8.6, path_effects=HALO, gid="stop",
        )  # fmt: skip
    names = "\n".join(printable(f"{number} {name}") for number, name in enumerate(problem.tour.names, 1))
    return [Line2D([], [], label=f"stops:\n{names}", **DISC_ENTRY)]


def stop_places(problem: Problem) -> list[tuple[float, float]]:
    """Return the positions (x, y), m, at which maps have the numbers of a tour's stops."""
    stops = () if problem.tour is None else problem.tour.stops
    return [place for stop in stops if (place := stop.place(problem.world)) is not None]


HOLD_DIGITS = 6  # decimals of m to which the positions of holds are compared
BESIDE = 11.0  # points to the right of and above the place, beside dots of turns and letters
ROW = 13.0  # points between clocks above each other
ASIDE = 44.0  # points between clocks of one trajectory at close places
SHARED = 0.1  # distance, as a share of the longer side of the map, below which tours share a clock
NEAR = (0.12, 0.04)  # distances along x and y, as shares of the picture's width, below which places are close
Colour = tuple[float, float, float, float]
WHITE: Colour = (1.0, 1.0, 1.0, 1.0)
DARK = 1.5  # sum of red, green and blue
HANDS = Path([(0.0, 0.6), (0.0, 0.0), (0.45, 0.0)])
CLOCK = Path.make_compound_path(Path.unit_circle(), HANDS)


class Held(NamedTuple):
    """Position, m, where a robot waits, the total waiting time there, s, and the indices of these motions (holds)."""

    x: float
    y: float
    seconds: float
    motions: tuple[int, ...]


def is_held(trajectory: Trajectory) -> BoolArray:
    """Return a mask (n,) of the motions that are holds, in which the robot waits without driving or turning."""
    return np.array([kind == HOLD.kind for kind in trajectory.kinds], dtype=bool)


def holds_of(trajectory: Trajectory) -> list[Held]:
    """Return the positions where the robot waits, in order of time; waits at one position are added up."""
    spots: dict[tuple[float, float], list[int]] = {}
    points = np.round(mapped_points(trajectory.model, trajectory.states), HOLD_DIGITS)
    for i in np.flatnonzero(is_held(trajectory)).tolist():
        spots.setdefault((float(points[i, 0]), float(points[i, 1])), []).append(i)
    return [Held(*spot, float(trajectory.durations[own].sum()), tuple(own)) for spot, own in spots.items()]


def written_time(seconds: float) -> str:
    """Format a duration.

    >>> written_time(3.0), written_time(2.25), written_time(0.04), written_time(600.0)
    ('3 s', '2.2 s', '0.04 s', '10 min')
    """
    if seconds >= 120.0:
        return f"{seconds / 60.0:.3g} min"
    return f"{round(seconds, 1) or seconds:.3g} s"


def draw_holds(
    axes: Axes,
    trajectory: Trajectory,
    colour: str,
    view: View,
    *,
    taken: list[tuple[float, float]] | None = None,
    gid: str = "hold",
    face: Callable[[Held], Colour] = lambda held: WHITE,
) -> None:
    """Draw a clock with the waiting time beside each position where the robot stands still.

    view   rectangle of the map: clocks of close positions are drawn side by side
    taken  positions (x, y), m, that clocks do not cover, such as those of other clocks; the new clocks are appended
    face   function that returns the colour of a clock's face
    """
    drawn, taken = holds_of(trajectory), [] if taken is None else taken
    for number, held in enumerate(drawn):
        right = BESIDE + ASIDE * sum(_are_near(held, other, view.width) for other in drawn[:number])
        up = _free_height(held, right, view, taken)
        taken.append((held.x + right * view.point, held.y + up * view.point))
        _draw_clock(axes, [(held, colour)], (right, up), face(held), gid)


def draw_shared_holds(
    axes: Axes, tours: Mapping[str, tuple[Trajectory, str]], view: View, taken: list[tuple[float, float]]
) -> None:
    """Draw the waits of several tours as clocks, with a line from each clock to the positions where robots wait.

    Waits of different tours share a clock if they last equally long and are near to each other; the clock is then
    grey. For the other parameters see :func:`draw_holds`.

    tours  trajectories and their colours, by label
    """
    clocks: list[dict[str, tuple[Held, str]]] = []
    for label, (trajectory, colour) in tours.items():
        for held in holds_of(trajectory):
            shared = [clock for clock in clocks if label not in clock and _may_share(held, clock.values(), view)]
            if not shared:
                clocks.append({})
            (shared[0] if shared else clocks[-1])[label] = held, colour
    for clock in clocks:
        waits = list(clock.values())
        up = _free_height(waits[0][0], BESIDE, view, taken)
        taken.append((waits[0][0].x + BESIDE * view.point, waits[0][0].y + up * view.point))
        _draw_clock(axes, waits, (BESIDE, up), WHITE, f"holds of {', '.join(clock)}")


def _may_share(held: Held, waits: Iterable[tuple[Held, str]], view: View) -> bool:
    """Return whether a wait may share a clock: it is as long as all waits of the clock, and near to each of them."""
    reach = SHARED * max(view.width, view.height)
    return all(
        written_time(held.seconds) == written_time(other.seconds)
        and math.hypot(held.x - other.x, held.y - other.y) < reach
        for other, _ in waits
    )


def _draw_clock(
    axes: Axes, waits: Sequence[tuple[Held, str]], offset: tuple[float, float], face: Colour, gid: str
) -> None:
    """Draw the clock of some waits, each with its colour, at an offset (typographical points) from the first one."""
    first, colour = waits[0] if len(waits) == 1 else (waits[0][0], QUIET)
    figure, (right, up) = axes.get_figure(root=True), offset
    beside = offset_copy(axes.transData, figure, right, up, units="points")
    for held, own in waits:
        lead: dict[str, Any] = {"arrowstyle": "-", "color": own, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 3}
        axes.annotate("", (held.x, held.y), xytext=(first.x, first.y), textcoords=beside, arrowprops=lead, zorder=8.5)
    axes.add_line(hold_clock(colour, first.x, first.y, face, transform=beside, zorder=9, gid=gid))
    axes.annotate(
        written_time(first.seconds), (first.x, first.y), xytext=(right + 8, up), textcoords="offset points",
        fontsize=SMALL, color=colour, va="center", zorder=9, path_effects=HALO, gid=gid,
    )  # fmt: skip


def _free_height(held: Held, right: float, view: View, taken: Sequence[tuple[float, float]]) -> float:
    """Return the height, typographical points, of a clock above its position; negative below it.

    Of some heights in even steps, it is the nearest to the position at which the clock, ``right`` points to the right,
    is in view and covers none of the ``taken`` positions, m. If there is none, it is :data:`BESIDE`.
    """
    point = view.point
    for row in range(len(taken) + 1):
        for up in (BESIDE + ROW * row, -BESIDE - ROW * row):
            x, y = held.x + right * point, held.y + up * point
            inside = view.y_min < y - BESIDE * point and y + BESIDE * point < view.y_max
            if inside and not any(
                abs(x - a) < 0.99 * ASIDE * point and abs(y - b) < 0.99 * ROW * point for a, b in taken
            ):
                return up
    return BESIDE


def _are_near(one: Held, other: Held, width: float) -> bool:
    """Return whether the clocks of two positions would overlap in a picture that is ``width`` m wide."""
    along, across = NEAR
    return abs(one.x - other.x) < along * width and abs(one.y - other.y) < across * width


def hold_clock(
    colour: str, x: float | None = None, y: float | None = None, face: Colour = WHITE, **more: Any
) -> Line2D:
    """Return a clock symbol at a position, or the legend entry without one; its hands are white on a dark face."""
    xs, ys = ([], []) if x is None or y is None else ([x], [y])
    edge = colour if sum(face[:3]) > DARK else "white"
    look: dict[str, Any] = {"markerfacecolor": face, "markeredgecolor": edge, "markeredgewidth": 1.2}
    return Line2D(xs, ys, linestyle="none", marker=CLOCK, markersize=10, **look, **more)


def hold_entry() -> Line2D:
    """Return the legend entry for the clocks of waits."""
    return hold_clock(QUIET, label="stands still, for this time")
