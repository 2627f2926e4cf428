"""Stimuli of a study: pages or videos that show a trajectory and reveal nothing else about it.

A stimulus is a page in one file that rides once along an executed trajectory, from rest to rest. It shows the letter of
its condition, but no other name, number or map, and no controls except the start. It ends by itself, and reports to the
surrounding page how smoothly it was drawn. Alternatively it is a 360 degree video for a headset's own player.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.options import real
from hpop.base.text import shown
from hpop.errors import OutputError, StudyError
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.status import Progress, ProgressCallback, progress_callback
from hpop.study.words import Words, words
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ride.page import licence, links_of, tilted_solids, track
from hpop.view.ride.scene import ViewScene
from hpop.view.ride.video import save_video
from hpop.view.single_page import single_page

SCHEMA, VERSION = "hpop-stimulus", 1
LETTER = re.compile(r"[A-Z]")
SHORTEST, LONGEST = 1.0, 3600.0
"""Shortest and longest duration of a still view, s."""
SAID = ("ride_begin", "ride_headset", "ride_about", "view_about", "ride_over", "ride_failed", "stop")


class StimulusCondition(Protocol):
    """Interface of a condition, with what its stimulus needs.

    id        its letter
    row       row of the front; None for the still view and for baselines
    kind      "ride", "view" or "video"
    duration  s, of a still view
    """

    @property
    def id(self) -> str: ...
    @property
    def row(self) -> int | None: ...
    @property
    def kind(self) -> str: ...
    @property
    def duration(self) -> float: ...


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

    Rides and the still view are pages, ``A.html``; 360 degree videos are ``A.mp4``, and need hpop[video].

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
    conditions = list(conditions)
    videos = [condition.id for condition in conditions if condition.kind == "video"]
    for condition in conditions:
        name = condition.id
        if not LETTER.fullmatch(name) or name in written:
            raise StudyError(f"the id of a condition must be a capital letter, used only once, got {shown(name)}")
        trajectory = _condition_trajectory(front, condition, baselines or {})
        if condition.kind == "video":
            which = f"video {name}, {videos.index(name) + 1} of {len(videos)}:"
            written[name] = _save_video(problem, trajectory, target / f"{name}.mp4", which, progress)
            continue
        if condition.kind == "view":
            page = view_page(problem, trajectory, name, condition.duration, said=said)
        else:
            page = ride_page(problem, trajectory, name, said=said)
        path = target / f"{name}.html"
        try:
            target.mkdir(parents=True, exist_ok=True)
            with replacing(path) as file:
                file.write(page.encode())
        except OSError as error:
            raise OutputError(
                f"the stimulus cannot be written to {path}: {error.strerror or error}; choose another folder"
            ) from None
        written[name] = path
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


def ride_page(problem: Problem, trajectory: Trajectory, name: str, *, said: Words | None = None) -> str:
    """Return the HTML of a page that rides along a trajectory once; ``name`` is the condition's letter."""
    return _page(problem, trajectory, name, track(trajectory), said, is_still=False)


def view_page(problem: Problem, trajectory: Trajectory, name: str, seconds: float, *, said: Words | None = None) -> str:
    """Return the HTML of a page that shows the still view at the start of a trajectory for some seconds."""
    duration = real("seconds", seconds, SHORTEST, LONGEST, "seconds of a still view")
    ridden = track(trajectory)
    still = {part: _held(ridden[part]) for part in ("positions", "quaternions", "links")}
    return _page(
        problem, trajectory, name, {"duration": duration, "rate": 1.0 / duration, **still}, said, is_still=True
    )


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
    said: Words | None,
    *,
    is_still: bool,
) -> str:
    """Return the HTML of a stimulus page."""
    scene = ViewScene.of(problem)
    fov = problem.model.field_of_view
    texts = words("en") if said is None else said
    payload = {
        "schema": SCHEMA,
        "version": VERSION,
        "name": name,
        "still": is_still,
        "scene": _without_names(scene.description()),
        "solids": tilted_solids(scene),
        "links": links_of(trajectory.model, trajectory.states),
        "field_of_view": None if fov is None else list(fov),
        "track": {"name": name, "label": "", "rates": None, "costs": [], **ridden},
        "words": {key: texts[key] for key in SAID},
        "licence": licence(),
    }
    return single_page("ride.js", name, payload)


def _without_names(scene: dict[str, Any]) -> dict[str, Any]:
    """Return a scene without names and notes, except the names that landmarks show on their plates."""
    bare = {kind: [{**thing, "name": ""} for thing in scene[kind]] for kind in ("prisms", "people", "zones")}
    return {**scene, **bare, "notes": []}
