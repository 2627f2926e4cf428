"""Are all fronts what they were? Those of the examples and of the benchmarks' instances, kept, or compared.

    python benchmarks/fronts.py --keep FOLDER [NAME ...]       plan, and keep each front as a file
    python benchmarks/fronts.py --against FOLDER [NAME ...]    plan, and compare with the files

Ends with 1 where a front differs. Costs, reported values, states, kinds of motions, status and certificate are compared
for equality, to the last bit; of the front "values" also the cost of every criterion on each of its trajectories
(of those that there were when it was kept).
Instances whose maps are absent are skipped. For changes of structure: keep with the old checkout's hpop (PYTHONPATH),
compare with the new one's.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import re
import runpy
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import any_angle
import criteria
import museums
import numpy as np
from maps import DATA, FOLDERS, ROOT, missing

import hpop
from hpop.base import registry
from hpop.motions import lacking
from hpop.planners import Lattice
from hpop.scenario import load_scenario

REWORDED = {
    r"(?<!,) for \(": ", for (",
    r" of each and ([\d,]+) links of each to states farther away": r" and \1 far links of each",
    r"([\d,]+ splines?), each (proved free of collisions and no worse than its path in \(.*?\)), and "
    r"([\d,]+ paths?)(.*?); local": r"the best of \1 and \3\4; each spline is \2; these are local",
}
"""Words of certificates since 28 November 2026, by patterns of those before."""
TOUR = ["exposure", "turns", "length"]
PLANNERS = {
    "weighted-sum": ("weighted-sum", {"step": 0.5}),
    "any-angle": ("any-angle", {"step": 1.0}),
    "roadmap": ("roadmap", {"samples": 300, "seed": 1}),
    "epsilon-constraint": ("epsilon-constraint", {"step": 1.0}),
    "weighted-sum-corridor": ("weighted-sum-corridor", {"step": 1.0}),
    "smoothing": ("smoothing", {"step": 1.0}),
    "rrt": ("rrt", {"runs": 3, "seed": 1}),
}


def instances() -> dict[str, Callable[[], hpop.Front]]:
    """Return the function that makes each front, by name."""
    made = {name: partial(scenario, f"{name}.yaml") for name in ("museum", "museum_planners", "own_criterion")}
    made |= {name: partial(scenario, f"{name}.yaml") for name in FOLDERS if missing(name) is None}
    made |= {name: partial(solved, name, "lattice", step=museums.CELL) for name in ("m60", "m100", "m160")}
    made |= {f"museum by {name}": partial(toured, planner, **options) for name, (planner, options) in PLANNERS.items()}
    if missing("pal_office") is None:
        made["pal_office by any-angle"] = lambda: any_angle.problems(DATA)["pal_office"].solve("any-angle", step=0.5)
    return made | {"museum eps": approximated, "museum mean": mean, "values": values}


def scenario(name: str) -> hpop.Front:
    """Return the front of an example's scenario; its own criterion is that of example 3."""
    if name == "own_criterion.yaml" and "glare" not in registry.criteria:
        runpy.run_path(str(ROOT / "examples" / "03_own_criterion.py"))
    text = (ROOT / "examples" / name).read_text().replace("../../shared/data", str(DATA))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text.replace("museum.geojson", str(ROOT / "examples" / "museum.geojson")))
        read = load_scenario(path)
    return read.problem.solve(read.planners)


def solved(museum: str, planner: str, **options: float) -> hpop.Front:
    """Return the front of a random museum."""
    return museums.problem(museum).solve(planner, **options)


def toured(planner: str, **options: float) -> hpop.Front:
    """Return the museum tour's front by one planner; the planner of convex programs uses clearance, a convex cost."""
    tour = any_angle.problems(Path(os.devnull))["museum"]
    if planner == "weighted-sum-corridor":
        tour = hpop.Problem(tour.world, tour.model, tour.start, tour.goal, ["clearance", "turns", "length"])
    return tour.solve(planner, **options)


def approximated() -> hpop.Front:
    """Return a front within a hundredth, without stages, whose points depend on how busy the machine is."""
    tour = any_angle.problems(Path(os.devnull))["museum"]
    return tour.front(Lattice(step=0.25, eps=0.01).solve(tour))


def mean() -> hpop.Front:
    """Return a front of an exact time-mean."""
    tour = any_angle.problems(Path(os.devnull))["museum"]
    asked = hpop.Problem(tour.world, tour.model, tour.start, tour.goal, ["obstruction", "turns", "length"])
    return asked.solve("lattice", step=0.5, max_detour=1.2)


def values() -> hpop.Front:
    """Return a front in a furnished museum, with every criterion of hpop reported."""
    furnished = criteria.furnished()
    asked = hpop.Problem(furnished.world, furnished.model, furnished.start, furnished.goal, TOUR)
    few = asked.front(Lattice(step=0.5, eps=0.1).solve(asked))
    known = set(registry.criteria) - {*TOUR, "glare", "stops_missed"}
    names = tuple(name for name in sorted(known) if serves(registry.criteria[name], asked))
    every = hpop.Problem(asked.world, asked.model, asked.start, asked.goal, names)
    reported = np.array([list(every.evaluate(trajectory).values()) for trajectory in few.trajectories])
    return replace(few, reported=reported, reported_names=names, reported_units=("1",) * len(names))


def serves(criterion: type, asked: hpop.Problem) -> bool:
    """Return True if a problem has everything that a criterion needs, such as a target or joints."""
    given = all(field.default is not dataclasses.MISSING for field in dataclasses.fields(criterion))
    return given and not lacking(criterion.requires, asked.model, asked.world)


def reworded(certificate: str) -> str:
    """Return a certificate with the same words in kept and new fronts, where only words have changed."""
    for old, new in REWORDED.items():
        certificate = re.sub(old, new, certificate)
    return certificate


def differences(now: hpop.Front, kept: hpop.Front) -> Iterator[str]:
    """Yield the differences of two fronts."""
    for name in ("names", "status", "certificate"):
        was, is_ = getattr(kept, name), getattr(now, name)
        was, is_ = (reworded(text) if name == "certificate" else text for text in (was, is_))
        if was != is_:
            yield f"{name} was {was!r}, is {is_!r}"
    if now.costs.shape != kept.costs.shape:
        yield f"{len(kept)} trajectories were {len(now)}"
        return
    if lacking := set(kept.reported_names) - set(now.reported_names):
        yield f"{', '.join(sorted(lacking))} are no longer reported"
        return
    reported = now.reported[:, [now.reported_names.index(name) for name in kept.reported_names]]
    for name, was, is_ in (("costs", kept.costs, now.costs), ("reported", kept.reported, reported)):
        if was.shape != is_.shape or not (was == is_).all():
            off = np.abs(was - is_).max() if was.shape == is_.shape else np.inf
            yield f"{name} differ by up to {off:.3g}"
    for row, (was, is_) in enumerate(zip(kept.trajectories, now.trajectories, strict=True)):
        if was.kinds != is_.kinds:
            yield f"trajectory {row} has other motions"
        elif any((getattr(was.states, n) != getattr(is_.states, n)).any() for n in was.states.names):
            yield f"trajectory {row} has other states"


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan the instances asked for; keep, or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument("--keep", type=Path, metavar="FOLDER")
    task.add_argument("--against", type=Path, metavar="FOLDER")
    parser.add_argument("name", nargs="*", help="instances; all, if none is named")
    given = parser.parse_args(arguments)
    made, failed = instances(), 0
    for name in given.name or made:
        began = time.process_time()
        front = made[name]()
        seconds = time.process_time() - began
        file = (given.keep or given.against) / f"{name.replace(' ', '_')}.json"
        if given.keep:
            file.parent.mkdir(parents=True, exist_ok=True)
            front.save(file)
            found = "kept"
        else:
            off = list(differences(front, hpop.Front.load(file)))
            failed += bool(off)
            found = "; ".join(off) or "the same"
        print(f"{name:30} {len(front):6,} trajectories {seconds:7.1f} s  {found}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
