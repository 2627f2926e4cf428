"""What is asked of the planner of a drive: the graph is laid out once and kept, as is what was found on it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from hpop.arrays import IntArray
from hpop.drive.answers import candidates_from, described_candidates
from hpop.drive.known import Known
from hpop.drive.options import Commit
from hpop.drive.surroundings import Surroundings
from hpop.drive.ways import Ways
from hpop.errors import DriveError
from hpop.options import LEAST
from hpop.planners.base import Candidates, Planner
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.lattice import Lattice
from hpop.planners.objectives import edge_objectives
from hpop.planners.roadmap import Roadmap
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problem import Problem


class Found(NamedTuple):
    """What was found from where a drive may leave its plan.

    gap     every missing vector is covered by one that was found within the factor 1 + gap
    labels  count  partial paths that the search made
    answer  where a deadline cut it short, what was found, as JSON, by which it is repeated; else None
    """

    candidates: Candidates
    gap: float
    labels: int
    answer: dict[str, Any] | None


class Network:
    """The graph of a drive between its changes, and the ways that are known on it."""

    def __init__(self, problem: Problem, planner: Planner, ways: Sequence[Trajectory]) -> None:
        self.problem, self.planner = problem, planner
        self.objectives = edge_objectives(problem.criteria, planner.name)
        self._given = tuple(ways)
        self._ways: Ways | None = None
        self._arcs: list[IntArray] = []  # of the ways that were given
        self._known: Known | None = None
        self._last: list[IntArray] = []  # what was found last

    def found(
        self,
        now: Surroundings,
        commit: Commit,
        kept: Trajectory | None,
        deadline: float,
        answer: Mapping[str, Any] | None = None,
    ) -> Found:
        """Ways from a commit on, as the world is now.

        kept      the present plan from there, if it is open
        deadline  s of this thread's processor time
        answer    what was found when this was asked before, if a deadline cut that short
        """
        problem = now.at(commit.state, commit.time)
        if now.moving:
            return self._in_time(problem, deadline, answer)
        return self._on_graph(now, problem, commit, kept, deadline, answer)

    def _in_time(self, problem: Problem, deadline: float, answer: Mapping[str, Any] | None) -> Found:
        """What the planner finds among people who move, from the very beginning."""
        if answer is None:
            limited = replace(self.planner, time_limit=max(deadline, LEAST))  # type: ignore[type-var]
            candidates = limited.solve(problem)
        else:
            candidates = candidates_from(answer, problem, self.objectives)
        final = candidates.status.is_final
        gap = candidates.stats.get("gap", 0.0 if final else None)  # none is proved where nothing was searched
        labels = int(candidates.stats.get("labels_generated", 0))
        again = None if final else described_candidates(candidates)
        return Found(candidates, math.inf if gap is None else gap, labels, again)

    def _on_graph(
        self,
        now: Surroundings,
        problem: Problem,
        commit: Commit,
        kept: Trajectory | None,
        deadline: float,
        answer: Mapping[str, Any] | None,
    ) -> Found:
        """What a search on the graph finds, beside what is known."""
        ways = self.ways(now)
        node = int(ways.nodes(commit.state)[0])
        rests, present = list[IntArray](), None
        if node < 0:
            ways = ways.from_beside(problem)
            node = ways.query.start
        elif answer is None:
            assert self._known is not None
            rests = [arcs for known in (self._known, ways.known(self._last)) for arcs in known.rests(node)]
            present = None if kept is None else ways.whole_way(kept)
        paths = ways.rests(node, rests, present, deadline) if answer is None else ways.told(node, answer)
        if ways is self._ways:
            self._last = paths.places
        again = None
        if not paths.status.is_final:
            gap = paths.gap if math.isfinite(paths.gap) else None
            arcs = [arcs.tolist() for arcs in paths.places]
            again = {"status": str(paths.status), "gap": gap, "labels": paths.stats.labels_generated, "arcs": arcs}
        return Found(ways.candidates(node, paths), paths.gap, paths.stats.labels_generated, again)

    def ways(self, now: Surroundings) -> Ways:
        """The graph with the costs and closings of now; laid out when it is first asked for."""
        if self._ways is None:
            problem = now.problem.at(self.problem.start, 0.0)
            self._ways = Ways.laid_out(self.planner.name, self._inner(now), problem, self.objectives, now.closed)
            self._arcs = self._ways.ways_of(self._given)
        elif self._ways.world is now.problem.world:
            return self._ways
        else:
            others = self._ways.world.content.people != now.people
            self._ways = self._ways.changed(now.problem.world, now.closed, people=others)
        self._known = self._ways.known(self._arcs)
        _ = self._ways.prepared  # ahead of the next question
        return self._ways

    def _inner(self, now: Surroundings) -> StateGraph:
        """The planner's graph of states, in the bare world."""
        made: Any = None
        if isinstance(self.planner, Lattice):
            made = self.planner.lattice(self.problem)
        elif isinstance(self.planner, Roadmap):
            made = self.planner.roadmap(self.problem)
        if not isinstance(made, StateGraph):
            raise DriveError(
                f"a drive is followed on a lattice, or on a roadmap of positions; {self.planner.name!r} has neither "
                "for this robot: give planner='lattice'"
            )
        return made if made.world is now.bare else replace(made, world=now.bare)
