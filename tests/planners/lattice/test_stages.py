"""Stages of the lattice planner: what each claims, that the last is the plain answer, that nothing found is lost."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import networkx as nx
import numpy as np
import pytest
import shapely

import hpop
from hpop.base.arrays import BoolArray
from hpop.errors import QueryError
from hpop.frontier import is_nondominated
from hpop.planners import searches as exact_search
from hpop.planners.base import Candidates, Planner, joined, make_planner
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs import lattice as lattice_planner
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.lattice.loops import DIAGONAL, STRAIGHT, cells_near_shortest_paths
from hpop.planners.graphs.query import Query
from hpop.planners.judgement import judge
from hpop.planners.spending import Limits, Spending
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.limits import Progress, Status

WALLS = [shapely.box(2, 0, 2.3, 3.2), shapely.box(4.4, 1.6, 4.8, 5), shapely.box(3, 3.8, 3.4, 4.2)]
EXTENT = shapely.box(0, 0, 7, 5)
WORLD = hpop.World.from_polygons(WALLS, extent=EXTENT)
STEP = 0.25
ROUND = hpop.DifferentialDrive(radius=0.25)
LONG = hpop.DifferentialDrive(footprint=((-0.3, -0.15), (0.3, -0.15), (0.3, 0.15), (-0.3, 0.15)))


def problem(criteria: tuple[Any, ...] = ("obstruction", "turns", "length"), world: hpop.World | None = None) -> Problem:
    """By default in a world of its own, which keeps no graph of another test: then the part is left out."""
    world = world or hpop.World.from_polygons(WALLS, extent=EXTENT)
    return Problem(world, ROUND, (1.0, 1.0, 0.0), (6.0, 4.0, None), list(criteria))


def found(asked: Problem, **options: Any) -> list[Candidates]:
    return list(Lattice(step=STEP, **options).stages(asked))


at_once = exact_search._quick_exact_answer


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages before the last end by themselves, however busy the machine is, and no small lattice goes without."""
    monkeypatch.setattr(exact_search, "QUICK", 60.0)
    monkeypatch.setattr(exact_search, "_quick_exact_answer", lambda *asked: None)


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every lattice of more than 60 positions counts as large, and no stage is cut short."""
    monkeypatch.setattr(lattice_planner, "MOST_FIRST", 60)
    monkeypatch.setattr(Spending, "share", lambda spending, seconds: spending.left())


def same(a: Candidates, b: Candidates) -> bool:
    """Compare two results in everything but their computing times."""
    return (
        [t.describe() for t in a.trajectories] == [t.describe() for t in b.trajectories]
        and np.array_equal(a.planned, b.planned)
        and np.array_equal(a.tolerance, b.tolerance)
        and (a.status, a.certificate, a.provenance, a.notes) == (b.status, b.certificate, b.provenance, b.notes)
    )


# The part of a grid


@pytest.mark.parametrize("seed", range(30))
def test_marked_cells_are_those_on_the_shortest_ways(seed: int) -> None:
    """Against networkx: no unmarked cell has a shorter way through it, and a shortest way is marked as a whole."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(2, 12, 2)
    cutting = bool(seed % 2)
    free = rng.random((rows, columns)) < 0.75
    free[0, 0] = free[-1, -1] = True
    ways = grid(free, cutting)
    goal, most = (rows - 1, columns - 1), int(rng.integers(1, rows * columns))
    marked = cells_near_shortest_paths(free, (0, 0), goal, most, corner_cutting=cutting)
    if not nx.has_path(ways, (0, 0), goal):
        assert marked is None
        return
    assert marked is not None
    there, back = (nx.single_source_dijkstra_path_length(ways, end) for end in ((0, 0), goal))
    through = {cell: there[cell] + back[cell] for cell in there}
    inside = set(zip(*(axis.tolist() for axis in np.nonzero(marked)), strict=True))
    assert nx.dijkstra_path_length(grid(marked, cutting), (0, 0), goal) == there[goal]
    if cutting:  # else cells beside a diagonal are marked first
        assert max(through[cell] for cell in inside) <= min((through[c] for c in through.keys() - inside), default=1e9)
    assert len(inside) == min(most, len(through)) or len(inside) > most


def grid(free: BoolArray, cutting: bool) -> nx.Graph[tuple[int, int]]:
    ways: nx.Graph[tuple[int, int]] = nx.Graph()
    cells = [(int(i), int(j)) for i, j in np.argwhere(free)]
    ways.add_nodes_from(cells)
    for (i, j), (up, right) in itertools.product(cells, itertools.product((-1, 0, 1), repeat=2)):
        a, b = i + up, j + right
        if (a, b) not in ways or (up, right) == (0, 0):
            continue
        if up and right and not cutting and not (free[i, b] and free[a, j]):
            continue
        ways.add_edge((i, j), (a, b), weight=DIAGONAL if up and right else STRAIGHT)
    return ways


@pytest.mark.parametrize("model", [ROUND, LONG])
def test_edges_of_a_part_are_edges_of_the_whole_with_the_same_costs(model: hpop.DifferentialDrive) -> None:
    asked = Problem(WORLD, model, (1.0, 1.0, 0.0), (6.0, 4.0, None), ["exposure", "turns", "length"])
    whole = Lattice(step=STEP).lattice(asked)
    kept = np.zeros(whole.shape, dtype=bool)
    kept[3:14, 4:17] = True
    part = replace(whole, kept=kept)
    assert 0 < part.size < whole.size
    assert 0 < len(edges(part, asked)) < len(edges(whole, asked))
    assert edges(part, asked).items() <= edges(whole, asked).items()


def edges(lattice: StateLattice, asked: Problem) -> dict[tuple[float, ...], tuple[int, ...]]:
    """Costs of each edge, by the poses of its ends."""
    graph = lattice.graph(asked.criteria)
    states = lattice.states(np.arange(lattice.size))
    poses = list(zip(states.x.tolist(), states.y.tolist(), states.yaw.tolist(), strict=True))
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    heads, costs = graph.heads.tolist(), map(tuple, graph.costs.tolist())
    return {poses[t] + poses[h]: cost for t, h, cost in zip(tails.tolist(), heads, costs, strict=True)}


# What each stage is


@pytest.mark.usefixtures("large")
def test_the_last_stage_is_the_plain_answer_and_those_before_are_unfinished() -> None:
    stages = found(problem())
    assert [stage.status for stage in stages] == [Status.UNFINISHED] * 3 + [Status.COMPLETE]
    assert same(stages[-1], Lattice(step=STEP).solve(problem()))
    assert all(stage.certificate.endswith("; the exact search is not done") for stage in stages[:-1])
    assert ["positions on the shortest paths" in stage.certificate for stage in stages] == [True, False, False, False]
    assert "within" in stages[2].certificate


def test_a_small_lattice_whose_search_ends_at_once_has_one_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_search, "_quick_exact_answer", at_once)
    (only,) = found(problem())
    assert same(only, Lattice(step=STEP).solve(problem()))


def test_a_small_lattice_has_two_stages_and_the_first_is_part_of_the_front() -> None:
    """On the whole lattice supported points are efficient, so they are among those of the exact front."""
    first, last = found(problem())
    assert first.status is Status.UNFINISHED
    assert 3 <= len(first.trajectories) < len(last.trajectories)
    assert set(map(tuple, first.planned.tolist())) < set(map(tuple, last.planned.tolist()))
    assert (first.planned.min(axis=0) == last.planned.min(axis=0)).all()  # the best in each cost is there


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize(
    "criteria", [("obstruction", "turns", "length"), ("length",), ("worst_obstruction", "length"), ("clearance",)]
)
def test_points_of_every_stage_are_attained_and_none_beats_the_last(criteria: tuple[str, ...]) -> None:
    """Judged on the trajectories alone; and as paths of the lattice they are covered by the exact front."""
    asked = problem(criteria)
    *before, last = found(asked)
    assert len(before) == 3
    for stage in before:
        assert len(stage.trajectories) > 0
        judgement = judge(asked, stage.objectives, stage.trajectories, planned=stage.planned, tolerance=stage.tolerance)
        assert judgement.rejection_counts == {}
        covered = (last.planned[None] <= stage.planned[:, None] + 1e-12).all(axis=2).any(axis=1)
        assert covered.all()


@pytest.mark.usefixtures("large")
def test_the_coarse_stage_keeps_its_promise() -> None:
    *_, coarse, last = found(problem())
    allowed = (1 + exact_search.COARSE) * last.planned[:, None] + 1e-9
    assert (coarse.planned[None] <= allowed).all(axis=2).any(axis=1).all()


@pytest.mark.usefixtures("large")
def test_a_stage_that_has_spent_its_share_speaks_of_no_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who set none would look for it."""
    monkeypatch.setattr(Spending, "share", lambda spending, seconds: Limits(1e-9))
    coarse = found(problem())[-2]
    assert coarse.certificate.startswith("lattice: incomplete (this stage's share of the time): ")
    assert "time limit" not in coarse.certificate


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize(("options", "count"), [({"max_detour": 1.1}, 1), ({"max_turns": 4}, 1), ({"eps": 0.2}, 3)])
def test_what_is_asked_for_decides_the_stages(options: dict[str, Any], count: int) -> None:
    asked = problem()
    stages = found(asked, **options)
    assert len(stages) == count
    assert same(stages[-1], Lattice(step=STEP, **options).solve(asked))


@pytest.mark.usefixtures("large")
def test_without_a_path_the_last_stage_says_what_blocks_the_way() -> None:
    wall = hpop.World.from_polygons([*WALLS, shapely.box(3.7, 0, 3.9, 5)], extent=shapely.box(0, 0, 7, 5))
    *before, last = found(problem(world=wall))
    assert {(len(stage.trajectories), stage.status) for stage in before} == {(0, Status.UNFINISHED)}
    assert last.status is Status.NO_PATH
    assert any(note.startswith("no path") for note in last.notes)
    assert len(problem(world=wall).solve(Lattice(step=STEP))) == 0


def test_a_wrong_question_is_refused_before_the_first_stage() -> None:
    asked = Problem(WORLD, ROUND, (2.1, 1.0, 0.0), (6, 4, None), ["length"])
    with pytest.raises(QueryError, match="start"):
        next(Lattice(step=STEP).stages(asked))


def test_a_planner_without_stages_has_one() -> None:
    assert Lattice().answers_in_stages
    fixed = make_planner(Fixed((found(problem())[-1],)))
    assert not fixed.answers_in_stages
    assert len(list(fixed.stages(problem()))) == 1


# What a problem makes of stages


@dataclass(frozen=True)
class Fixed:
    """A planner whose stages are given; an exception among them is raised in its turn."""

    given: tuple[Candidates | BaseException, ...]
    name: str = "fixed"

    def solve(self, problem: Problem, progress: Callable[[Progress], None] | None = None) -> Candidates:
        *_, last = self.given
        assert isinstance(last, Candidates)
        return last


@dataclass(frozen=True)
class Staged(Fixed):
    def stages(self, problem: Problem, progress: Callable[[Progress], None] | None = None) -> Iterator[Candidates]:
        for stage in self.given:
            if not isinstance(stage, Candidates):
                raise stage
            yield stage


def rows(candidates: Candidates, chosen: list[int], status: Status, certificate: str) -> Candidates:
    """Return some of the points of a result, as a stage of their own."""
    return replace(
        candidates,
        trajectories=tuple(candidates.trajectories[i] for i in chosen),
        planned=candidates.planned[chosen],
        tolerance=candidates.tolerance[chosen],
        provenance=tuple(candidates.provenance[i] for i in chosen),
        status=status,
        certificate=certificate,
    )


@pytest.fixture(scope="module")
def exact() -> Candidates:
    answer = Lattice(step=STEP).solve(problem())
    assert len(answer.trajectories) >= 6
    return answer


def points(front: Front) -> set[tuple[int, ...]]:
    return set(map(tuple, front.integers.tolist()))


def test_stages_are_told_and_only_the_last_front_is_given(exact: Candidates) -> None:
    first = rows(exact, [0, 1], Status.UNFINISHED, "first")
    second = rows(exact, [1, 2], Status.UNFINISHED, "second")
    other = rows(exact, [5], Status.COMPLETE, "other")
    told: list[Front] = []
    planners: list[Planner] = [Fixed((other,)), Staged((first, second, exact))]
    fronts = list(problem().fronts(planners, stage=told.append))
    assert [len(front) for front in told] == [3, 4]  # with the other planner's point, and nothing lost on the way
    assert [front.status for front in told] == ["complete | unfinished"] * 2
    assert points(fronts[0]) <= points(told[0]) <= points(told[1]) <= points(fronts[1])
    assert len(fronts) == 2
    assert (fronts[1].status, len(fronts[1])) == ("complete", len(exact.trajectories))
    assert "first" not in fronts[1].certificate


def test_a_final_answer_stands_alone_and_another_keeps_what_was_found_before(exact: Candidates) -> None:
    first = rows(exact, [0, 1], Status.UNFINISHED, "first")
    assert joined(first, exact) is exact
    assert joined(None, first) is first
    for status in (Status.TIME_LIMIT, Status.LABEL_LIMIT, Status.MEMORY_LIMIT, Status.INTERRUPTED, Status.UNFINISHED):
        both = joined(first, rows(exact, [3], status, "stopped"))
        assert both.status is status
        assert both.planned.tolist() == exact.planned[[3, 0, 1]].tolist()
        assert both.trajectories == tuple(exact.trajectories[i] for i in (3, 0, 1))
        assert both.certificate == "stopped; with the points of earlier stages"


@pytest.mark.parametrize("solved", [True, False])
def test_ctrl_c_in_a_later_stage_keeps_the_stages_before(exact: Candidates, solved: bool) -> None:
    stop: Candidates | BaseException = KeyboardInterrupt()
    if solved:  # the search itself catches it, as the searches of the lattice do
        stop = rows(exact, [4], Status.INTERRUPTED, "stopped")
    stages = Staged((rows(exact, [0, 2], Status.UNFINISHED, "first"), stop))
    never = Staged((AssertionError("ran"),))
    front = problem().solve([stages, never])
    assert (front.status, len(front)) == ("interrupted", 3 if solved else 2)
    before = Fixed((rows(exact, [5], Status.COMPLETE, "before"),))
    front = problem().solve([before, stages, never])
    assert (front.status, len(front)) == ("complete | interrupted", 4 if solved else 3)


def test_ctrl_c_between_stages_keeps_them(exact: Candidates) -> None:
    """As when it comes while the front of a stage is saved."""

    def stop(front: Front) -> None:
        raise KeyboardInterrupt

    stages = Staged((rows(exact, [0, 2], Status.UNFINISHED, "first"), AssertionError("ran")))
    (front,) = problem().fronts([stages, stages], stage=stop)
    assert (front.status, len(front)) == ("interrupted", 2)


def test_ctrl_c_before_anything_is_found_is_obeyed() -> None:
    with pytest.raises(KeyboardInterrupt):
        problem().solve(Staged((KeyboardInterrupt(),)))


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize("at", [1, 2])
def test_ctrl_c_while_the_lattice_is_built_or_searched_keeps_the_first_answer(
    monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """The whole lattice is the second to be built; exact searches are the coarse one and the last."""
    owner, name = [(StateLattice, "graph"), (Query, "exact")][at - 1]
    plain, calls = getattr(owner, name), []

    def interrupted(*arguments: Any, **options: Any) -> Any:
        calls.append(name)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return plain(*arguments, **options)

    monkeypatch.setattr(owner, name, interrupted)
    told: list[Front] = []
    (front,) = problem().fronts([Lattice(step=STEP)], stage=told.append)
    assert front.status == "interrupted"
    assert points(front) == points(told[-1])
    assert len(told) == [1, 3][at - 1]


@pytest.mark.usefixtures("large")
def test_a_limit_in_the_exact_stage_makes_one_claim_which_counts_on_the_coarse_front() -> None:
    """A tenth is what the coarse front is within, far less than a search without points of its own could say."""
    labels = [Lattice(step=STEP, eps=eps).solve(problem()).stats["labels_generated"] for eps in (0.1, 0.0)]
    assert labels[0] < labels[1]
    front = problem().solve(Lattice(step=STEP, max_labels=sum(labels) // 2))
    claim = front.certificate
    assert front.status == "label limit"
    assert claim.count("lattice: ") == 1
    assert claim.count("on the lattice of step") == 1
    assert "for each of them, a point here is at most 10 % worse in every cost" in claim
    assert claim.endswith("; with the points of earlier stages (within a factor 1.1, supported points)")
    assert front.runs[-1]["gap"] <= 0.1


def test_a_limit_in_the_exact_stage_loses_nothing() -> None:
    """One label is not enough for anything; the supported points are found without labels."""
    front = problem().solve(Lattice(step=STEP, max_labels=1))
    first, _ = found(problem())
    assert front.status == "label limit"
    assert is_nondominated(first.planned).all()
    assert front.costs == pytest.approx(first.planned, abs=1e-4)
    assert front.certificate.startswith(
        "lattice: incomplete (label limit): the search itself found none on the lattice"
    )
    assert front.certificate.endswith("; with the points of earlier stages (supported points)")
    assert {origin["stage"] for origin in front.provenance} == {"supported points"}


def test_a_stage_without_points_is_not_spoken_of(exact: Candidates) -> None:
    stopped = rows(exact, [3], Status.TIME_LIMIT, "stopped")
    assert joined(rows(exact, [], Status.UNFINISHED, "nothing"), stopped) is stopped


def test_a_search_that_goes_on_from_a_checkpoint_has_no_first_answers(tmp_path):
    """They would take the place of the better front that it had when it was stopped."""
    world = hpop.World.from_polygons([shapely.box(3, 0, 3.4, 3.6)], extent=shapely.box(0, 0, 10, 6))
    asked = Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (9, 5, None), ["exposure", "turns", "length"])
    file = str(tmp_path / "kept")
    stopped = list(Lattice(step=0.25, checkpoint=file, max_labels=2000).stages(asked))
    assert len(stopped) > 1
    assert (tmp_path / "kept").exists()
    (last,) = Lattice(step=0.25, checkpoint=file).stages(asked)
    assert last.status is Status.COMPLETE


def test_a_very_large_lattice_goes_from_its_part_to_its_last_front(large, monkeypatch):
    whole = found(problem(("exposure", "turns", "length")))
    monkeypatch.setattr(exact_search, "MOST_COPIED", 0)
    stages = found(problem(("exposure", "turns", "length")))
    assert len(stages) < len(whole)
    assert all("supported" not in stage.certificate and "within" not in stage.certificate for stage in stages[1:])
    assert same(stages[-1], whole[-1])
