"""Many queries on one map: what does not depend on start and goal is built once and kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hpop.base.arguments import checked_arguments
from hpop.criteria.base import CriterionSpec, make_criterion
from hpop.criteria.quanta import with_quanta
from hpop.goals import GoalSpec
from hpop.motions import Model
from hpop.motions.space import StateSpec
from hpop.planners.base import Planner, PlannerSpec, edge_objectives, make_planner
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.solving import last_answer
from hpop.world import World


@checked_arguments
class Planning:
    """Answers many queries, each with its own start and goal, in one world with one robot and the same criteria.

    The planner's graph is anchored at the world where its family can be, as the lattice's can; so its free states, its
    arcs and their costs are computed for the first query and used by all others. Start and goal are joined to the
    graph, as they are to any (:mod:`hpop.planners.graphs.joined_ends`). A graph that is drawn for each query, such as a
    roadmap, is built anew.

    Fronts are exact on that graph. They differ from those of ``Problem.solve``, whose lattice goes through the start.

    >>> import hpop, shapely
    >>> world = hpop.World.from_polygons([shapely.box(3, 0, 4, 3)], extent=shapely.box(0, 0, 8, 6))
    >>> robot = hpop.DifferentialDrive(radius=0.3)
    >>> planning = hpop.Planning(world, robot, ["turns", "length"], {"lattice": {"step": 1}})
    >>> [len(planning.solve((1, 1, 0), goal)) for goal in ((7, 1, None), (6.3, 4.4, None))]
    [3, 2]
    """

    def __init__(
        self,
        world: World,
        model: Model,
        criteria: Sequence[CriterionSpec],
        planner: PlannerSpec = "lattice",
        **question: Any,
    ) -> None:
        """Keep what all queries have in common.

        Parameters
        ----------
        planner : name, ``{name: options}`` or object
        question : ``quanta`` and ``horizon`` of every problem, as :class:`hpop.Problem` takes them
        """
        self.world, self.model, self.criteria = world, model, tuple(criteria)
        self.planner: Planner = make_planner(planner).anchored()
        self._question = question

    def problem(self, start: StateSpec, goal: GoalSpec) -> Problem:
        """Return the problem of a query; raises QueryError for ends that make no sense."""
        return Problem(self.world, self.model, start, goal, self.criteria, **self._question)

    def solve(self, start: StateSpec, goal: GoalSpec) -> Front:
        """Return the front between two ends; raises as :meth:`hpop.Problem.solve` does."""
        return self.front(self.problem(start, goal))

    def front(self, problem: Problem) -> Front:
        """Return the front of a problem by the planner that keeps its graph, without stages before the last."""
        return last_answer(problem, self.planner)

    def updated(self, world: World) -> Planning:
        """Return planning in a changed world, which computes again only what the change touches.

        Arcs of the lattice are checked again where the robot may meet the change. Costs are computed again for those
        arcs, and for all arcs by criteria that read of the world what changed: its obstacles, people or zones.
        """
        changed = Planning(world, self.model, self.criteria, self.planner, **self._question)
        family, margin = self.planner.graph_of_drives, self.planner.margin
        if family is not None:
            made = with_quanta(tuple(map(make_criterion, self.criteria)), self._question.get("quanta"))
            criteria = edge_objectives(made, self.planner.name).optimised
            family.update(self.world.keeping(margin), world.keeping(margin), self.model, criteria)
        return changed
