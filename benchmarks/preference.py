"""Benchmark of learning what a person prefers: what a question takes, on fronts of 10 to 3,290 rows.

    python benchmarks/preference.py --out FILE

Prints one JSON line for each front, with and without "no difference" among the answers: processor's ms of a question,
which is the answer before it, the next pair and whether to go on (median and most over simulated people), and of the
best row; and the regret after 25 questions, a share of what the rows cost such a person. The museum's front is planned;
the other ones are made by a seed. People are drawn from the prior, without those who answer just anything.
"""

from __future__ import annotations

import argparse
import json
import platform
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import seeded_fronts

from hpop.frontier import ItemFront
from hpop.preference import Preference, Prior
from hpop.scenario import load_scenario

PEOPLE = 20
QUESTIONS = 25
ROWS = 10, 50, 400, 3_290
CRITERIA = 5


def museum() -> ItemFront[Any]:
    """158 trajectories: exposure, turns and length."""
    scenario = load_scenario(Path(__file__).parents[1] / "examples" / "museum.yaml")
    return scenario.problem.solve(list(scenario.planners))


def seeded(n: int, k: int) -> ItemFront[Any]:
    """Return a front of n rows with costs alone."""
    costs = seeded_fronts.costs_of(np.random.default_rng(1), n + n // 10, k)
    return ItemFront.of(costs)[:n]


def measured(name: str, front: ItemFront[Any], ties: bool) -> dict[str, Any]:
    """Measure the processor seconds of questions, and the regret after them."""
    asking, judging, regrets = [], [], []
    for seed in range(PEOPLE):
        rng = np.random.default_rng(seed)
        shares, sharpness, nu = Prior(random=0.0).draw(len(front.names), 1, rng)
        person = Preference.fit(front, ties=ties, seed=seed)
        costs = person.scale.rows_on(front) @ shares[0]
        for _ in range(QUESTIONS):
            began = process_time()
            pair = person.next_pair()
            took = process_time() - began
            if pair is None:
                break
            a, b = pair
            gain = sharpness[0] * (costs[b] - costs[a])
            odds = np.array([np.exp(gain / 2), np.exp(-gain / 2), nu[0] if ties else 0.0])
            chosen = (a, b, None)[rng.choice(3, p=odds / odds.sum())]
            began = process_time()
            person = person.told(a, b, chosen)
            person.why_stop(most=10**6)
            asking.append(took + process_time() - began)
        began = process_time()
        best = person.best()
        judging.append(process_time() - began)
        regrets.append((costs[best.row] - costs.min()) / np.ptp(costs))
    return {
        "front": name,
        "rows": len(front),
        "criteria": len(front.names),
        "ties": ties,
        "people": PEOPLE,
        "question_ms_median": round(1e3 * float(np.median(asking)), 1),
        "question_ms_most": round(1e3 * max(asking), 1),
        "best_ms_median": round(1e3 * float(np.median(judging)), 1),
        "mean_regret": round(float(np.mean(regrets)), 5),
    }


def main() -> None:
    """Measure all fronts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    fronts = [("museum", museum()), *(("seeded", seeded(n, CRITERIA)) for n in ROWS)]
    rows = []
    for name, front in fronts:
        for ties in (False, True):
            rows.append(measured(name, front, ties))
            print(json.dumps(rows[-1]), flush=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(
        json.dumps({"machine": platform.machine(), "python": platform.python_version(), "rows": rows}, indent=1)
    )


if __name__ == "__main__":
    main()
