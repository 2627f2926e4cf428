"""Start and goal of a scenario from the planning problem of a road file."""

from __future__ import annotations

from typing import Any

from hpop.scenario.faults import Faults
from hpop.scenario.schema import ScenarioFile
from hpop.world.readers.commonroad import planning_problem

ASKED = "planning_problem"  # as start or goal of a scenario


def with_planning_problem(faults: Faults, given: Any, file: ScenarioFile | None) -> Any:
    """Return a scenario's values with the start and goal of a road's planning problem, where it asks for them.

    Faults of the road file are collected; the values then lack what they asked for.

    given  values of the scenario
    file   the same values, validated; None if they have faults
    """
    asked = [key for key in ("start", "goal") if given.get(key) == ASKED]
    if not asked or file is None:
        return given
    road = file.world.commonroad
    found: dict[str, Any] = {}
    if road is None:
        faults.add((asked[0],), f"{ASKED} needs a road: world: {{commonroad: {{path: road.xml}}}}; or give a state")
    else:
        with faults.collected(("world", "commonroad")):
            problem = planning_problem(faults.beside(road.path), road.planning_problem)
            faults.notes += problem.notes
            goals = [["any" if value is None else value for value in goal] for goal in problem.goals]
            found = {"start": [*problem.start], "goal": goals}
    values = {key: value for key, value in given.items() if key not in asked}
    return values | {key: found[key] for key in asked if key in found}
