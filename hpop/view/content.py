"""Drawing of people, conversations, landmarks and zones on a map.

Sizes of symbols are shares of ``side``: the longer side of the map, m, which is multiplied by 1.5 on a small map.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch
from shapely.geometry import LineString

from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.view.ground import View, outline
from hpop.view.style import HALO, SMALL
from hpop.world import World
from hpop.world.content.content import Landmark, Person, Zone

INK = "#202020"
SKIN = "#ffffff"
TALK = "#6a3d9a"
STAR = "#ffc20a"
SLOW = "#b3541e"
WAY = "#2f6690"
LEAST_RADIUS = 0.0065  # of a person's disc, as a share of the map's longer side
REACH = 0.06  # length of a velocity of 1 m/s, as a share of the map's longer side
PITCH = 0.11  # from one arrow of a one-way zone to the next, as a share of the map's longer side
ENLARGED = 1.5  # factor of these shares on a small map
RIGHT, LEFT = 6.0, 13.0  # points from the middle of a star to its name; on its left is the number of a stop
LETTER = 0.62 * SMALL  # points: width of a letter
MOST_NAMES = 12  # most landmarks, and most people, whose names are written
Handle = Line2D | Patch


def draw_content(axes: Axes, world: World, view: View, *, small: bool = False) -> list[Handle]:
    """Draw the people, conversations, landmarks and zones in a view of the map, and return their legend entries.

    Keep-out zones are drawn with the obstacles. On a small map names and predicted paths are left out, and symbols are
    enlarged.
    """
    content = world.content
    shown = shapely.box(view.x_min, view.y_min, view.x_max, view.y_max)
    people = [person for person in content.people if shapely.intersects_xy(shown, person.x, person.y)]
    landmarks = [mark for mark in content.landmarks if shapely.intersects_xy(shown, mark.x, mark.y)]
    zones = [zone for zone in content.zones if shown.intersects(zone.area)]
    talks = [[content.people[i] for i in group] for group in content.groups]
    side = (ENLARGED if small else 1.0) * max(view.width, view.height)
    if not small:
        _draw_names(axes, people, landmarks, view)
    ways = [] if small else _draw_predicted_paths(axes, content.people)
    return [
        *_draw_zones(axes, zones, side),
        *_draw_groups(axes, [talk for talk in talks if any(person in people for person in talk)]),
        *_draw_landmarks(axes, landmarks, side),
        *_draw_people(axes, people, side),
        *ways,
    ]


def _draw_predicted_paths(axes: Axes, people: Sequence[Person]) -> list[Handle]:
    """Draw a dotted line along the predicted path of each hypothesis of a person whose prediction ends.

    Draw no lines if there are more than twelve such people.
    """
    walking = [person for person in people if person.moves and math.isfinite(person.settled)]
    if not walking or len(walking) > MOST_NAMES:
        return []
    look = {"color": INK, "linewidth": 1.1, "linestyle": ":"}
    for hypothesis in (hypothesis for person in walking for _, hypothesis in person.hypotheses):
        way = hypothesis.way()
        axes.plot(way[:, 1], way[:, 2], zorder=5.85, gid="predicted", **look)  # type: ignore[arg-type]
    return [Line2D([], [], label="predicted path\nof a person", **look)]  # type: ignore[arg-type]


def _draw_people(axes: Axes, people: Sequence[Person], side: float) -> Iterator[Handle]:
    """Draw people as discs, with a tick for the heading and an arrow for the velocity; return the legend entries.

    The disc of a person who comes later is dashed.
    """
    for person in people:
        radius = _disc(person, side)
        likeliest = person.likeliest
        disc = Circle((person.x, person.y), radius, facecolor=SKIN, edgecolor=INK, zorder=6, gid="person")
        disc.set_linestyle("--" if likeliest.begin > 0 else "-")
        axes.add_patch(disc)
        tick = _ray(person.x, person.y, float(likeliest.yaw_at(np.float64(likeliest.begin))), 1.5 * radius)
        axes.plot(*tick, color=INK, linewidth=1.4, zorder=6.1, gid="heading")
        for velocity in (one.velocity_at(np.float64(one.begin)) for _, one in person.hypotheses):
            if not any(velocity):
                continue
            tip = (person.x + REACH * side * velocity[0], person.y + REACH * side * velocity[1])
            arrow = {"arrowstyle": "->", "color": INK, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", tip, (person.x, person.y), arrowprops=arrow, zorder=5.9).set_gid("velocity")
    size = "" if all(person.radius == _disc(person, side) for person in people) else " (enlarged)"
    look = {"marker": "o", "markersize": 6.5, "markerfacecolor": SKIN, "markeredgecolor": INK}
    if any(not person.moves for person in people):
        yield Line2D([], [], linestyle="none", label=f"person{size}, tick: heading", **look)  # type: ignore[arg-type]
    if any(person.moves for person in people):
        label = f"person walking{size},\narrow: velocity"
        yield Line2D([], [], color=INK, linewidth=1.1, label=label, **look)  # type: ignore[arg-type]
    if any(person.likeliest.begin > 0 for person in people):
        yield Patch(
            facecolor=SKIN, edgecolor=INK, linestyle="--", label="person who comes later,\nat the first position"
        )


def _draw_groups(axes: Axes, talks: Sequence[Sequence[Person]]) -> Iterator[Handle]:
    """Draw a dashed line between two people in conversation, or a ring through three or more."""
    look = {"color": TALK, "linewidth": 1.8, "linestyle": (0, (1.5, 1))}
    for talk in talks:
        points: FloatArray = np.array([(person.x, person.y) for person in talk])
        middle = points.mean(axis=0)
        round_it = np.argsort(np.arctan2(*(points - middle).T[::-1]), kind="stable")
        ring = points if len(points) == 2 else points[[*round_it, round_it[0]]]
        axes.plot(*ring.T, zorder=5.8, gid="conversation", **look)  # type: ignore[arg-type]
    if talks:
        yield Line2D([], [], label="conversation", **look)  # type: ignore[arg-type]


def _draw_landmarks(axes: Axes, landmarks: Sequence[Landmark], side: float) -> Iterator[Handle]:
    """Draw landmarks as stars; a tick shows the direction that a landmark faces."""
    look = {"marker": "*", "markerfacecolor": STAR, "markeredgecolor": INK, "markeredgewidth": 0.7}
    for mark in landmarks:
        if mark.facing is not None:
            tick = _ray(mark.x, mark.y, mark.facing, 0.025 * side)
            axes.plot(*tick, color=INK, linewidth=1.4, zorder=5.6, gid="facing")
        axes.plot([mark.x], [mark.y], linestyle="none", markersize=11, zorder=5.7, gid="landmark", **look)  # type: ignore[arg-type]
    if landmarks:
        front = ", tick: its front" if any(mark.facing is not None for mark in landmarks) else ""
        yield Line2D([], [], linestyle="none", markersize=9.5, label=f"landmark{front}", **look)  # type: ignore[arg-type]


def _draw_zones(axes: Axes, zones: Sequence[Zone], side: float) -> Iterator[Handle]:
    """Draw hatched areas: speed limits with their number in the middle, one-way zones with arrows along their path."""
    for kind, label, colour, hatch in (
        ("speed", "speed limit", SLOW, "...."),
        ("one-way", "one-way, along the arrows", WAY, "///"),
    ):
        for zone in (zone for zone in zones if zone.kind == kind):
            patch = PathPatch(outline(zone.area), facecolor="none", edgecolor=colour, hatch=hatch, zorder=1.7)
            patch.set(linewidth=1.0, alpha=0.55, gid=f"{kind} zone")
            patch.set_hatch_linewidth(0.5)
            axes.add_patch(patch)
            if zone.path is not None:
                _draw_arrows(axes, zone.path, side)
            if zone.limit is not None:
                middle = zone.area.representative_point()
                write(axes, f"{zone.limit:g} m/s", middle.x, middle.y, (0, 0), SLOW, "center")
        if any(zone.kind == kind for zone in zones):
            yield Patch(facecolor="none", edgecolor=colour, hatch=hatch, label=label)


def _draw_arrows(axes: Axes, path: LineString, side: float) -> None:
    """Draw evenly spaced arrows along a path, at least one."""
    count = max(1, round(path.length / (PITCH * side)))
    size = min(0.035 * side, path.length / count)
    for middle in (np.arange(count) + 0.5) * path.length / count:
        tail, tip = (path.interpolate(middle + off) for off in (-size / 2, size / 2))
        arrow = {"arrowstyle": "-|>", "color": WAY, "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (tip.x, tip.y), (tail.x, tail.y), arrowprops=arrow, zorder=1.75).set_gid("way")


def _draw_names(axes: Axes, people: Sequence[Person], landmarks: Sequence[Landmark], view: View) -> None:
    """Write names beside landmarks and people, unless there are too many. People drawn enlarged get no name."""
    side = max(view.width, view.height)
    named = [mark for mark in landmarks if mark.name]
    for mark in named if len(named) <= MOST_NAMES else ():
        write_name(axes, mark.name, mark.x, mark.y, view)
    known = [person for person in people if person.name and person.radius == _disc(person, side)]
    for person in known if len(known) <= MOST_NAMES else ():
        beside = 0.7 * person.radius
        write(axes, person.name, person.x + beside, person.y + beside, (2, 1), INK, "left")


def write_name(axes: Axes, name: str, x: float, y: float, view: View) -> None:
    """Write the name of a landmark on the right of its star, or on the left if it would cross the right border."""
    if x + (RIGHT + LETTER * len(name)) * view.point < view.x_max:
        write(axes, name, x, y, (RIGHT, 3), INK, "left")
    else:
        write(axes, name, x, y, (-LEFT, 3), INK, "right")


def write(axes: Axes, text: str, x: float, y: float, off: tuple[float, float], colour: str, align: str) -> None:
    """Write text beside a point of the map, shifted by ``off`` typographical points, if the point is in view."""
    label = axes.annotate(
        printable(text),
        (x, y),
        off,
        textcoords="offset points",
        color=colour,
        fontsize=SMALL,
        ha=align,
        va="center" if align == "center" else "bottom",
        zorder=6.5,
        annotation_clip=True,
    )
    label.set_path_effects(list(HALO))


def _disc(person: Person, side: float) -> float:
    """Return the radius, m, of a person's disc: the true radius, or a greater one if this is too small to see."""
    return max(person.radius, LEAST_RADIUS * side)


def _ray(x: float, y: float, yaw: float, length: float) -> tuple[FloatArray, FloatArray]:
    reach = np.array([0.0, length])
    return x + reach * np.cos(yaw), y + reach * np.sin(yaw)
