"""Examples that come with hpop: scenarios with their maps and robots, which need no other files.

``hpop.examples.museum()`` is the problem of the museum tour; :func:`path` returns the path of a file, and
:func:`copied` copies a scenario with its files to a folder. ``hpop demo`` plans one.

>>> import hpop
>>> hpop.examples.museum().start
(2.0, 10.0, 0.0)
>>> hpop.examples.path("museum.geojson").name
'museum.geojson'
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hpop.errors import OutputError, unknown_name

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

HERE = Path(__file__).parent
ARM = ("arm/arm6.urdf", "arm/arm6.srdf")
SCENARIOS = {
    "museum": ("museum.yaml", "museum.geojson"),
    "live": ("live.yaml", "museum.geojson"),
    "museum_planners": ("museum_planners.yaml", "museum.geojson"),
    "arm_shelf": ("arm_shelf.yaml", *ARM),
    "mobile_arm": ("mobile_arm.yaml", *ARM),
    "passenger": ("car_park.yaml",),
}
"""Files of each scenario, by its name; the scenario file is the first."""


def museum() -> Problem:
    """Return the problem of the museum tour: 30 x 20 m, a two-wheeled robot; obstruction, turns and length as costs."""
    from hpop.scenario import load_scenario  # start-up time: pydantic

    return load_scenario(path("museum.yaml")).problem


def path(file: str) -> Path:
    """Return the path of an example's file, such as ``museum.geojson`` or ``arm/arm6.urdf``; UnknownName for others."""
    known = sorted({file for files in SCENARIOS.values() for file in files})
    if file not in known:
        raise unknown_name("example file", file, known)
    return HERE / file


def copied(name: str, folder: Path) -> Path:
    """Copy a scenario with its files to a folder, and return the path of the copied scenario.

    The folder is created if missing, and equal files may exist already. Raises OutputError if a different file exists,
    which may be the user's work, or if files cannot be written; UnknownName for an unknown scenario.
    """
    if name not in SCENARIOS:
        raise unknown_name("example", name, SCENARIOS)
    try:
        for file in SCENARIOS[name]:
            target, content = folder / file, (HERE / file).read_bytes()
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(content)
            elif target.read_bytes() != content:
                raise OutputError(
                    f"{target} exists and differs from the example, so it is not overwritten; choose another folder"
                )
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}; choose another folder") from None
    return folder / SCENARIOS[name][0]
