"""Benchmark of learning what a person prefers: what a question takes, on fronts of 10 to 3,290 rows.

    python benchmarks/preference.py --out FILE [--fit 300]

Prints one JSON line for each front, with and without "no difference" among the answers: processor's ms of a question,
which is the answer before it, the next pair and whether to go on (median and most over simulated people), and of the
best row; and the regret after 25 questions, a share of what the rows cost such a person. The museum's front is planned;
the other ones are made by a seed. People are drawn from the prior, without those who answer just anything.

With --fit N it measures instead the test whether a weighted sum fits. N simulated people decide by a weighted sum. N
others have another taste, and lose over a tenth of their range by the proposed row. The fronts are that of the museum
and eight convex ones of 158 random points. All people err as the model says. A line for each person goes to FILE too,
so that shares at other limits of doubt can be computed.
"""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Callable
from itertools import count
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import seeded_fronts
from scipy.special import expit

from hpop.base.arrays import FloatArray
from hpop.frontier import ItemFront
from hpop.preference import FitCheck, Preference, Prior
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


def convex(n: int, k: int, seed: int) -> ItemFront[Any]:
    """Return a convex front of n random points, each of which is best for some weights."""
    away = np.abs(np.random.default_rng(seed).normal(size=(n, k)))
    return ItemFront.of(1.0 - away / np.linalg.norm(away, axis=1)[:, None], quanta=[1e-9] * k)


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


Bend = Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray]
TASTES: dict[str, Bend | None] = {
    "threshold": lambda rows, wanted, rng: np.maximum(rows - wanted, 0.0),
    "middle": lambda rows, wanted, rng: np.abs(rows - wanted),
    "step": lambda rows, wanted, rng: expit(20.0 * (rows - wanted)),
    "power": lambda rows, wanted, rng: rows ** np.exp(rng.uniform(-1.6, 1.6, rows.shape[1])),
    "square": lambda rows, wanted, rng: (rows - wanted) ** 2,
    "worst": None,
}
"""What people of the second kind feel of each cost, before its weight; "worst" is the largest weighted cost alone."""
LARGE = 0.1


def tested(front: ItemFront[Any], taste: str, seed: int) -> dict[str, Any] | None:
    """Ask one person 12 questions and those of the test; None for another taste without a large regret."""
    rng = np.random.default_rng([seed, 8])
    shares, sharpness, _ = Prior(random=0.0).draw(len(front.names), 1, rng)
    person = Preference.fit(front, seed=seed)
    rows = person.scale.rows_on(front)
    loss = rows @ shares[0]
    if taste != "sum":
        weights, wanted = rng.dirichlet(np.ones(rows.shape[1])), rng.uniform(0.3, 0.7, rows.shape[1])
        bend = TASTES[taste]
        loss = (rows * weights).max(axis=1) if bend is None else bend(rows, wanted, rng) @ weights
        loss = (loss - loss.min()) / np.ptp(loss)

    def answer(a: int, b: int) -> int:
        return a if rng.random() < 0.01 + 0.98 * expit(sharpness[0] * (loss[b] - loss[a])) else b

    def regret(row: int) -> float:
        return float((loss[row] - loss.min()) / np.ptp(loss))

    for _ in range(12):
        if pair := person.next_pair():
            person = person.told(*pair, answer(*pair))
    check = FitCheck.of(person)
    before = regret(check.row)
    if taste != "sum" and before <= LARGE:
        return None
    while pair := check.next_pair():
        check = check.told(*pair, answer(*pair))
    about = {"taste": taste, "seed": seed, "doubt": round(check.doubt, 3), "questions": len(check.answers)}
    return about | {"fits": check.fits, "regret": round(before, 4), "after": round(regret(check.best), 4)}


def fitted(name: str, people: int, out: Path) -> dict[str, Any]:
    """Measure the test of the fit on one kind of front."""
    fronts = [museum()] if name == "museum" else [convex(158, 3, seed) for seed in range(8)]
    found: list[dict[str, Any]] = []
    with out.open("a") as file:
        for tastes in (["sum"], [*TASTES]):
            left = people
            for seed in count(20_000):
                one = tested(fronts[seed % len(fronts)], tastes[seed % len(tastes)], seed)
                if one is not None:
                    found.append(one)
                    print(json.dumps({"front": name, **one}), file=file, flush=True)
                    left -= 1
                if not left:
                    break
    return summary(name, found)


def summary(name: str, found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the shares of false alarms and of people who are found, with the regrets of the latter."""
    of_sum, others = ([one for one in found if (one["taste"] == "sum") == is_sum] for is_sum in (True, False))
    bands = {"0.1 to 0.2": (0.1, 0.2), "0.2 to 0.4": (0.2, 0.4), "above 0.4": (0.4, 2.0)}

    def told(some: list[dict[str, Any]]) -> dict[str, Any]:
        alarms = sum(not one["fits"] for one in some)
        return {"people": len(some), "told": alarms, "share": round(alarms / max(len(some), 1), 4)}

    return {
        "front": name,
        "weighted sum": told(of_sum),
        "other tastes": told(others),
        "by regret": {
            band: told([one for one in others if low < one["regret"] <= high]) for band, (low, high) in bands.items()
        },
        "by taste": {taste: told([one for one in others if one["taste"] == taste]) for taste in TASTES},
        "questions": [round(float(np.mean([one["questions"] for one in some])), 1) for some in (of_sum, others)],
        "regret before and after": [round(float(np.mean([one[k] for one in others])), 3) for k in ("regret", "after")],
    }  # fmt: skip


def main() -> None:
    """Measure all fronts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--fit", type=int, default=0, metavar="N", help="measure the test of the fit, with N people")
    given = parser.parse_args()
    out: Path = given.out
    if given.fit:
        out.parent.mkdir(parents=True, exist_ok=True)
        for name in ("convex", "museum"):
            print(json.dumps(fitted(name, given.fit, out)), flush=True)
        return
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
