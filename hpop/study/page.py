"""Pages of a study: stimuli, which show a trajectory and reveal nothing else, and the session page of a participant.

A stimulus is a page in one file that rides once along an executed trajectory, from rest to rest. It shows the letter of
its condition, but no other name, number or map, and no controls except the start. It ends by itself, and reports to the
surrounding page how smoothly it was drawn. Alternatively it is a 360 degree video, with a page that plays it around the
viewer; a headset's own player can show it as well.

A session page has consent, forms, rides, rests and comparisons, in one self-contained file. It contains the public part
of the design, the stimuli, and paths on a map, which are hidden until the participant asks for them. It records events.
Opened as a file, it stores the events and offers them for download; served by `hpop.study.server`, it sends each event
at once.
"""

from __future__ import annotations

import base64
import os
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.files import read_regular, replacing
from hpop.base.options import real
from hpop.base.text import shown
from hpop.errors import OutputError, StudyError
from hpop.frontier.strict_json import parse
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.limits import Progress, ProgressCallback, progress_callback
from hpop.study.documents import STIMULI, Words, words
from hpop.study.factors import Level, Levels, shown_part
from hpop.study.protocol import STOP_RULE
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ride.page import licence, links_of, solids_not_upright, track
from hpop.view.ride.scene import ViewScene
from hpop.view.ride.video import save_video
from hpop.view.single_page import single_page

STIMULUS_SCHEMA, STIMULUS_VERSION = "hpop-stimulus", 1
LETTER = re.compile(r"[A-Z]")
SHORTEST, LONGEST = 1.0, 3600.0
"""Shortest and longest duration of a still view, s."""
SAID = ("ride_begin", "ride_headset", "ride_about", "view_about", "ride_over", "ride_failed", "stop")


class StimulusCondition(Protocol):
    """Interface of a condition, with what its stimulus needs.

    id        its letter
    row       row of the front; None for the still view, a live session and baselines
    kind      "ride", "view", "video", or "live" or "robot", which have no stimulus
    duration  s, of a still view
    factors   level by factor (:mod:`hpop.study.factors`)
    """

    @property
    def id(self) -> str: ...
    @property
    def row(self) -> int | None: ...
    @property
    def kind(self) -> str: ...
    @property
    def duration(self) -> float: ...
    @property
    def factors(self) -> Mapping[str, Level]: ...


@checked_arguments
def save_stimuli(
    problem: Problem,
    front: Front,
    conditions: Iterable[StimulusCondition],
    folder: str | os.PathLike[str],
    *,
    baselines: Mapping[str, Trajectory] | None = None,
    language: str = "en",
    study: Path | None = None,
    progress: ProgressCallback | bool | None = None,
) -> dict[str, Path]:
    """Write the stimulus of each condition to a folder, created if missing, and return the files by letter.

    Each stimulus is a page, ``A.html``; 360 degree videos also have ``A.mp4``, which the page plays, and need
    hpop[video]; for them, the returned file is the video. Conditions of the kinds "live" and "robot" have no stimulus.

    Parameters
    ----------
    baselines : by letter, the trajectories of conditions that are not rows of the front
    study : a study's folder, with texts in further languages
    progress : for videos: True shows a line in the terminal; a function is called with each frame

    Raises StudyError for invalid or repeated letters and for a missing baseline, OutputError if a file cannot be
    written.
    """
    target, written = Path(folder), dict[str, Path]()
    said = words(language, study)
    conditions = [condition for condition in conditions if condition.kind not in ("live", "robot")]
    videos = [condition.id for condition in conditions if condition.kind == "video"]
    for condition in conditions:
        name = condition.id
        if not LETTER.fullmatch(name) or name in written:
            raise StudyError(f"the id of a condition must be a capital letter, used only once, got {shown(name)}")
        trajectory = _condition_trajectory(front, condition, baselines or {})
        if condition.kind == "video":
            which = f"video {name}, {videos.index(name) + 1} of {len(videos)}:"
            written[name] = _save_video(problem, trajectory, target / f"{name}.mp4", which, progress)
        if condition.kind == "view":
            page = view_page(problem, trajectory, name, condition.duration, said=said, language=language)
        else:
            video = f"{STIMULI}/{name}.mp4" if condition.kind == "video" else None
            how: dict[str, Any] = {"levels": dict(condition.factors), "video": video, "language": language}
            page = ride_page(problem, trajectory, name, said=said, **how)
        path = target / f"{name}.html"
        try:
            target.mkdir(parents=True, exist_ok=True)
            with replacing(path) as file:
                file.write(page.encode())
        except OSError as error:
            raise OutputError(
                f"the stimulus cannot be written to {path}: {error.strerror or error}; choose another folder"
            ) from None
        written.setdefault(name, path)
    return written


def _condition_trajectory(
    front: Front, condition: StimulusCondition, baselines: Mapping[str, Trajectory]
) -> Trajectory:
    """Return the trajectory that a condition shows; for the still view any one, since all begin at the start."""
    if condition.row is None and condition.kind != "view":
        if condition.id not in baselines:
            raise StudyError(
                f"stimulus {condition.id} is a baseline, not a row of the front: give its trajectory, as "
                f"save_stimuli(..., baselines={{{condition.id!r}: trajectory}})"
            )
        return baselines[condition.id]
    return front.trajectories[condition.row or 0]


def _save_video(
    problem: Problem, trajectory: Trajectory, path: Path, which: str, progress: ProgressCallback | bool | None
) -> Path:
    """Write a video, and remove its JSON file, which would reveal the costs.

    Progress messages begin with ``which``.
    """
    with progress_callback(progress) as told:

        def tell(done: Progress) -> None:
            if told is not None:
                told(replace(done, detail=f"{which} {done.detail}"))

        save_video(problem, trajectory, path, progress=tell)
    path.with_name(f"{path.name}.json").unlink()
    return path


def ride_page(
    problem: Problem,
    trajectory: Trajectory,
    name: str,
    *,
    said: Words | None = None,
    levels: Levels | None = None,
    video: str | None = None,
    language: str = "en",
) -> str:
    """Return the HTML of a page that rides along a trajectory once; ``name`` is the condition's letter.

    levels  level by factor
    video   address of a 360 degree video of the ride, which is played in place of the scene; None for the scene
    language  language code of the texts ``said``
    """
    shown_by = {**shown_part(levels or {}, trajectory, still=False), "video": video}
    return _page(problem, trajectory, name, {**track(trajectory), "shown": shown_by}, (language, said), is_still=False)


def view_page(
    problem: Problem,
    trajectory: Trajectory,
    name: str,
    seconds: float,
    *,
    said: Words | None = None,
    language: str = "en",
) -> str:
    """Return the HTML of a page that shows the still view at the start of a trajectory for some seconds.

    language  language code of the texts ``said``
    """
    duration = real("seconds", seconds, SHORTEST, LONGEST, "seconds of a still view")
    ridden = track(trajectory)
    still = {part: _held(ridden[part]) for part in ("positions", "quaternions", "links")}
    seen = {"duration": duration, "rate": 1.0 / duration, **still}
    return _page(problem, trajectory, name, seen, (language, said), is_still=True)


def _held(packed: dict[str, Any]) -> dict[str, Any]:
    """Return packed values that decode to the first of the given values twice, for a still view.

    Packing stores second differences, so the two samples (v, v) are stored as (v, -v).
    """
    return {"scale": packed["scale"], "columns": [[column[0], -column[0]] for column in packed["columns"]]}


def _page(
    problem: Problem,
    trajectory: Trajectory,
    name: str,
    ridden: dict[str, Any],
    spoken: tuple[str, Words | None],
    *,
    is_still: bool,
) -> str:
    """Return the HTML of a stimulus page; ``spoken`` is the language and its texts, None for the English ones."""
    language, said = spoken
    scene = ViewScene.of(problem)
    fov = problem.model.field_of_view
    texts = words("en") if said is None else said
    shown_by = ridden.pop("shown", None)
    payload = {
        "schema": STIMULUS_SCHEMA,
        "version": STIMULUS_VERSION,
        "name": name,
        "still": is_still,
        "scene": _without_names(scene.description()),
        "solids": solids_not_upright(scene),
        "links": links_of(trajectory.model, trajectory.states),
        "field_of_view": None if fov is None else list(fov),
        "track": {"name": name, "label": "", "rates": None, "costs": [], **ridden},
        "shown": shown_by,
        "words": {key: texts[key] for key in SAID},
        "licence": licence(),
    }
    may_play = shown_by is not None and shown_by["video"] is not None
    return single_page("ride.js", name, payload, connect="'self'" if may_play else "'none'", language=language)


def _without_names(scene: dict[str, Any]) -> dict[str, Any]:
    """Return a scene without names and notes, except the names that landmarks show on their plates."""
    bare = {kind: [{**thing, "name": ""} for thing in scene[kind]] for kind in ("prisms", "people", "zones")}
    return {**scene, **bare, "notes": []}


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
    """Read the pages of a study's stimuli from its folder; a stimulus that is a video may be without a page.

    Raises StudyError if the page of another stimulus is missing, or if a page was not written by hpop, was written for
    a stimulus with another letter, or was made by another version of hpop than the others.
    """
    found: dict[str, Ride] = {}
    for place in public["places"]:
        page = (folder / place["stimulus"]).with_suffix(".html")
        if place["kind"] in ("ride", "view") or (place["kind"] == "video" and page.is_file()):
            found[place["condition"]] = _ride(page, place["condition"])
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
        STIMULUS_SCHEMA,
        STIMULUS_VERSION,
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
