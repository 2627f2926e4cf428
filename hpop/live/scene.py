"""Message "scene" of a live session: map, robot, criteria and names, which never change during it."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import shapely

from hpop.base.text import printable, shown
from hpop.errors import OptionError
from hpop.motions import Model
from hpop.problems.problem import Problem
from hpop.view.ride.page import licence, links_of, solids_not_upright
from hpop.view.ride.scene import ViewScene
from hpop.view.style import label

ROUND = 8
"""Corners of a quarter of a rounded outline."""


WHEP = "whep+"
"""What begins the address of a camera that speaks WHEP (WebRTC), before http or https."""
HOST = re.compile(r"[A-Za-z0-9.-]+|\[[0-9A-Fa-f:.]+\]")


def video_origin(url: str) -> str:
    """Return the origin of a video's address, such as "http://robot:8080"; "" for no address.

    The address of a camera that speaks WHEP begins with `WHEP`. OptionError for an invalid address.
    """
    if not url:
        return ""
    try:
        parts = urlsplit(url.removeprefix(WHEP))
        host = parts.netloc.rpartition(":")[0] if parts.port is not None else parts.netloc
    except ValueError:  # an invalid port
        parts, host = urlsplit(""), ""
    if parts.scheme not in ("http", "https") or not HOST.fullmatch(host) or not (url.isascii() and url.isprintable()):
        raise OptionError(
            "video must be the address of a camera's MJPEG stream, such as http://robot:8080/stream, or of WHEP, such "
            f"as whep+http://robot:8889/camera/whep, got {shown(url)}"
        )
    return f"{parts.scheme}://{parts.netloc}"


def scene_of(problem: Problem, title: str) -> dict[str, Any]:
    """Return the map, the robot and the criteria as JSON, for the page; without role, settings and video."""
    seen, model = ViewScene.of(problem), problem.model
    state = model.space.state(problem.start)
    base, camera = model.pose("base", state), model.pose("camera", state)
    ahead = np.hypot(np.asarray(camera.x) - base.x, np.asarray(camera.y) - base.y)
    fov = model.field_of_view
    return {
        "type": "scene",
        "title": printable(title),
        "scene": seen.description(),
        "solids": solids_not_upright(seen),
        "links": links_of(model, state),
        "field_of_view": None if fov is None else list(fov),
        "criteria": [
            {
                "name": printable(c.name),
                "label": label(c.name, c.unit, c.unit == "1" and c.quantum == 1.0, c.quantity),
                "unit": printable(c.unit),
            }
            for criterion in problem.criteria
            for c in (criterion, criterion.integral)  # ways may cost the integral that stands in for a mean
            if c is not None
        ],
        "regions": _regions(problem),
        "landmarks": [
            {"name": printable(mark.name), "x": mark.x, "y": mark.y, "z": mark.z}
            for mark in problem.world.content.landmarks
        ],
        "outline": outline_of(model),
        "camera": {"x": float(np.ravel(ahead)[0]), "z": float(np.ravel(camera.z)[0])},
        "video": "",
        "explorer": "",
        "licence": licence(),
    }


def outline_of(model: Model) -> list[list[float]]:
    """Return the corners (x, y), m, of the convex hull of the robot's outline, in the frame of its base."""
    parts = [
        shapely.buffer(shapely.MultiPoint(p.swept.corners).convex_hull, p.radius, quad_segs=ROUND)
        for p in model.platform
    ]
    hull = shapely.convex_hull(shapely.union_all(parts))
    corners: list[list[float]] = np.round(shapely.get_coordinates(hull)[:-1], 3).tolist()
    return corners


def _regions(problem: Problem) -> list[dict[str, Any]]:
    """Return the named zones of the map and the named obstacles, as JSON."""
    zones = [(zone.name, zone.area, zone.kind) for zone in problem.world.content.zones if zone.name]
    things = [(obstacle.name, obstacle.polygon, "obstacle") for obstacle in problem.world.obstacles if obstacle.name]
    return [
        {
            "name": printable(name),
            "kind": kind,
            "corners": np.round(shapely.get_coordinates(shapely.get_exterior_ring(part))[:-1], 3).tolist(),
        }
        for name, area, kind in (*zones, *things)
        for part in shapely.get_parts(area)
        if part.geom_type == "Polygon"
    ]
