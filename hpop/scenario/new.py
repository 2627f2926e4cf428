"""First scenario for a map: start and goal are far apart in free space, and comments explain each key."""

from __future__ import annotations

import inspect
import math
import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import yaml

from hpop.base.files import read_regular
from hpop.base.options import Degrees
from hpop.base.registry import make_model, readers
from hpop.base.text import argument, shown
from hpop.errors import NOTE, MapError, OptionError, QueryError, meant_file
from hpop.planners.needs import FreeMap, elsewhere
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status, no_path_note
from hpop.scenario.json_schema import LINE
from hpop.world import World
from hpop.world.readers.readers import map_beside, reader_of

SCHEMA = "scenario.schema.json"
MOST_BYTES = 2**20  # largest part of a file that is examined
RESOLUTION = {"image": "resolution", "movingai": "resolution", "geojson": "scale", "dxf": "scale", "pdf": "scale"}
"""Name of the option that gives metres per pixel, cell or unit, by reader."""
STEPS = ((40.0, 0.25), (120.0, 0.5), (math.inf, 1.0))
"""Steps of the lattice, m, each with the longest side of a map, m, up to which it is used."""
LONGEST = 10.0  # time limit of each attempt to plan, s
MOST_MEMORY = 2 * 10**9  # bytes
ROOM = (0.0, 0.5, 1.0)
"""Enlargements of the robot, in steps of the lattice, with which start and goal are chosen, one after the other."""


class GivenMap(NamedTuple):
    """Map file, with the name of its reader and the reader's options."""

    path: Path
    reader: str
    options: dict[str, Any]

    @classmethod
    def of(cls, path: Path, reader: str | None, resolution: float | None, options: Mapping[str, Any]) -> GivenMap:
        """Return a map with the named reader, or else the reader for the file's ending.

        Raises MapError if the file is missing, OptionError if a resolution is needed or does not apply.
        """
        if not path.exists():
            raise MapError(f"{path}: no such file; give the path of a map, or of a scenario (YAML).{meant_file(path)}")
        reader = reader or reader_of(path)
        key = RESOLUTION.get(reader)
        given = dict(options)
        if resolution is not None and key is None:
            raise OptionError(
                f"reader {reader!r} takes no --resolution, because its files state their scale; leave it out"
            )
        if resolution is not None and key is not None:
            given = {key: resolution, **given}
        if reader == "image" and "resolution" not in given:
            raise OptionError(
                f"{path} does not state its scale; give --resolution, metres per pixel: 0.02 if a door of 0.9 m is 45 "
                f"pixels wide{map_beside(path)}"
            )
        return cls(path, reader, given)

    def read(self) -> World:
        """Read the world. If a MapError names an option of the reader, its message also says how to set it by --set."""
        try:
            return World.from_file(self.path, reader=self.reader, **self.options)
        except MapError as error:
            said = str(error)
            example = self.proposed(said)
            if not example:
                _, *options = inspect.signature(readers[self.reader]).parameters
                options.sort(key=lambda name: repr(name) not in said)
                named = [name for name in options if re.search(rf"\b{name}\b", said)]  # first the one that may be meant
                example = f"--set {named[0]}=VALUE" if named else ""
            stop = "" if said.endswith((".", "?")) else "."
            advice = f"{stop} Set options of the reader by --set, such as {example}." if example else ""
            raise MapError(said + advice) from None

    def proposed(self, note: str) -> str:
        """Return the options of this reader that a note gives as ``name: value``, as the command line takes them.

        >>> GivenMap(Path("plan.png"), "image", {}).proposed("to make them obstacles, give threshold: 0.68")
        '--set threshold=0.68'
        """
        names = "|".join(inspect.signature(readers[self.reader]).parameters)
        found = dict(re.findall(rf"\b({names}): ([\w.+-]*\w)", note))
        return " ".join(f"--set {name}={argument(value)}" for name, value in found.items())


class Draft(NamedTuple):
    """Problem of a first scenario, with the lattice that plans it.

    problem the problem that is planned
    step    m, step of the lattice
    status  status and reason if no path was found, else None
    middle  m, position at half the duration of a shortest path; the start if no path was found
    """

    problem: Problem
    step: float
    status: tuple[Status, str] | None
    middle: tuple[float, float]


def is_scenario(path: Path) -> bool:
    """Return whether a file is a scenario rather than a map, judged by its keys; a missing YAML file counts as one."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        return False
    try:
        text = read_regular(path, MOST_BYTES)
    except OSError:
        return not path.exists()  # a missing YAML file is reported as a missing scenario
    return re.search(rb"(^|^\s*\{|,)\s*[\"']?(world|criteria|start|planner)[\"']?\s*:", text, re.MULTILINE) is not None


def first_draft(world: World, radius: float | None, start: str | None = None, goal: str | None = None) -> Draft:
    """Return a problem for a round robot, with a lattice that plans it; a missing start or goal is chosen far away.

    If no lattice finds a path, another start or goal is chosen that wider passages connect. If that fails too, the
    first choice is returned, with the status of its search. Raises as `first_problem`.
    """
    first: Draft | None = None
    for room in ROOM:
        problem = first_problem(world, radius, start, goal, room=room * _usual_step(world))
        if problem is None or (first is not None and _ends(problem) == _ends(first.problem)):
            continue
        draft = _planned(problem)
        if draft.status is None:
            return draft
        first = first or draft
        if start is not None and goal is not None:
            break
    assert first is not None  # room 0 raises if there is none
    return first


def first_problem(
    world: World, radius: float | None, start: str | None = None, goal: str | None = None, *, room: float = 0.0
) -> Problem | None:
    """Return a problem for a round robot from start to goal; if one is missing, it is chosen far from the other.

    Start and goal are in one connected part of the free space of a robot whose radius is larger by ``room`` (m); the
    result is None if there is no such part. Raises MapError if the robot fits nowhere, QueryError for a blocked start
    or goal.
    """
    model: Any = make_model({"differential_drive": {} if radius is None else {"radius": radius}})
    free = FreeMap.of(replace(model, radius=model.radius + room), world)
    begin, end = (None if text is None else _end(text, what) for text, what in ((start, "start"), (goal, "goal")))
    asked = begin or end
    if free is None or not free.main:
        if room:
            return None
        raise _free_nowhere(model, world)
    part = free.part_at(*asked[:2]) if asked else 0
    if room and asked and not part:
        return None
    far = free.far_apart(part)
    first, last = (_rounded(model, world, place) for place in far)
    if asked is not None and math.dist(asked[:2], first if begin else last) > math.dist(
        asked[:2], last if begin else first
    ):
        first, last = last, first  # so that the chosen one is far from the given one
    heading = math.radians(_heading(first, last))
    problem = Problem(
        world, model, begin or (*first, heading), end or (*last, None), ["obstruction", "turns", "length"]
    )
    collision = model.collision(world)
    for what, values in (("start", problem.start), ("goal", problem.goals[0])):
        state = model.space.state(values, free=model.space.angles)
        if reason := collision.why_blocked(model.space.state([value or 0.0 for value in values])):
            raise QueryError(f"the {what} is not usable: {reason}.{elsewhere(model, world, state)}")
    return problem


def _free_nowhere(model: Any, world: World) -> MapError:
    """Return the error for a map on which the robot fits nowhere, with possible causes."""
    x0, y0, x1, y1 = world.bounds
    error = MapError(
        f"a robot of {model.radius:g} m in radius is free nowhere on this map of {x1 - x0:.4g} x {y1 - y0:.4g} m; "
        "check the map's scale (--resolution), and whether the outline of the building is read as an obstacle (--set "
        "polygons=outline); or give a smaller robot by --radius"
    )
    for note in world.notes:
        error.add_note(f"{NOTE}{note}")
    return error


def scenario_text(given: GivenMap, draft: Draft, folder: Path, name: str, *, chosen: bool) -> str:
    """Return the text of a scenario file, with comments, to be saved as ``name`` in ``folder``.

    ``chosen`` says that hpop chose start and goal automatically; a comment then says so.
    """
    problem, step = draft.problem, draft.step
    path, robot = os.path.relpath(given.path, folder), cast(Any, problem.model)
    world = yaml.safe_dump(
        {"path": path, **given.options}, default_flow_style=True, sort_keys=False, width=10**6
    ).strip()
    x0, y0, x1, y1 = problem.world.bounds
    start, goal = (_written(values) for values in (problem.start, problem.goals[0]))
    why = "; start and goal were chosen far apart: put them where you need them" * chosen
    file, out = argument(name), argument(Path("out", Path(name).stem))
    return f"""\
{LINE.format(SCHEMA)}
# Look at it: hpop look {file}        Plan: hpop plan {file} --out {out}
# What the words mean: hpop explain lattice, hpop explain obstruction, and so on.
world:                          # x from {x0:.4g} to {x1:.4g} m, y from {y0:.4g} to {y1:.4g} m
  {given.reader}: {world}
model:                          # the robot; hpop models lists others
  differential_drive:
    radius: {robot.radius:g}                 # m, of the robot as seen from above
    camera_height: {robot.camera_height:g}          # m, of the camera above the floor
    # field_of_view: [90 deg, 60 deg]   # what the camera sees at once; without it, all round
start: {start}      # x m, y m, heading{why}
goal: {goal}        # any: the heading at the goal is free
criteria:                       # costs to minimise, all at once; hpop criteria lists others
  - obstruction                 # walls and furniture within 2 m of the camera
  - turns                       # number of turns in place
  # - stops_missed              # number of optional stops of a tour that are skipped
  - length                      # of the path, m
planner:                        # hpop planners lists others
  lattice: {{step: {step:g}}}         # m between positions: a smaller step finds better paths, and takes longer
# people:                       # people who stand or walk, for criteria such as personal_space
#   - {{x: {problem.start[0]:.1f}, y: {problem.start[1]:.1f}, yaw: 90 deg, name: Ada}}
# landmarks:                    # points worth seeing, for stops, and criteria such as landmark_blindness
#   - {{x: {problem.goals[0][0]:.1f}, y: {problem.goals[0][1]:.1f}, name: door}}
# tour:                         # stops on the way, in any order, for 10 s each
#   order: any
#   stops:
#     - {{at: [{draft.middle[0]:.1f}, {draft.middle[1]:.1f}], within: 1.0, dwell: 10, name: hall}}   # a place
#     - {{landmark: door, within: 3.0, dwell: 10, optional: true}}   # seen; may be skipped
"""


def _ends(problem: Problem) -> tuple[Any, ...]:
    """Return the start and the goals of a problem."""
    return problem.start, *problem.goals


def _usual_step(world: World) -> float:
    """Return the usual step of a lattice, m, for a map of this size."""
    x0, y0, x1, y1 = world.bounds
    return next(step for side, step in STEPS if max(x1 - x0, y1 - y0) <= side)


def _planned(problem: Problem) -> Draft:
    """Plan a shortest path with the usual step, then half and a quarter of it, until a path is found.

    Returns the draft with this step; or, if no path was found, with the usual step and the reason.
    """
    step = _usual_step(problem.world)
    length = next(one for one in problem.criteria if one.name == "length")
    shortest = replace(problem, criteria=(length,))
    status = Status.NO_PATH, ""
    for some in (step, step / 2, step / 4):
        front = shortest.solve("lattice", step=some, time_limit=LONGEST, max_memory=MOST_MEMORY)
        if len(front):
            trajectory = front.trajectories[0]
            middle = trajectory.at(np.array([0.5 * trajectory.duration]))
            return Draft(problem, some, None, (float(middle.x[0]), float(middle.y[0])))
        why = no_path_note(front.notes) or str(front.status)
        is_closed = front.status == Status.NO_PATH
        status = (Status.NO_PATH if is_closed else Status.TIME_LIMIT), why.removeprefix(f"{Status.NO_PATH}: ")
    x, y, _ = problem.start
    return Draft(problem, step, status, (x, y))


def _written(values: Any) -> str:
    """Return a state as a scenario file writes it, with the heading in degrees."""
    x, y, yaw = values
    heading = "any" if yaw is None else f"{math.degrees(yaw):.4g} deg"
    return f"[{x:.6g}, {y:.6g}, {heading}]"


def _end(text: str, what: str) -> tuple[float, float, float | None]:
    """Parse a start or goal from the command line: X,Y in m or X,Y,HEADING, in rad or as text such as "90 deg".

    Return the heading in rad. Without one it is 0 at the start, and None (any heading) at the goal.
    """
    x, y, *rest = [*(part.strip() for part in text.split(",")), ""]
    heading: Any = Degrees.in_radians(rest[0]) if rest and rest[0] else "any" if what == "goal" else 0.0
    try:
        place = float(x), float(y)
        yaw = None if heading == "any" and what == "goal" else float(heading)
        if len(rest) > 2 or not all(map(math.isfinite, place)):
            raise ValueError
    except ValueError:
        raise OptionError(
            f"expected --{what} X,Y in m, or X,Y,HEADING with a heading in rad or such as '90 deg', got {shown(text)}"
        ) from None
    return (*place, yaw)


def _rounded(model: Any, world: World, place: tuple[float, float]) -> tuple[float, float]:
    """Round a position, m, to the fewest decimals, 1 to 3, at which it is free; return it unchanged if none works."""
    collision = model.collision(world)
    for digits in (1, 2, 3):
        x, y = (round(value, digits) for value in place)
        if collision.clear(np.array([x]), np.array([y]))[0]:
            return x, y
    return place


def _heading(start: tuple[float, float], goal: tuple[float, float]) -> float:
    """Return the heading from start to goal, in degrees, rounded to a multiple of 45."""
    return 45.0 * round(math.degrees(math.atan2(goal[1] - start[1], goal[0] - start[0])) / 45.0) % 360.0


def checked_options(pairs: Mapping[str, str]) -> dict[str, Any]:
    """Parse the values of a reader's options as YAML; raise OptionError for invalid ones."""
    found = {}
    for name, text in pairs.items():
        try:
            found[name] = yaml.safe_load(text)
        except yaml.YAMLError:
            raise OptionError(
                f"--set {name}: expected a value such as 0.05, outline or [1, 2], got {shown(text)}"
            ) from None
    return found
