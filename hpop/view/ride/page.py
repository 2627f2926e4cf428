"""Ride page: shows the viewer's view along trajectories in a browser, to compare them.

It needs no network. Its view is drawn by three.js, which is in the page. The page holds poses of the camera and of the
robot's links, twenty for each second, and convex bodies as triangles.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.files import replacing
from hpop.base.text import printable
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, OutputError
from hpop.motions import Model, States
from hpop.problems.evaluation import trace
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow, named_rows, stop_visits
from hpop.problems.problem import Problem
from hpop.trajectories.poses import on_one_side, poses, quaternions_of
from hpop.trajectories.trajectory import Trajectory
from hpop.view.explorer.along import columns_of, merged_rates, piece_ends, words
from hpop.view.ride.scene import ViewScene
from hpop.view.ride.surfaces import Colour
from hpop.view.single_page import page_file, single_page
from hpop.view.style import quantities, value_text
from hpop.world import World
from hpop.world.geometry.solids import Shape, Sphere

LINKS: tuple[Colour, ...] = ((206, 208, 210), (120, 128, 138))
"""Alternating colours of a robot's links."""
DIRECTIONS = 120
"""Number of points that approximate a sphere."""
DIGITS = 4
"""Decimals of coordinates in m."""


class BodyMesh(NamedTuple):
    """Triangles of a convex body.

    points     (V, 3)  m
    triangles  (T, 3)  indices of the corners among the points, counter-clockwise as seen from outside
    """

    points: FloatArray
    triangles: IntArray

    def description(self, number: int, colour: Colour) -> dict[str, Any]:
        """Return the mesh as JSON, with the number of its obstacle and its colour."""
        return {
            "points": np.round(self.points, DIGITS).tolist(),
            "triangles": self.triangles.tolist(),
            "number": number,
            "colour": list(colour),
        }


def body_of(shape: Shape, pose: FloatArray | None = None) -> BodyMesh:
    """Return the triangles of a convex shape, moved by a pose (4, 4) if given.

    >>> from hpop.world.geometry.solids import Box
    >>> len(body_of(Box((1.0, 2.0, 3.0))).triangles)
    12
    """
    points = _on_sphere(shape.radius) if isinstance(shape, Sphere) else np.asarray(shape.corners)
    if pose is not None:
        points = points @ pose[:3, :3].T + pose[:3, 3]
    hull = ConvexHull(points)
    kept = np.unique(hull.simplices)
    triangles = np.searchsorted(kept, hull.simplices)
    points = points[kept]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ti,ti->t", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return BodyMesh(points, triangles)


def solids_not_upright(scene: ViewScene) -> list[dict[str, Any]]:
    """Return as JSON the true shapes of solids that are no upright prisms, such as spheres and tilted boxes.

    Panoramas draw them as upright prisms round them.
    """
    return [
        body_of(prism.solid.shape, prism.solid.pose).description(prism.number, prism.colour)
        for prism in scene.prisms
        if prism.solid is not None
    ]


def links_of(model: Model, states: States) -> list[dict[str, Any]]:
    """Return as JSON the shapes of a robot's links in the first state, each in the link's own frame."""
    placed = model.bodies(states.take(slice(0, 1)))
    return [body_of(shape).description(0, LINKS[i % len(LINKS)]) for i, (shape, _) in enumerate(placed)]


def link_poses(model: Model, states: States) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield, for each solid of the robot (`model.bodies`), positions (N, 3), m, and quaternions (N, 4), x, y, z, w."""
    for _, matrices in model.bodies(states):
        links = np.broadcast_to(matrices, (states.size, 4, 4))
        yield links[:, :3, 3], on_one_side(quaternions_of(links[:, :3, :3]))


def _on_sphere(radius: float) -> FloatArray:
    """Return points (DIRECTIONS, 3), m, spread evenly over a sphere, along a spiral."""
    k = np.arange(DIRECTIONS) + 0.5
    up = 1.0 - 2.0 * k / DIRECTIONS
    turned = math.pi * (1.0 + math.sqrt(5.0)) * k
    wide = np.sqrt(1.0 - up * up)
    return radius * np.stack([wide * np.cos(turned), wide * np.sin(turned), up], axis=1)


RATE = 20.0
"""Poses a second."""
LENGTH, TURN = 1e-5, 1e-7
"""Resolution of the camera's positions, m, and quaternions."""
LINK_LENGTH, LINK_TURN = 1e-4, 1e-4
"""Resolution of the links' positions, m, and quaternions, which need less."""
FIGURES = 4
"""Significant digits of the criteria's rates."""
MOST_PIECES = 1500
"""Largest number of pieces of a trajectory for which rates are stored."""


def track(trajectory: Trajectory) -> dict[str, Any]:
    """Return the poses of camera and links along the executed trajectory as JSON; the page interpolates them."""
    seen = poses(trajectory, rate=RATE)
    links: list[FloatArray] = []
    turns: list[FloatArray] = []
    for positions, quaternions in link_poses(trajectory.model, seen.states):
        links.append(positions)
        turns.append(quaternions)
    columns = [np.hstack([p / LINK_LENGTH, q / LINK_TURN]) for p, q in zip(links, turns, strict=True)]
    return {
        "duration": float(seen.times[-1]),
        "rate": RATE,
        "positions": packed_columns(seen.positions, LENGTH),
        "quaternions": packed_columns(seen.quaternions, TURN),
        "links": packed_columns(np.hstack(columns) * LINK_TURN if columns else np.zeros((len(seen), 0)), LINK_TURN),
    }


def rates(criteria: Sequence[Criterion], trajectory: Trajectory, world: World) -> dict[str, Any] | None:
    """Return the rates of criteria along the executed trajectory as JSON; None without motion or criteria.

    ``times`` (m+1,), s, bound groups of consecutive pieces; ``values`` has m rates for each criterion, see
    :func:`merged_rates`.
    """
    run = trajectory.execution()
    if not len(run) or not criteria:
        return None
    found = trace(criteria, run, world)
    ends = piece_ends(len(found.pieces), MOST_PIECES)
    columns = [
        [float(f"{value:.{FIGURES}g}") for value in merged_rates(found, column, ends).tolist()]
        for column in range(len(found.criteria))
    ]
    return {"times": np.round(found.times[ends], 4).tolist(), "values": columns}


def packed_columns(values: FloatArray, scale: float) -> dict[str, Any]:
    """Return columns of numbers (N, C) as JSON: second differences of whole multiples of ``scale``.

    Each difference begins from 0, so first values are kept: 2, 4, 6 becomes 2, 2, 2, and then 2, 0, 0. Uniform motion
    gives mostly zeros.

    >>> packed_columns(np.array([[1.0], [2.0], [3.0]]), 0.5)
    {'scale': 0.5, 'columns': [[2, 0, 0]]}
    """
    counts = np.rint(values / scale).astype(np.int64)
    for _ in range(2):
        counts = np.diff(counts, axis=0, prepend=0)
    return {"scale": scale, "columns": counts.T.tolist()}


SCHEMA, VERSION = "hpop-ride", 1
NAMES = "ABCDEFGH"
"""Names of the trajectories of a page, in the order of ``rows``."""


@checked_arguments
def save_ride(
    problem: Problem,
    front: Front,
    path: str | os.PathLike[str] = "ride.html",
    *,
    rows: Sequence[int | str] = ("knee",),
    blind: bool = False,
) -> Path:
    """Write a page on which a viewer rides along trajectories of a front, and return its path.

    The page shows the camera's view along the executed trajectory, with people at their predicted positions; a map; and
    the rates of the criteria. Trajectories are named A, B, ... in the order of ``rows``.

    Parameters
    ----------
    path : file of the page, which needs no other files; its folder is created if missing
    rows : up to eight, by number or by name: "knee", "least turns", or "turns" for the least of a criterion
    blind : leave numbers, criteria and names of trajectories out, for choices by the view alone

    Raises OptionError for invalid rows or a name that does not end in .html, UnknownName for unknown names, OutputError
    if the page cannot be written; no partial file remains.
    """
    target = page_file(path)
    text = ride_page(problem, front, rows=rows, blind=blind)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(text.encode())
    except OSError as error:
        raise OutputError(
            f"the ride cannot be written to {target}: {error.strerror or error}; choose another file"
        ) from None
    return target


def ride_page(problem: Problem, front: Front, *, rows: Sequence[int | str] = ("knee",), blind: bool = False) -> str:
    """Return the HTML text of the page that `save_ride` writes."""
    return single_page("ride.js", "A ride" if blind else "The ride", ride_payload(problem, front, rows, blind=blind))


def ride_payload(problem: Problem, front: Front, rows: Sequence[int | str], *, blind: bool = False) -> dict[str, Any]:
    """Return the data of the ride page: JSON, `hpop-ride` version 1, read by web/src/ride/model.ts.

    rows   one to eight trajectories of the front, by number or name
    blind  whether to leave out criteria, labels, stops and notes, so that a viewer chooses by the view alone
    """
    chosen = named_rows(front, rows)
    if not 1 <= len(chosen) <= len(NAMES):
        raise OptionError(f"rows must name 1 to {len(NAMES)} trajectories of the front, got {len(chosen)}")
    scene = ViewScene.of(problem)
    fov = problem.model.field_of_view
    columns = [] if blind else columns_of(problem, front)[: len(front.names)]
    told: dict[str, Criterion] = {c.name: c for c in columns if c is not None}
    first = chosen[0].point.trajectory
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "blind": blind,
        "scene": scene.description(),
        "solids": solids_not_upright(scene),
        "links": links_of(first.model, first.states),
        "field_of_view": None if fov is None else list(fov),
        "criteria": [{"name": printable(c.name), "unit": printable(words(c)), "group": c.group} for c in told.values()],
        "tracks": [
            _track(problem, front, name, row, told, blind=blind) for name, row in zip(NAMES, chosen, strict=False)
        ],
        "stops": [] if blind or problem.tour is None else [stop.place(problem.world) for stop in problem.tour.stops],
        "notes": [] if blind else list(scene.notes),
        "licence": licence(),
    }


def _track(
    problem: Problem, front: Front, name: str, row: NamedRow, told: dict[str, Criterion], *, blind: bool
) -> dict[str, Any]:
    """Return the data of one trajectory as JSON; on a blind page (see `ride_payload`) only its motion."""
    trajectory = row.point.trajectory
    columns = {column.name: column for column in quantities(front)}
    shown = [columns[printable(c)] for c in told]
    return {
        "name": name,
        "label": "" if blind else _label(front, row),
        **track(trajectory),
        "visits": [] if blind else _visits(front, row.number),
        "rates": rates(list(told.values()), trajectory, problem.world),
        "costs": [value_text(float(column.values[row.number]), column.unit, column.counts) for column in shown],
    }


def _visits(front: Front, row: int) -> list[dict[str, Any]]:
    """Return the executed visits of a row as JSON: number and name of the stop, times of begin and end."""
    return [
        {"number": v.number, "name": printable(v.name), "begin": round(v.begin, DIGITS), "end": round(v.end, DIGITS)}
        for v in stop_visits(front, row, executed=True)
    ]


def licence() -> str:
    """Return the licence text of three.js, which is part of the page."""
    return resources.files("hpop.view").joinpath("web", "three_license.txt").read_text(encoding="utf-8")


def _label(front: Front, row: NamedRow) -> str:
    """Return the number and the names of a row as text, such as "row 70: knee, least turns"."""
    names = [name for name, point in front.named().items() if point.index == row.number]
    return f"row {row.number}" + (f": {printable(', '.join(names))}" if names else "")
