"""Every planner with every model that it accepts keeps what planners promise, and refuses the others by name.

The checks are those of `hpop check`: planned costs are re-evaluated, ends kept, collisions judged by python-fcl, fronts
saved and loaded, the same found by a copy and on an executor, limits and interrupts obeyed. Instances are small.
"""

from __future__ import annotations

import importlib
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from hpop.base.registry import make_model, models, planners
from hpop.errors import UnsupportedModel
from hpop.models.mobile_arm import MobileArm
from hpop.planners.base import make_planner
from hpop.problems.problem import Problem
from hpop.testing.planners import planner_checks, small_problem
from tests.models.serial_arm.arms import arm6
from tests.two_arms import BESIDE, sweep, two_arms

PLUGIN = Path(__file__).resolve().parents[2] / "examples/plugin"
COARSE: dict[str, Any] = {"lattice": {"step": 0.5}}
ON_TOP = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)  # m and rad: where the base carries the arm
OPTIONS: dict[str, dict[str, Any]] = {
    "any-angle": {"step": 0.5, "max_positions": 30},
    "epsilon-constraint": {"step": 0.5, "max_points": 1, "rounds": 1},
    "exact": {"on": {"roadmap": {"samples": 40}}, "eps": 0.1},
    "lattice": {"step": 0.5},
    "roadmap": {"samples": 40},
    "rrt": {"runs": 1, "max_extensions": 1000},
    "smoothing": {"step": 2.0, "intervals": 8},
    "spline": {"pieces": 2, "warm_start": {"roadmap": {"samples": 4, "trees": 1}}},
    "weighted-sum": {"step": 0.5},
    "weighted-sum-corridor": {"step": 0.5},
}
"""What makes each planner quick."""


def models_here() -> dict[str, Any]:
    """Return hpop's models, arms among them, and those of the example plugin."""
    sys.path.insert(0, str(PLUGIN))
    try:
        importlib.import_module("hpop_example_plugin.holonomic")
    finally:
        sys.path.remove(str(PLUGIN))
    names = [name for name, cls in models.items() if cls.__module__.startswith("hpop")]
    arms = {
        "serial_arm": arm6(tip="forearm"),
        "mobile_arm": MobileArm(arm6(tip="forearm", base=ON_TOP)),
        "two_arms": two_arms(view=arm6(tip="forearm", base=BESIDE), motion=sweep(times=[0.0, 2.0, 6.0]), step=1.0),
    }
    return {name: arms[name] if name in arms else make_model(name) for name in names}


MODELS = models_here()
AT_HOME = [name for name, cls in planners.items() if cls.__module__.startswith("hpop.")]
ACCEPTED = [(name, model) for name in AT_HOME for model in MODELS if planners[name].needs <= MODELS[model].provides]
REFUSED = [(name, model) for name in AT_HOME for model in MODELS if (name, model) not in ACCEPTED]


#: On graphs, where a head asks of a planner all that a base does; splines of an arm begin with its roadmap.
LESS = {
    *(("roadmap", model) for model in ("differential_drive", "holonomic", "serial_arm")),
    *(("lattice", "pan_tilt"), ("weighted-sum", "pan_tilt")),
    *(("exact", model) for model in ("differential_drive", "holonomic", "serial_arm")),
    *((name, "view") for name in ("any-angle", "epsilon-constraint", "exact", "roadmap", "smoothing")),
    *(("smoothing", "differential_drive"), ("spline", "serial_arm")),  # of which `make test` asks what they find
}


SLOW = ("mobile_arm", "two_arms")


def in_proof(case: Any, model: str) -> Any:
    """Mark a case for the proof where its motions take seconds: an arm on a base or beside another arm."""
    values = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, marks=pytest.mark.proof) if model in SLOW or case in LESS else case


@cache
def asked_for_duration(model: str) -> Problem:
    """One problem of a model, for all planners that refuse it."""
    return small_problem(MODELS[model], ["duration"])


def test_every_planner_is_looked_at_with_some_model():
    assert set(OPTIONS) == set(AT_HOME) == {name for name, _ in ACCEPTED}
    assert {"differential_drive", "pan_tilt", "holonomic"} <= set(MODELS)


@pytest.mark.parametrize(("name", "model"), [in_proof(case, case[1]) for case in ACCEPTED])
def test_a_planner_keeps_its_promises_with_each_model_it_accepts(name, model):
    checks = list(planner_checks(make_planner({name: OPTIONS[name]}), models=[MODELS[model]]))
    assert [check for check in checks if check.fault] == []
    assert len(checks) >= (12 if "plane" in MODELS[model].provides else 10)


@pytest.mark.parametrize(("name", "model"), [("smoothing", "differential_drive"), ("spline", "serial_arm")])
def test_what_solves_programs_keeps_its_promises_up_to_the_file_of_its_front(name, model):
    """Repetition, interrupts and limits have tests of their own, and run in the proof."""
    for check in planner_checks(make_planner({name: OPTIONS[name]}), models=[MODELS[model]]):
        assert not check.fault, check
        if check.claim == "returns a result that can be saved and loaded":
            return
    pytest.fail("no front was saved")


@pytest.mark.cases("holonomic")
@pytest.mark.parametrize("model", [in_proof(model, model) for model in MODELS])
def test_weighted_sums_on_a_roadmap_keep_their_promises_with_any_model(model):
    planner = make_planner({"weighted-sum": {"on": {"roadmap": {"samples": 40}}}})
    assert [check for check in planner_checks(planner, models=[MODELS[model]]) if check.fault] == []


@pytest.mark.parametrize(("name", "model"), REFUSED)
def test_a_planner_refuses_the_other_models_by_name_and_says_who_can(name, model):
    lacking = planners[name].needs - MODELS[model].provides
    with pytest.raises(UnsupportedModel) as refused:
        asked_for_duration(model).solve(name)
    said = str(refused.value)
    assert said.startswith(f"{name} needs a model with {', '.join(sorted(lacking))}, which {model} does not provide")
    able = [other for other, accepted in ACCEPTED if accepted == model]
    assert said.endswith(f"Planners that can use this model: {', '.join(able)}.")


def test_the_instances_have_trade_offs():
    """Else nothing of what is compared would differ."""
    for model in ("differential_drive", "pan_tilt"):
        problem = small_problem(MODELS[model], ["length", "exposure"])
        assert len(problem.solve(COARSE)) > 3
