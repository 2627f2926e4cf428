"""Session page of one participant: consent, forms, rides, rests and comparisons, in one self-contained file.

It contains the public part of the design, the stimuli, and paths on a map, which are hidden until the participant asks
for them. It records events. Opened as a file, it stores the events and offers them for download; served by
`hpop.study.server`, it sends each event at once.
"""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.files import read_regular
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.frontier.strict_json import parse
from hpop.study import stimuli
from hpop.study.design_file import STOP_RULE
from hpop.study.words import words
from hpop.view.single_page import single_page

SCHEMA, VERSION = "hpop-session", 1
MOST_BYTES = 64 * 2**20
"""Largest size of a stimulus, in bytes."""
PAYLOAD = re.compile(r'<script type="application/json" id="payload">(.*?)</script>', re.DOTALL)
BUNDLE = re.compile(r'(?<=<script type="text/plain" id="bundle">)[A-Za-z0-9+/=]+(?=</script>)')
SCRIPTS = re.compile(r"script-src ((?:'sha256-[A-Za-z0-9+/]{43}=' ?)+);")
TOLERANCE = 0.05
"""Tolerance, m, of the paths on small maps."""
MOST_WALLS = 2000
"""Most outlines of obstacles on a small map."""


class Ride(NamedTuple):
    """Stimulus page, taken apart so that many session pages can share its script.

    text     of the page, without the bundle
    bundle   its script, deflated, in base64
    scripts  hashes that its policy allows
    payload  its data, JSON of the schema `hpop-stimulus`
    """

    text: str
    bundle: str
    scripts: tuple[str, ...]
    payload: dict[str, Any]


class Rides(NamedTuple):
    """Stimulus pages of a study, shared by the session pages of all participants.

    bundle   script of all stimulus pages, deflated, in base64
    scripts  hashes that their policies allow
    texts    pages without the bundle by letter, deflated, in base64
    plan     extent, walls and paths for the small maps; None if no stimulus is a page
    """

    bundle: str
    scripts: tuple[str, ...]
    texts: dict[str, str]
    plan: dict[str, Any] | None


def rides_of(public: Mapping[str, Any], folder: Path) -> Rides:
    """Read the stimulus pages (rides and still view) in a study's folder.

    Raises StudyError for a file that is missing, is not a stimulus of hpop, has another letter, or was made by another
    version of hpop than the others.
    """
    found: dict[str, Ride] = {}
    for place in public["places"]:
        if place["kind"] != "video":
            found[place["condition"]] = _ride(folder / place["stimulus"], place["condition"])
    bundles = {ride.bundle for ride in found.values()}
    if len(bundles) > 1:
        raise StudyError(f"stimuli in {folder} were made by different versions of hpop; make all of them again")
    return Rides(
        next(iter(bundles), ""),
        tuple(dict.fromkeys(script for ride in found.values() for script in ride.scripts)),
        {name: base64.b64encode(zlib.compress(ride.text.encode(), 9)).decode() for name, ride in found.items()},
        _plan({name: ride.payload for name, ride in found.items()}),
    )


@checked_arguments
def session_page(public: Mapping[str, Any], folder: Path, *, served: bool = False, rides: Rides | None = None) -> str:
    """Return the HTML text of a participant's session page.

    Parameters
    ----------
    public : result of :meth:`Design.public`
    folder : folder of the study, with ``stimuli/``
    served : whether `hpop.study.server` serves the page, which may then connect to it
    rides : result of `rides_of`, shared by several participants

    Raises StudyError for missing or invalid stimuli and texts.
    """
    shown_rides = rides_of(public, folder) if rides is None else rides
    texts = words(public["language"], folder)
    if public["protocol"]["stop_rule"] == STOP_RULE:  # the default text is translated
        protocol = {**public["protocol"], "stop_rule": texts["stop_rule"]}
        public = {**public, "protocol": protocol}
    payload = {
        "schema": SCHEMA,
        "version": VERSION,
        "form": public,
        "words": texts,
        "bundle": shown_rides.bundle,
        "rides": shown_rides.texts,
        "plan": shown_rides.plan,
        "served": served,
    }
    return single_page(
        "study.js",
        public["participant"],
        payload,
        connect="'self'" if served else "'none'",
        frames=shown_rides.scripts,
        language=public["language"],
    )


def _ride(path: Path, name: str) -> Ride:
    """Read a stimulus page from a file; StudyError unless hpop wrote it, for the stimulus with the letter ``name``."""
    try:
        text = read_regular(path, MOST_BYTES).decode()
        payload = parse(PAYLOAD.search(text)[1].encode())  # type: ignore[index]
        (bundle,) = BUNDLE.findall(text)
        scripts = tuple(SCRIPTS.search(text)[1].split())  # type: ignore[index]
    except OSError as error:
        raise StudyError(
            f"the stimulus {path} cannot be read: {error.strerror or error}; write the stimuli again"
        ) from None
    except (ValueError, TypeError, RecursionError):
        raise StudyError(f"{path} is not a stimulus that hpop wrote; write it again") from None
    if not isinstance(payload, dict) or (payload.get("schema"), payload.get("version")) != (
        stimuli.SCHEMA,
        stimuli.VERSION,
    ):
        raise StudyError(f"{path} is not a stimulus of this version of hpop; write it again")
    if payload.get("name") != name:
        raise StudyError(f"{path} shows condition {shown(payload.get('name'))}, not {name}; write the stimuli again")
    return Ride(BUNDLE.sub("", text), bundle, scripts, payload)


def _plan(payloads: Mapping[str, Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the walls and the camera's paths, seen from above, for the small maps; None without rides."""
    if not payloads:
        return None
    scene = next(iter(payloads.values()))["scene"]
    rings = [ring for prism in scene["prisms"] for ring in prism["rings"]]
    if scene["cells"] is not None:
        rings += _cells(scene["cells"])
    corners = np.array([point for polygon in scene["floor"] for ring in polygon for point in ring])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return {
        "extent": [round(float(value), 3) for value in (*low, *high)],
        "walls": [np.round(ring, 2).tolist() for ring in rings[:MOST_WALLS]],
        "ways": {name: _way(payload["track"]["positions"]) for name, payload in payloads.items()},
    }


def _cells(cells: Mapping[str, Any]) -> list[list[list[float]]]:
    """Return the outlines, m, of the occupied boxes of a raster map."""
    boxes = np.array(cells["boxes"], dtype=np.float64)
    together = shapely.union_all(shapely.box(*boxes.T)).simplify(0.5)
    x, y, yaw = cells["origin"]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return [
        (shapely.get_coordinates(ring) * cells["resolution"] @ turn.T + (x, y)).tolist()
        for part in shapely.get_parts(together)
        for ring in (part.exterior, *part.interiors)
    ]


def _way(packed: Mapping[str, Any]) -> list[list[float]]:
    """Return the simplified path, m, seen from above, from the packed positions of a ride."""
    x, y = (np.cumsum(np.cumsum(column)) * packed["scale"] for column in packed["columns"][:2])
    points = np.stack([x, y], axis=1)
    simple = shapely.LineString(points).simplify(TOLERANCE) if len(points) > 1 else shapely.Point(points[0])
    return np.round(shapely.get_coordinates(simple), 2).tolist()  # type: ignore[no-any-return]
