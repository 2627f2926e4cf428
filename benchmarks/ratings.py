"""Hold hpop's criteria against published ratings of people.

    python benchmarks/ratings.py --out FILE

Computes every criterion for the conditions of published studies that can be rebuilt, and compares their order
with the order of people's ratings. Prints the tables of docs/ratings.md and writes them as JSON.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any

import shapely
from scipy.stats import spearmanr

import hpop
from hpop.base import registry
from hpop.errors import HpopError

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
LENGTH = 20.0  # m, of a ride along a wall


@dataclass(frozen=True)
class Comparison:
    """Conditions of one published study, and how people rated them.

    ratings  by what was rated: a value or rank for each condition, in the order of the paths; larger is worse
    """

    study: str
    problem: hpop.Problem
    paths: dict[str, hpop.Trajectory]
    ratings: dict[str, tuple[float, ...]]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row a criterion that differs between the conditions: its costs, and its rank correlations."""
        table = []
        own = registry.criteria.own()  # of the user, and of tests
        for name in sorted(set(registry.criteria) - set(own)):
            if any(f.default is f.default_factory is MISSING for f in fields(registry.criteria[name])):
                continue  # needs a target or a file
            try:
                costs = {k: self.problem.evaluate(path, also=[name])[name] for k, path in self.paths.items()}
            except HpopError:
                continue  # needs people, landmarks, zones or joints, which this world or robot lacks
            values = [round(cost, 9) for cost in costs.values()]
            if min(values) < max(values):
                ranks = {k: float(spearmanr(values, rated).statistic) for k, rated in self.ratings.items()}
                table.append({"criterion": name, **costs, **ranks})
        return table


def museum(runs: int = 100, step: float = 0.25) -> Comparison:
    """Return the three paths of the paper's study, planned in the museum of the examples."""
    problem = tour()
    front = problem.solve(planner="lattice", step=step)
    paths = {
        "least turns": front.lexicographic(["turns", "length"]).item,
        "shortest": front.lexicographic(["length", "turns"]).item,
        "RRT": problem.solve(planner="rrt", runs=runs, seed=1).best("length").item,
    }
    ratings = {"sickness (SSQ)": (9.35, 14.96, 20.57), "discomfort": (1.0, 2.0, 3.0), "dislike": (2.0, 1.0, 3.0)}
    return Comparison("Becerra et al. 2020", problem, paths, ratings)


def tour() -> hpop.Problem:
    """Return the problem of the museum's tour."""
    world = hpop.World.from_geojson(EXAMPLES / "museum.geojson")
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    return hpop.Problem(world, robot, (2.0, 10.0, 0.0), (28.0, 17.0, 0.0), ["turns", "length"])


def unwound(step: float = 0.25) -> Comparison:
    """Return the shortest tour of the museum with a picture that turns with the robot, and with one that does not."""
    problem = tour()
    fixed = problem.solve(planner="lattice", step=step).lexicographic(["length", "turns"]).item
    still = replace(fixed, model=hpop.ViewModel(fixed.model))
    rated = {"sickness, discomfort": (2.0, 1.0)}
    return Comparison("Suomalainen et al. 2022", problem, {"coupled": fixed, "unwound": still}, rated)


def distances() -> Comparison:
    """Return straight rides along a wall, at three distances from it."""
    world = hpop.World.from_polygons([shapely.box(-10, -1, LENGTH + 10, 0)], extent=shapely.box(-10, -1, 30, 9))
    model = hpop.DifferentialDrive(radius=0.2, camera_height=1.2)
    problem = hpop.Problem(world, model, (0.0, 1.0, 0.0), (LENGTH, 1.0, 0.0), ["length"])
    paths = {f"{y:g} m": hpop.Trajectory.from_poses(model, [(0.0, y, 0.0), (LENGTH, y, 0.0)]) for y in (0.5, 1.0, 2.0)}
    return Comparison("Suomalainen et al. 2021", problem, paths, {"discomfort": (3.0, 2.0, 1.0)})


def turn_rates() -> Comparison:
    """Return one path with a turn of 90 degrees, driven with three turn rates."""
    paths, poses = {}, [(0.0, 0.0, 0.0), (5.0, 0.0, math.pi / 2), (5.0, 5.0, math.pi / 2)]
    for rate in (0.5, 1.0, 2.0):
        model = hpop.DifferentialDrive(radius=0.2, camera_height=1.2, turn_rate=rate, turn_acceleration=10.0)
        paths[f"{rate:g} rad/s"] = hpop.Trajectory.from_poses(model, poses)
    world = hpop.World.from_polygons([shapely.box(-5, -5, 9, -4)], extent=shapely.box(-5, -5, 9, 9))
    problem = hpop.Problem(world, model, poses[0], poses[-1], ["length"])
    return Comparison("Widdowson et al. 2019", problem, paths, {"conflict": (3.0, 2.0, 1.0)})


def table(comparison: Comparison) -> str:
    """Return the rows of a comparison as a table in Markdown."""
    ranked = len(comparison.ratings) * (
        len(comparison.paths) > 2
    )  # a correlation of two values says only which is larger
    names = ["criterion", *comparison.paths, *list(comparison.ratings)[:ranked]]
    lines = ["| " + " | ".join(names) + " |", "|---" * len(names) + "|"]
    for row in comparison.rows():
        lines.append("| " + " | ".join(v if isinstance(v, str) else f"{v:.3g}" for v in (row[n] for n in names)) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print all tables, and write them as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/ratings.json"), help="JSON file")
    parser.add_argument("--runs", type=int, default=100, help="runs of the RRT; the paper had 1000")
    arguments = parser.parse_args()
    comparisons = [museum(arguments.runs), unwound(), distances(), turn_rates()]
    for each in comparisons:
        print(f"\n{each.study}\n\n{table(each)}")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [{"study": each.study, "ratings": each.ratings, "rows": each.rows()} for each in comparisons]
    arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
