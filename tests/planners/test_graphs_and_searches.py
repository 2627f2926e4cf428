"""The table of graph families and search options: every option works on every graph, or is refused with a reason."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError, QueryError
from hpop.planners import Candidates
from hpop.planners.graph_planners import WeightedSum
from hpop.planners.graphs import GraphFamily
from hpop.planners.graphs.family import make_family
from hpop.planners.searches import Exact
from hpop.planners.spending import Exhausted
from hpop.problems.verify import verify
from hpop.runtime.limits import Progress, Status
from hpop.world import Person
from tests.hulls import Hull
from tests.search.conftest import front_by_closure

WALLS, EXTENT = [shapely.box(2.0, 0.0, 2.4, 1.6)], shapely.box(0, 0, 4.6, 3.2)
WORLD = hpop.World.from_polygons(WALLS, extent=EXTENT)
BASE = hpop.DifferentialDrive(radius=0.2)
HEAD = hpop.PanTilt(BASE)
FAMILIES: dict[str, tuple[Any, Any]] = {
    "lattice": ({"lattice": {"step": 0.8, "headings": 4}}, BASE),
    "lattice of the world": ({"lattice": {"step": 0.8, "headings": 4, "anchor": "world"}}, BASE),
    "positions": ({"roadmap": {"samples": 9, "neighbours": 4, "seed": 4}}, BASE),
    "configurations": ({"roadmap": {"samples": 24, "neighbours": 5, "seed": 4}}, HEAD),
    "corners": ({"corners": {"step": 0.8, "max_positions": 4}}, BASE),
}
WALKING = Person(4.0, 2.8, velocity=(-0.4, 0.0), name="Ann")
CRITERIA = ({"exposure": {"radius": 1.0}}, "turns", "length")
every_family = pytest.mark.parametrize("family", FAMILIES)


def question(family: str, criteria: Any = CRITERIA, world: hpop.World = WORLD) -> hpop.Problem:
    model = FAMILIES[family][1]
    head = (0.0, 0.0) if model is HEAD else ()
    return hpop.Problem(world, model, (0.6, 0.6, 0.0, *head), (4.0, 0.7, None, *head), list(criteria))


def graph_of(family: str) -> GraphFamily:
    return make_family(FAMILIES[family][0])


@cache
def everything(family: str) -> np.ndarray:
    """All non-dominated cost vectors of the family's graph, by closure of sets of vectors."""
    query = graph_of(family).query(question(family))
    space = query.space.with_checked_arcs()
    found = front_by_closure(space.graph(query.objectives.optimised), query.start, set(query.goals))
    assert len(found) > 1
    return np.array(found) * query.quanta


def planned(family: str, criteria: Any = CRITERIA, **options: Any) -> Candidates:
    """Return the result of the exact search, checked as every result is: re-evaluated, free, with the queried ends."""
    asked = question(family, criteria)
    found = Exact(FAMILIES[family][0], **options).solve(asked)
    front = asked.front(found)
    assert "NOT VALID" not in front.certificate
    assert verify(asked, front) == []
    return found


def rows(costs: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(row) for row in np.round(costs, 9).tolist()}


@every_family
def test_the_front_is_that_of_all_paths_of_the_graph(family: str) -> None:
    found = planned(family)
    assert rows(found.planned) == rows(everything(family))
    assert found.status is Status.COMPLETE
    assert found.certificate.startswith("exact: exact on ")


@every_family
@pytest.mark.parametrize(
    "options", [{"eps": 0.2}, {"tolerance": {"length": 0.5, "turns": 1}}], ids=["eps", "tolerance"]
)
def test_every_optimal_vector_is_covered_within_a_precision(family: str, options: dict[str, Any]) -> None:
    found = planned(family, **options)
    slack = np.array([options.get("tolerance", {}).get(name, 0.0) for name in ("exposure", "turns", "length")])
    allowed = everything(family) * (1.0 + options.get("eps", 0.0)) + slack + 1e-9
    assert (found.planned[:, None] <= allowed[None]).all(axis=2).any(axis=0).all()
    assert "covered within" in found.certificate


@every_family
def test_paths_of_too_many_turns_are_left_out(family: str) -> None:
    known = everything(family)
    most = int(np.sort(known[:, 1])[-2])
    assert rows(planned(family, max_turns=most).planned) == rows(known[known[:, 1] <= most])


@every_family
def test_a_search_that_was_stopped_goes_on_from_its_checkpoint(family: str, tmp_path: Path) -> None:
    file, searches = tmp_path / "kept", 0

    def stop(report: Progress) -> None:
        nonlocal searches
        searches += report.stage == "bounds"
        if searches == (2 if family == "corners" else 1):  # the first one is that of the lattice with the corners
            raise KeyboardInterrupt

    stopped = Exact(FAMILIES[family][0], checkpoint=file).solve(question(family), stop)
    assert stopped.status is Status.INTERRUPTED
    assert rows(planned(family, checkpoint=file).planned) == rows(everything(family))


@every_family
def test_a_limit_of_labels_is_told(family: str) -> None:
    stopped = Exact(FAMILIES[family][0], max_labels=3).solve(question(family))
    assert stopped.status is Status.LABEL_LIMIT
    assert "incomplete (label limit)" in stopped.certificate


@every_family
@pytest.mark.parametrize("limit", [{"time_limit": 1e-9}, {"max_memory": 1}], ids=["time", "memory"])
def test_limits_that_are_passed_at_once_are_told(family: str, limit: dict[str, float]) -> None:
    found = Exact(FAMILIES[family][0], **limit).solve(question(family))
    assert found.status in (Status.TIME_LIMIT, Status.MEMORY_LIMIT)
    assert "incomplete" in found.certificate


@every_family
def test_the_last_stage_is_the_whole_front(family: str) -> None:
    *before, last = Exact(FAMILIES[family][0]).stages(question(family))
    assert rows(last.planned) == rows(everything(family))
    assert all(found.status is Status.UNFINISHED for found in before)


@every_family
def test_a_mean_itself_is_optimised_under_a_cap(family: str) -> None:
    """No path of the front with the integral has both a smaller mean and a smaller length within the cap."""
    criteria = ["obstruction", "length", "duration"]
    found = planned(family, criteria, max_detour=1.3)
    assert found.status is Status.COMPLETE
    cap = 1.3 * found.planned[:, 2].min() + 1e-6
    assert (found.planned[:, 2] <= cap).all()
    asked = question(family, criteria)
    other = Exact(FAMILIES[family][0]).solve(asked)
    costs = np.array([list(asked.evaluate(path).values()) for path in other.trajectories])
    within = costs[costs[:, 2] <= cap]
    slack = found.tolerance.max(axis=0) + 1e-9
    assert ((found.planned[:, None] <= within[None] + slack).all(axis=2).any(axis=0)).all()


@every_family
def test_weighted_sums_are_the_supported_points(family: str) -> None:
    known = everything(family)
    found = WeightedSum(on=FAMILIES[family][0]).solve(question(family))
    assert Hull().extreme([*rows(known)]) <= rows(found.planned) <= rows(known)


@every_family
def test_among_people_who_move_a_graph_has_a_clock_or_says_that_it_has_none(family: str) -> None:
    asked = question(family, ("duration", "length"), WORLD.with_content(people=(WALKING,)))
    planner = Exact(FAMILIES[family][0], margin=0.1)
    if family == "configurations":
        with pytest.raises(QueryError, match=r"exact does not consider time, .*: Ann\. Use a planner that does"):
            planner.solve(asked)
        with pytest.raises(QueryError, match="weighted-sum does not consider time"):
            WeightedSum(on=FAMILIES[family][0]).solve(asked)
        return
    found = planner.solve(asked)
    assert "on a clock of 0.05 s" in found.certificate
    assert len(found.trajectories) > 0
    assert verify(asked, asked.front(found)) == []


def test_an_option_of_neither_graph_nor_search_names_both_lists() -> None:
    with pytest.raises(
        OptionError, match=r"no option 'tolerance'.* It has step, .*; .* options of the search stand beside"
    ):
        make_family({"lattice": {"tolerance": 1}})
    with pytest.raises(OptionError, match=r"planner 'exact' has no option 'step'.* It has on, max_detour, .*, margin"):
        hpop.planners.make_planner({"exact": {"on": "lattice", "step": 0.5}})


@pytest.mark.parametrize("anchor", ["n" * 5000, 7, ["world"]], ids=["long", "number", "list"])
def test_an_anchor_that_is_none_is_refused_in_a_short_message(anchor: Any) -> None:
    with pytest.raises(OptionError, match="anchor must be one of start, world, got ") as refused:
        hpop.Lattice(anchor=anchor)
    assert len(str(refused.value)) < 200


def test_the_flat_planners_are_the_same_searches() -> None:
    asked = question("lattice")
    flat = asked.solve({"lattice": {"step": 0.7, "eps": 0.1}})
    general = asked.solve({"exact": {"on": {"lattice": {"step": 0.7}}, "eps": 0.1}})
    assert flat.costs.tolist() == general.costs.tolist()
    assert flat.certificate.removeprefix("lattice: ") == general.certificate.removeprefix("exact: ")


def test_what_a_bound_forbids_is_not_given_back_when_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """The paths from which corners are made, and a first path of a graph, need not keep bounds of the search."""

    def too_late(*_: object, **__: object) -> None:
        raise Exhausted(Status.TIME_LIMIT, "arcs were costed")

    monkeypatch.setattr("hpop.planners.searches.built_query", too_late)
    for family, few in (("lattice", 0), ("corners", 1)):
        asked = question(family, world=hpop.World.from_polygons(WALLS, extent=EXTENT))  # which keeps no costs
        bounded = Exact(FAMILIES[family][0], max_turns=few, time_limit=60.0).solve(asked)
        assert bounded.status is Status.TIME_LIMIT
        assert len(bounded.trajectories) == 0
        free = Exact(FAMILIES[family][0], time_limit=60.0).solve(asked)
        assert len(free.trajectories) > 0


def test_a_graph_that_cannot_be_built_is_told_by_searches_of_others() -> None:
    walled = hpop.World.from_polygons([shapely.box(2.0, 0.0, 2.4, 3.2)], extent=shapely.box(0, 0, 4.6, 3.2))
    with pytest.raises(QueryError, match=r"the graph 'corners' could not be built .*no path"):
        graph_of("corners").query(question("corners", world=walled))
