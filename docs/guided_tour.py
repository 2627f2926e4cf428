"""Draw the picture in README, docs/guided_tour.png: the fastest guided tours on the map, and the whole front.

The tours are those of examples/10_guided_tour.py. The picture is written to out/guided_tour.
"""

import runpy
from itertools import pairwise
from math import degrees
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Wedge
from matplotlib.patheffects import withStroke

import hpop

OUT = Path("out/guided_tour")
COLOURS = {2: "#000000", 3: "#D55E00", 4: "#0072B2"}  # by number of exhibits
APART = 0.18  # m between the lines of tours that drive along one path
VIEW = 1.5  # m: length of the wedges that show the view at a stop
LONG = 3.5  # m: longer straight pieces have an arrow
SMALL, NORMAL = 11, 12  # points
HALO = (withStroke(linewidth=3, foreground="white"),)


def corners(trajectory: hpop.Trajectory) -> np.ndarray:
    """Return the corners of a path (n, 2), m: start, goal, and where it turns or turns back."""
    points = np.stack([trajectory.states.x, trajectory.states.y], axis=1)
    points = points[np.append(True, np.any(np.diff(points, axis=0), axis=1))]
    ahead = np.diff(points, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    turns = np.abs(np.diff(ahead, axis=0)).max(axis=1) > 1e-6
    return points[np.concatenate([[True], turns, [True]])]


def shifted(points: np.ndarray, aside: float) -> np.ndarray:
    """Shift the corners of a path (n, 2) to its right, m: where the robot turns back, its line returns on the left."""
    ahead = np.diff(points, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    line = [points[0] + aside * right[0]]
    for at, before, after in zip(points[1:-1], right[:-1], right[1:], strict=True):
        bend = 1.0 + before @ after  # 0 where it turns back
        line += [at + aside * (before + after) / bend] if bend > 0.1 else [at + aside * before, at + aside * after]
    return np.array([*line, points[-1] + aside * right[-1]])


def draw_tours(axes: Axes, problem: hpop.Problem, front: hpop.Front, fastest: dict[int, int]) -> None:
    """Draw the fastest tour for each number of exhibits on the map."""
    for obstacle in problem.world.obstacles:
        seen_over = obstacle.z_max < problem.model.camera_height
        axes.add_patch(Polygon(obstacle.polygon.exterior.coords, color="#d0d0d0" if seen_over else "#555555", lw=0))
    for layer, (count, row) in enumerate(fastest.items()):
        tour = front.trajectories[row]
        line = shifted(corners(tour), APART * (layer - 1))
        axes.plot(*line.T, color=COLOURS[count], linewidth=2.4, zorder=3, solid_joinstyle="round")
        for begin, end in pairwise(line):
            if np.hypot(*(end - begin)) > LONG:
                tip = begin + (end - begin) * (0.4 + 0.12 * layer)
                ahead = {"color": COLOURS[count], "arrowstyle": "-|>", "mutation_scale": 17, "shrinkA": 0, "shrinkB": 0}
                axes.annotate("", tip, tip - 0.01 * (end - begin), arrowprops=ahead, zorder=3)
        half = degrees(problem.model.field_of_view[0]) / 2
        for visit in front.provenance[row]["visits"]:
            at = tour.at(visit["begin"])
            yaw, place = degrees(at.yaw[0]), (at.x[0], at.y[0])
            look = {"facecolor": (COLOURS[count], 0.3), "edgecolor": COLOURS[count], "linewidth": 0.8, "zorder": 2}
            axes.add_patch(Wedge(place, VIEW, yaw - half, yaw + half, **look))
            axes.plot(*place, "o", color=COLOURS[count], markeredgecolor="white", markersize=9, zorder=4)
    for number, mark in enumerate(problem.world.content.landmarks, 1):
        optional = " (optional)" if problem.tour.stops[number - 1].optional else ""
        axes.plot(mark.x, mark.y, "*", color="#f5b700", markersize=13, markeredgecolor="black", zorder=5)
        below = -1 if mark.y < 10 else 1
        axes.annotate(
            f"{number} {mark.name}{optional}", (min(mark.x, 24.6), mark.y), (0, 16 * below), textcoords="offset points",
            ha="center", va="center", fontsize=SMALL, weight="bold", color="#5b1478", path_effects=HALO, zorder=6,
        )  # fmt: skip
    for text, (x, y, _) in (("start", problem.start), ("exit", problem.goal)):
        axes.annotate(
            text, (x, y), ha="center", va="center", fontsize=SMALL, zorder=6,
            bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": "black"},
        )  # fmt: skip
    axes.set(xlim=(0, 30), ylim=(0, 20), aspect="equal", xticks=[], yticks=[])
    axes.set_title("The fastest tour with 2, 3 and 4 exhibits, 10 s at each", fontsize=NORMAL)


def draw_front(axes: Axes, front: hpop.Front, fastest: dict[int, int]) -> None:
    """Draw all optimal tours by time and acceleration, with a curve for each number of exhibits."""
    time, felt, skipped = front.costs.T
    for count, row in fastest.items():
        own = np.flatnonzero(np.round(4 - skipped) == count)
        axes.plot(time[own], felt[own], "o", color=COLOURS[count], markersize=4.5)
        axes.plot(time[row], felt[row], "o", color=COLOURS[count], markersize=10, markeredgecolor="white")
        axes.annotate(
            f"{count}" if count < 4 else "4 exhibits", (time[row], felt[row]), (-4, 10), textcoords="offset points",
            fontsize=SMALL, color=COLOURS[count], weight="bold",
        )  # fmt: skip
    axes.set_xlabel("duration (s)", fontsize=SMALL)
    axes.set_ylabel("felt acceleration (m/s)", fontsize=SMALL)
    axes.set_title(f"All {len(front)} optimal tours (less is better)", fontsize=NORMAL)
    axes.set_xlim(right=time.max() + 5)
    axes.set_ylim(0, felt.max() + 4)
    axes.grid(color="#e4e4e4")
    axes.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Plan the tours, and draw them."""
    example = runpy.run_path(str(Path(__file__).resolve().parents[1] / "examples" / "10_guided_tour.py"))
    front = example["main"](OUT)
    problem = hpop.Problem.from_description(front.problem)
    fastest: dict[int, int] = {}
    for point in front:  # sorted by duration
        fastest.setdefault(4 - round(point.costs["stops_missed"]), point.index)
    figure = Figure(figsize=(11, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.75, 1))
    fastest = dict(sorted(fastest.items()))
    draw_tours(left, problem, front, fastest)
    draw_front(right, front, fastest)
    figure.savefig(OUT / "guided_tour.png", dpi=100)


if __name__ == "__main__":
    main()
