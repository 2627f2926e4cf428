"""Claims of roadmaps of robots beyond the plane: guides, far links, and edges that are checked only on fronts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.criteria import criterion
from hpop.errors import CriterionError, OptionError, QueryError
from hpop.motions import Motions, States
from hpop.planners import Roadmap, WeightedSum
from hpop.planners.graphs.query import built_query
from hpop.planners.graphs.roadmap import guides as seeking
from hpop.planners.graphs.roadmap.configurations import ConfigurationRoadmap
from hpop.planners.graphs.roadmap.guides import Connections, Guide, guides, length, shorten
from hpop.planners.graphs.roadmap.links import in_informed_set, nearest_in_random_subsets
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Spending
from hpop.problems.verify import verify
from hpop.runtime.limits import Budget, Status
from hpop.search import pareto_paths, supported_paths
from tests.joints import Balls, Joints, Sway, problem
from tests.planners.roadmap.test_configurations import BASE, HEAD
from tests.planners.roadmap.test_configurations import problem as in_plane


@dataclass(frozen=True, eq=False)
class Chance(Balls):
    """Segments are blocked by chance, each always alike; no state is."""

    share: float = 0.4

    def motions_free(self, motions: Motions) -> np.ndarray:
        a, b = (np.sum([np.asarray(getattr(s, n)) for n in s.names], axis=0) for s in (motions.start, motions.end))
        return np.abs(np.sin(1e4 * a + 3e4 * b)) > self.share


@dataclass(frozen=True)
class Unlucky(Joints):
    name = "unlucky"

    @cached_property
    def geometry(self) -> Balls:
        return Chance(np.zeros((0, self.number)), 1.0)


@dataclass(frozen=True)
class Walled(Joints):
    """A wall of balls, which nothing passes."""

    name = "walled"

    @cached_property
    def geometry(self) -> Balls:
        grid = np.linspace(-3.0, 3.0, 7)
        return Balls(np.array([(0.0, y) for y in grid]), 0.7)


def lazy_and_eager(asked: hpop.Problem, **options: Any) -> None:
    roadmap = Roadmap(**options).roadmap(asked)
    assert isinstance(roadmap, ConfigurationRoadmap)
    objectives = edge_objectives(asked.criteria, "roadmap")
    built = Roadmap(**options).build(asked, objectives, Spending())
    lazy, eager = (
        built_query(replace(built, ends=built.ends._replace(space=space)), objectives).exact("roadmap", Budget())
        for space in (replace(roadmap, lazy=True), roadmap.with_checked_arcs())
    )
    rows = [found.planned[np.lexsort(found.planned.T)].tolist() for found in (lazy, eager)]
    assert rows[0] == rows[1]
    assert lazy.status is eager.status
    checked = lazy.stats["edges_checked"]
    assert (
        f"{checked:,} of {lazy.stats['edges']:,} edges were checked in {lazy.stats['rounds']} round" in lazy.certificate
    )
    assert f", {lazy.stats['edges_blocked']:,} of them blocked; edges on no front" in lazy.certificate
    assert "checked" not in eager.certificate
    assert lazy.stats["edges"] - lazy.stats["edges_blocked"] >= eager.stats["edges"]


@pytest.mark.seeds(2, of=17)
def test_lazy_is_eager_vector_for_vector_where_segments_are_blocked_by_chance(seed: int) -> None:
    lazy_and_eager(problem(Unlucky(3)), samples=120, seed=seed, trees=seed % 2)


@pytest.mark.cases(1)
@pytest.mark.seeds(1, of=17)
@pytest.mark.parametrize("model", [BASE, HEAD], ids=["holonomic", "pan-tilt"])
def test_lazy_is_eager_vector_for_vector_in_the_plane(seed: int, model: Any) -> None:
    lazy_and_eager(in_plane(model), samples=40, seed=seed)


@pytest.mark.parametrize("samples", [50, pytest.param(150, marks=pytest.mark.proof)])
@pytest.mark.seeds(1, of=20)
def test_lazy_is_eager_vector_for_vector_among_balls(seed: int, samples: int) -> None:
    lazy_and_eager(problem(Joints(4, 150, 1.2, seed=seed)), samples=samples, seed=seed)


def test_few_edges_are_checked_and_the_counts_are_those_that_were_asked() -> None:
    robot = Joints(4, 100, 1.2, seed=3)
    asked = problem(robot)
    roadmap = Roadmap(samples=1000).roadmap(asked)
    graph = roadmap.graph(asked.criteria)
    robot.geometry.asked.clear()
    paths = pareto_paths(graph, roadmap.start, roadmap.goals, free=roadmap.arcs_free)
    assert sum(robot.geometry.asked) == paths.stats.arcs_checked < 0.05 * graph.arcs
    assert paths.stats.rounds > 1
    assert not roadmap.arcs_free(paths.blocked).any()
    assert roadmap.arcs_free(paths.all_arcs).all()
    assert paths.blocked.size == paths.stats.arcs_blocked


def test_what_is_found_is_free_and_leads_from_the_start_to_the_goal() -> None:
    asked = problem(Joints(5, 100, 1.4, seed=1))
    front = asked.solve("roadmap", samples=300)
    assert len(front) >= 3
    assert verify(asked, front) == []
    assert front.certificate.startswith("roadmap: exact on the free part of the roadmap of 300 samples (seed 0)")


@pytest.mark.seeds(1, of=30)
def test_weighted_sums_are_those_of_the_roadmap_with_all_edges_checked(seed: int) -> None:
    asked = problem(Joints(3, 40, 0.9, seed=seed))
    roadmap = Roadmap(samples=150).roadmap(asked)
    assert isinstance(roadmap, ConfigurationRoadmap)
    checked = replace(roadmap, lazy=False)
    eager = supported_paths(checked.graph(asked.criteria), checked.start, checked.goals)
    lazy = WeightedSum(on={"roadmap": {"samples": 150}}).solve(asked)
    quanta = [criterion.quantum for criterion in asked.criteria]
    assert np.rint(lazy.planned / quanta).astype(int).tolist() == eager.costs.tolist()
    assert verify(asked, asked.front(lazy)) == []
    stats = lazy.stats
    assert f"; {stats['edges_checked']} of {stats['edges']:,} edges were checked in {stats['rounds']} rounds, " in (
        lazy.certificate
    )
    assert "all extreme supported points of the free part of the roadmap of 150 samples" in lazy.certificate


def test_weighted_sums_tell_what_separates_start_and_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seeking, "STEPS", 20)
    on = {"roadmap": {"samples": 60}}
    found = WeightedSum(on=on).solve(problem(Walled(2), criteria=[Sway("q0"), "duration"]))
    assert found.status is Status.NO_PATH
    assert any("can be reached from the start without a collision" in note for note in found.notes)


def test_where_no_path_leads_that_is_told_of_the_edges_that_are_not_blocked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seeking, "STEPS", 20)
    found = Roadmap(samples=60).solve(problem(Walled(2), criteria=[Sway("q0"), "duration"]))
    assert found.status is Status.NO_PATH
    (told,) = [note for note in found.notes if note.startswith("no path: on the roadmap of 60 samples")]
    assert "of 62 configurations can be reached from the start without a collision, but no goal" in told
    assert any(
        "10 pairs of random trees found no path near which to draw samples: samples are uniform" in note
        for note in found.notes
    )


@criterion("joint_moves", group="R", unit="1", aggregate="sum", quantum=1.0, role="turns")
@dataclass(frozen=True)
class JointMoves:
    """Number of motions, which a planner may bound as turns."""

    def cost(self, m: Motions) -> np.ndarray:
        return np.ones(len(m))


def test_edges_that_collide_do_not_count_as_a_path_with_few_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a path at all, no bound on turns is the reason, although unchecked edges would lead to the goal."""
    monkeypatch.setattr(seeking, "STEPS", 20)
    found = Roadmap(samples=60, max_turns=1).solve(problem(Walled(2), criteria=[JointMoves(), "duration"]))
    assert found.status is Status.NO_PATH
    assert not any("the fewest turns are" in note for note in found.notes)
    assert any("can be reached from the start without a collision, but no goal" in note for note in found.notes)


@pytest.mark.parametrize(("end", "place"), [("start", 0), ("goal", 1)])
def test_an_end_that_is_blocked_is_refused_by_what_blocks_it(end: str, place: int) -> None:
    robot = Joints(3, 60, 1.0)
    inside = tuple(robot.geometry.centres[0])
    with pytest.raises(QueryError, match=rf"the {end} \(.*\) is not usable: a ball is there"):
        Roadmap(samples=20).solve(problem(robot, **{end: inside}))


def test_limits_leave_what_is_free(tmp_path: Path) -> None:
    asked = problem(Joints(4, 150, 1.2, seed=2))
    exact = Roadmap(samples=200).solve(asked)
    rows = {tuple(row) for row in exact.planned.tolist()}
    half = exact.stats["labels_generated"] // 2
    part = Roadmap(samples=200, max_labels=half, checkpoint=tmp_path / "search.ckpt").solve(asked)
    assert part.status is Status.LABEL_LIMIT
    assert "incomplete (label limit): every point is optimal on the free part of" in part.certificate
    searched = ["stage" not in origin for origin in part.provenance]
    assert {tuple(row) for row in part.planned[searched].tolist()} <= rows
    whole = Roadmap(samples=200, checkpoint=tmp_path / "search.ckpt").solve(asked)
    assert whole.planned.tolist() == exact.planned.tolist()
    assert [whole.stats[name] for name in ("edges_checked", "rounds", "labels_generated")] == [
        exact.stats[name] for name in ("edges_checked", "rounds", "labels_generated")
    ]


@criterion("shy", group="R", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Shy:
    """A criterion that has no number for what collides."""

    def cost(self, m: Motions) -> np.ndarray:
        return np.where(m.model.collision(m.world).motions_free(m), 1.0, np.nan)


def test_a_criterion_that_cannot_cost_what_collides_has_all_edges_checked() -> None:
    robot = Joints(3, 60, 1.0)
    found = Roadmap(samples=80).solve(problem(robot, criteria=[Shy(), Sway()]))
    assert len(found.trajectories) >= 1
    assert "edges_checked" not in found.stats
    assert any(note.startswith("all edges were checked for collisions before the search") for note in found.notes)
    with pytest.raises(CriterionError, match="criterion 'never' must cost a finite number"):
        Roadmap(samples=20).solve(problem(robot, criteria=[Never(), Sway()]))


@criterion("never", group="R", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Never:
    def cost(self, m: Motions) -> np.ndarray:
        return np.full(len(m), np.nan)


# Far links


@pytest.mark.seeds(1, of=12)
def test_a_far_link_leads_to_the_nearest_of_as_many_others_as_a_group_has(seed: int) -> None:
    """Each level deals the states into groups: whoever is linked to is the nearest one of its own group."""
    space, rng = Joints(3).space, np.random.default_rng(seed)
    number, count = 400, 12
    states = space.sample(rng, number)
    found = nearest_in_random_subsets(space, states, count, rng, Spending())
    assert found.shape == (count, number)
    assert (found != np.arange(number)).all()
    apart = [space.apart(states, states.take(level)) for level in found]
    ranks = [rank_of(space, states, level) for level in found]
    # The nearest of s states out of n has on average n / (s + 1) nearer ones; s is log-uniform from 1 to n / 2.
    for place, rank in enumerate(ranks):
        most, least = (number / (1 + (number / 2) ** share) for share in (place / count, (place + 1) / count))
        assert 0.6 * least - 1 <= rank.mean() <= 1.5 * most + 1
    assert np.mean(apart[0]) > 3 * np.mean(apart[-1])


def rank_of(space: Any, states: States, level: np.ndarray) -> np.ndarray:
    rows = np.stack([getattr(states, name) for name in space.names], axis=1)
    apart = np.linalg.norm(rows[:, None] - rows, axis=2)
    return (apart < apart[np.arange(len(level)), level][:, None]).sum(axis=1) - 1.0


def test_far_links_make_ways_of_fewer_stops() -> None:
    asked = problem(Joints(6))
    sizes = {
        far: Roadmap(samples=400, far=far, trees=0, neighbours=8).solve(asked).planned[:, 0].min() for far in (0, 24)
    }
    assert sizes[24] <= sizes[0]


def test_a_roadmap_of_one_sample_has_no_far_links() -> None:
    assert Roadmap(samples=1).solve(problem(Joints(2))).status is Status.COMPLETE


def test_options_of_configurations_are_refused_where_positions_are_taken() -> None:
    asked = hpop.Problem(in_plane().world, hpop.DifferentialDrive(radius=0.2), (1, 1, 0), (4, 3, 0), ["length"])
    for options in ({"far": 3}, {"trees": 2}):
        with pytest.raises(OptionError, match="far and trees are options for robots whose roadmap has configurations"):
            Roadmap(samples=20, **options).solve(asked)


def test_they_serve_robots_of_the_plane_that_ask_for_them() -> None:
    front = in_plane(HEAD).solve("roadmap", samples=80, far=6, trees=3, seed=1)
    assert verify(in_plane(HEAD), front) == []
    assert " neighbours and 6 far links of each, 3 guides (paths that random trees found) " in front.certificate


# Guides


def found_by(robot: Joints, goals: np.ndarray | None = None, pairs: int = 6) -> tuple[Connections, list[Guide]]:
    connections = Connections(problem(robot), robot.space)
    ends = np.array([robot.goal]) if goals is None else goals
    return connections, guides(connections, np.array(robot.start), ends, pairs, np.random.default_rng(0), Spending())


@pytest.mark.seeds(1, of=20)
def test_guides_are_free_and_lead_from_the_start_to_a_goal(seed: int) -> None:
    robot = Joints(4, 200, 1.2, seed=seed)
    goals = np.array([robot.goal, (2.0, 2.0, -2.0, -2.0), (0.0, 2.5, 2.5, 2.5)])
    goals = goals[robot.geometry.states_free(Connections(problem(robot), robot.space).states(goals))]
    connections, found = found_by(robot, goals)
    assert found
    for guide in found:
        assert guide.rows[0].tolist() == list(robot.start)
        assert guide.rows[-1].tolist() == goals[guide.goal].tolist()
        assert connections.free(guide.rows[:-1], guide.rows[1:]).all()
        assert (np.abs(guide.rows) <= 3.0).all()
    sizes = [length(guide, connections) for guide in found]
    assert sizes == sorted(sizes)


def test_where_nothing_is_in_between_a_guide_goes_straight() -> None:
    _, found = found_by(Joints(5))
    assert [guide.rows.tolist() for guide in found] == [[[-2.0] * 5, [2.0] * 5]] * 6


def test_shortcuts_keep_to_what_is_free_and_never_lengthen() -> None:
    robot = Joints(2)
    robot.__dict__["geometry"] = Balls(np.array([[0.0, 0.0]]), 1.0)
    connections = Connections(problem(robot), robot.space)
    detour = Guide(np.array([[-2.0, -2.0], [-2.0, 0.0], [-2.0, 2.0], [0.0, 2.0], [2.0, 2.0]]), 0)
    (short,) = shorten([detour], connections)
    assert connections.free(short.rows[:-1], short.rows[1:]).all()
    assert length(short, connections) <= length(detour, connections)
    assert short.rows.tolist() == [[-2.0, -2.0], [-2.0, 2.0], [2.0, 2.0]] or len(short.rows) == 4


@pytest.mark.proof
def test_samples_lie_near_guides_and_where_a_way_may_be_short() -> None:
    robot = Joints(4, 200, 1.2, seed=1)
    asked = problem(robot)
    roadmap = Roadmap(samples=300, seed=4).roadmap(asked)
    connections = Connections(asked, robot.space)
    rows = connections.rows(roadmap.nodes)[1:-1]
    assert roadmap.model.geometry.states_free(connections.states(rows)).all()
    assert len(Roadmap(samples=1, seed=4).solve(asked).planned) >= 1  # the guides alone lead there
    drawn = rows[-300:]
    ends, of_trees = (np.array(robot.start), np.array([robot.goal])), np.random.default_rng(4).spawn(4)[2]
    shortest = length(guides(connections, *ends, 10, of_trees, Spending())[0], connections)
    assert in_informed_set(connections, *ends, 1.6 * shortest, drawn[90:]).all()
    uniform = np.random.default_rng(0).uniform(-3, 3, (2000, 4))
    assert in_informed_set(connections, *ends, 1.6 * shortest, uniform).mean() < 1.0
