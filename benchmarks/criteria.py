"""Benchmark of criteria: each over all edges of a lattice of about a million, at first use and afterwards.

    python benchmarks/criteria.py --out FILE

Prints one JSON line a criterion: edges, seconds at first use (fields and kernels included), seconds afterwards, and the
ratio to the time of `length`, the cheapest there is.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import museums
import numpy as np
import shapely

import hpop
from hpop.base import registry
from hpop.criteria import make_criterion, motion_costs
from hpop.motions import lacking
from hpop.planners import Lattice
from hpop.world.content.content import Landmark, Person, Zone


def furnished() -> hpop.Problem:
    """Return the largest museum with 10 landmarks, 6 people in two conversations, and two zones."""
    plain = museums.problem("m160")
    rng = np.random.default_rng(0)
    places = rng.uniform(3.0, 37.0, size=(16, 2))
    yaws = rng.uniform(-np.pi, np.pi, size=16)
    world = plain.world.with_content(
        people=[Person(x, y, yaw) for (x, y), yaw in zip(places[:6].tolist(), yaws[:6].tolist(), strict=True)],
        groups=[(0, 1), (2, 3, 4)],
        landmarks=[
            Landmark(x, y, facing=yaw) for (x, y), yaw in zip(places[6:].tolist(), yaws[6:].tolist(), strict=True)
        ],
        zones=[
            Zone("speed", shapely.box(5, 5, 20, 20), limit=0.5),
            Zone("one-way", shapely.box(20, 20, 35, 35), path=shapely.LineString([(20, 20), (35, 35)])),
        ],
    )
    return hpop.Problem(world, plain.model, plain.start, plain.goal, ["length"])


def main() -> None:
    """Time every criterion that adds up along edges."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/criteria.json"), help="JSON file")
    arguments = parser.parse_args()
    problem = furnished()
    lattice = Lattice(step=museums.CELL).lattice(problem)
    rows: list[dict[str, Any]] = []
    for name in ["length", *(n for n in registry.criteria if n != "length")]:
        needed = [f.name for f in fields(registry.criteria[name]) if f.default is f.default_factory is MISSING]
        if set(needed) - {"target"}:
            continue  # such as a file of learnt weights
        criterion = make_criterion({name: {"target": (*problem.goal[:2], 1.0)}} if needed else name)
        if criterion.aggregate == "trajectory" or lacking(criterion.requires, problem.model, problem.world):
            continue
        seconds = []
        for _ in range(3):
            batches = [motions for _, _, motions in lattice.batches()]
            began = time.perf_counter()
            for motions in batches:
                motion_costs(criterion, motions)
            seconds.append(time.perf_counter() - began)
        edges = sum(len(motions) for motions in batches)
        after = min(seconds[1:])
        rows.append({"criterion": name, "edges": edges, "first_s": seconds[0], "after_s": after})
        rows[-1]["over_length"] = after / rows[0]["after_s"]
        print(json.dumps(rows[-1]))
    ten = sorted((row["after_s"] for row in rows), reverse=True)[:10]
    print(f"the ten dearest together: {sum(ten):.2f} s")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"criteria": rows, "ten_dearest_s": sum(ten)}, indent=1) + "\n")


if __name__ == "__main__":
    main()
