"""Planning problem (world, robot model, start, goal and criteria), and a planner for many queries in one world."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any, cast, overload

from hpop.base.arguments import checked_arguments
from hpop.base.options import LEAST, MOST, real
from hpop.base.registry import make_model, with_optional_members
from hpop.base.table import facts_html, picture_html
from hpop.base.text import shown
from hpop.criteria.base import (
    Criterion,
    CriterionSpec,
    check_stand_ins,
    check_usable,
    describe_criterion,
    index_of_role,
    make_criteria,
)
from hpop.criteria.costs import trajectory_costs, with_quanta
from hpop.criteria.performance.landmarks import StopsMissed
from hpop.errors import HpopError, MapError, ModelError, OptionError, QueryError
from hpop.goals import Goal, GoalSet, GoalSpec, Tour, checked_goal
from hpop.models.collision.leaving import world_with_leaving
from hpop.motions import MODEL_DEFAULTS, Model, laws_of
from hpop.motions.states import StateSpec, Values
from hpop.planners.base import Candidates, Planner, PlannerSpec, edge_objectives, make_planner
from hpop.problems import evaluation, solving
from hpop.problems.evaluation import Trace, trace
from hpop.problems.front import Front
from hpop.problems.solving import StageCallback, last_answer, notes_on_landmarks
from hpop.runtime.limits import ProgressCallback, progress_callback
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.predictions import bounded, with_people
from hpop.world.readers.moveit_frames import placed_scene

TourSpec = Tour | Mapping[str, Any] | None


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Problem:
    """Planning problem: find all non-dominated trajectories of a model in a world, from start to goal.

    world     obstacles and free space
    model     the robot with its camera
    start     a state of the model, in the order of ``model.space.names`` or by name: (x m, y m, yaw rad)
    goal      a state, in which angles may be None (any value); or a goal for a body (:class:`hpop.goals.Goal`), such as
              ``{"look_at": {"target": (2, 1, 1.5), "distance": (1, 2)}}``; or a list of alternatives
    criteria  names, instances, or ``{name: {parameter: value}}``, all minimised
    quanta    smallest differences of costs that count, by name of criterion, in its unit; default: the criterion's own
    horizon   s, up to which moving people are predicted; None: until they leave the map or come to an obstacle
    tour      stops to visit on the way, a :class:`hpop.Tour` or a mapping with its parameters; None for no stops

    Objects that the world's planning scene attaches to links are parts of the problem's model.
    In the problem's world, predictions of people end where they become impossible
    (:func:`hpop.world.content.predictions.bounded`); ``notes`` (sentences for the user) say so. Planning, costs and
    pictures use that world. ``read_seconds``, s, and ``read_memory``, bytes, are the time and memory spent on reading
    files; a planner's limits include them.

    Raises MapError, ModelError, QueryError, CriterionError or UnknownName for invalid arguments.
    """

    world: World
    model: Model
    start: tuple[float, ...]
    goal: Values | Goal
    criteria: tuple[Criterion, ...]
    quanta: Mapping[str, float]
    horizon: float | None
    tour: Tour | None
    notes: tuple[str, ...] = field(init=False)
    read_seconds: float = field(default=0.0, init=False)
    read_memory: int = field(default=0, init=False)

    def __init__(
        self,
        world: World,
        model: Model,
        start: StateSpec,
        goal: GoalSpec,
        criteria: Sequence[CriterionSpec],
        *,
        quanta: Mapping[str, float] | None = None,
        horizon: float | None = None,
        tour: TourSpec = None,
    ) -> None:
        if not isinstance(world, World):
            raise MapError(f"world must be a World, such as hpop.World.from_geojson(path), got {shown(world)}")
        if isinstance(model, type) or not isinstance(model, Model):
            raise ModelError(
                f"model must be a robot model, such as hpop.DifferentialDrive(radius=0.3), got {shown(model)}"
                f"{_lacks(model)}"
            )
        model = with_optional_members(model, MODEL_DEFAULTS).with_scene(world)
        world = placed_scene(world, model)
        laws_of(model)
        checked = make_criteria(criteria)
        if horizon is not None:
            horizon = float(real("horizon", horizon, LEAST, MOST, "a time in s", error=QueryError))
        people, notes = bounded(world, horizon)
        world = with_people(world, people)
        stops = None if tour is None else Tour.of(tour).on(model, world)
        checked = tuple(_of_tour(criterion, stops) for criterion in checked)
        for criterion in checked:
            check_usable(criterion, model, world)
        _check_optional(stops, checked)
        check_stand_ins(checked)
        checked = with_quanta(checked, quanta)
        begin = model.space.state(start, what="start")
        world, touching = world_with_leaving(world, model, begin)
        object.__setattr__(self, "world", world)
        object.__setattr__(self, "horizon", horizon)
        object.__setattr__(self, "tour", stops)
        unseen = notes_on_landmarks(world, model, begin, checked)
        strange = world.link_rules.notes_on(model.links, lambda: (solid.name for solid in world.bodies))
        object.__setattr__(self, "notes", (*notes, *touching, *unseen, *strange))
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "start", model.space.values(begin))
        object.__setattr__(self, "goal", checked_goal(goal, model.space))
        if absent := sorted(self.target.requires - model.provides):
            raise QueryError(f"the goal {self.goal} needs a model with {', '.join(absent)}; take another goal or model")
        self.target.reached(model, begin)  # raises the errors of a goal that no state of the model can reach
        object.__setattr__(self, "criteria", checked)
        object.__setattr__(self, "quanta", {name: float(quantum) for name, quantum in (quanta or {}).items()})

    def __repr__(self) -> str:
        names = ", ".join(criterion.name for criterion in self.criteria)
        of = f"{names} of {type(self.model).__name__}"
        return f"<Problem: {of} from {GoalSet((self.start,))} to {self.target} in {self.world!r}>"

    def _repr_html_(self) -> str:
        """Return HTML for a notebook: a table, and a map if :mod:`hpop.view` is imported."""
        criteria = (f"{c.name} ({c.unit})" if c.unit != "1" else c.name for c in self.criteria)
        facts = {"criteria": ", ".join(criteria), "robot": repr(self.model), "world": repr(self.world)}
        facts |= {"start": str(GoalSet((self.start,))), "goal": str(self.target)}
        facts |= {} if self.tour is None else {"tour": self.tour.words}
        return facts_html(list(facts.items())) + picture_html(self)

    @property
    def target(self) -> Goal:
        """Goal as an object of :class:`hpop.goals.Goal`, also if it is a single state."""
        return cast(Goal, GoalSet((self.goal,))) if isinstance(self.goal, tuple) else self.goal

    @property
    def goals(self) -> tuple[Values, ...]:
        """Alternative goal states, with None for open angles; QueryError if the goal is not given by states."""
        if self.target.listed:
            return self.target.listed
        raise QueryError(f"the goal must be a state or a list of states here, got {shown(self.goal)}; give states")

    def solve(
        self,
        planner: PlannerSpec | Sequence[PlannerSpec] = "lattice",
        *,
        progress: ProgressCallback | bool | None = None,
        executor: Executor | None = None,
        **options: Any,
    ) -> Front:
        """Return the front of the trajectories found by one planner, or by several together.

        Parameters
        ----------
        planner : a name with its ``options``, ``{name: {option: value}}``, a planner object, or a list of these
        progress : True shows a line on the terminal; a function is called from time to time with a
            :class:`hpop.runtime.limits.Progress`. The logger "hpop" reports stages (DEBUG) and the result of each
            planner (INFO)
        executor : runs the jobs of planners that solve many programs (processes, Dask, ...); it changes no result
        """
        several = [planner] if isinstance(planner, str) or not isinstance(planner, Sequence) else planner
        if not several:
            raise OptionError("planner must be at least one planner, such as 'lattice', got an empty list")
        with progress_callback(progress) as tell:
            *_, front = self.fronts(several, progress=tell, executor=executor, **options)
        return front

    def fronts(
        self,
        planners: Iterable[PlannerSpec],
        *,
        progress: ProgressCallback | None = None,
        executor: Executor | None = None,
        stage: StageCallback | None = None,
        **options: Any,
    ) -> Iterator[Front]:
        """Run planners one after another; yield the front so far after each, so that a later error loses nothing.

        After an interruption (Ctrl-C) the remaining planners are not run.

        Parameters
        ----------
        stage : called with the front so far after each stage of a planner but its last
            (:meth:`hpop.planners.base.Planner.stages`); later fronts keep each point, or have one at least as good in
            every cost. After an interruption with many points, it is also called with some of them, before all are
            re-evaluated; a second Ctrl-C ends at once
        """
        return solving.fronts(self, planners, options, progress=progress, executor=executor, stage=stage)

    def front(self, candidates: Candidates, progress: ProgressCallback | None = None) -> Front:
        """Return the front of a planner's candidates, re-evaluated by the criteria; see :func:`.solving.front`."""
        return solving.front(self, candidates, progress)

    def keeping(self, margin: float) -> Problem:
        """Return the problem with a distance of ``margin`` m to be kept from standing people; itself if none stand."""
        if not margin or not self.world.content.bodies:
            return self
        return replace(self, world=self.world.keeping(margin))

    def at(self, state: StateSpec, t: float) -> Problem:
        """Return the problem from another state, ``t`` seconds from now.

        Moving people are then at their predicted positions, and continue as predicted. The rest does not change.
        """
        t = real("t", t, 0, MOST, "a time in s", error=QueryError)
        world = with_people(self.world, tuple(person.later(t) for person in self.world.content.people))
        return replace(self, world=world, start=cast(tuple[float, ...], state))  # checked there

    @overload
    def evaluate(self, of: Trajectory, *, also: Sequence[CriterionSpec] = ()) -> dict[str, float]: ...

    @overload
    def evaluate(self, of: Front, *, also: Sequence[CriterionSpec] = ()) -> Front: ...

    def evaluate(self, of: Trajectory | Front, *, also: Sequence[CriterionSpec] = ()) -> dict[str, float] | Front:
        """Return a trajectory's costs by criterion, or a front with further criteria.

        The front must be of a problem with this world, robot, criteria and quanta. The criteria in ``also`` are
        evaluated on its trajectories and become further reported columns. They are not optimised: other trajectories
        may be better in them, and the certificate says so. They are saved with the front, and ``hpop show``
        re-evaluates them too.

        Parameters
        ----------
        also : further criteria, given as those of a problem: ``["sickness", {"obstruction": {"radius": 1.0}}]``

        Raises CriterionError if robot and world lack something that a criterion requires, or if a column of this name
        has other parameters; QueryError for the front of another problem.
        """
        if isinstance(of, Front):
            return evaluation.evaluated(self, of, also)
        criteria = [*self.criteria, *evaluation.requested(self, also, self.criteria)]
        values = trajectory_costs(criteria, [_checked_trajectory(of)], self.world)[0]
        return dict(zip((c.name for c in criteria), values.tolist(), strict=True))

    def trace(self, trajectory: Trajectory) -> Trace:
        """Return how each criterion's cost arises along a trajectory; see :class:`.evaluation.Trace`."""
        return trace(self.criteria, _checked_trajectory(trajectory), self.world)

    def describe(self) -> dict[str, Any]:
        """Return a description for JSON, from which :meth:`from_description` builds an equal problem."""
        return {"world": self.world.describe(), **self.describe_query()}

    def describe_query(self) -> dict[str, Any]:
        """Return the description for JSON, without the world."""
        return {
            "model": self.model.describe(),
            "start": list(self.start),
            "goal": self.target.describe(),
            "criteria": [describe_criterion(criterion) for criterion in self.criteria],
            **({"quanta": dict(self.quanta)} if self.quanta else {}),
            **({} if self.horizon is None else {"horizon": self.horizon}),
            **({} if self.tour is None else {"tour": self.tour.describe()}),
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Problem:
        """Return the problem of a description; an invalid part raises its own error, a missing one QueryError."""
        keys = ("world", "model", "start", "goal", "criteria")
        try:
            world, model, start, goal, criteria = (description[key] for key in keys)
        except (LookupError, TypeError):
            got = list(description) if isinstance(description, Mapping) else description
            raise QueryError(
                f"a problem's description must be a mapping with {', '.join(keys)}, got {shown(got)}; save it again"
            ) from None
        try:
            return cls(
                World.from_description(world),
                make_model(model),
                start,
                goal,
                criteria,
                quanta=description.get("quanta"),
                horizon=description.get("horizon"),
                tour=description.get("tour"),
            )
        except HpopError:
            raise
        except (TypeError, ValueError, AttributeError, LookupError, OverflowError) as error:
            raise QueryError(f"the description of the problem is invalid: {error}; save it again") from None


def _lacks(model: Any) -> str:
    """Return a text on the attributes that a user's model lacks; "" for objects that are no model at all."""
    members = [name for name in vars(Model) if not name.startswith("_")]
    absent = [name for name in members if not hasattr(model, name)]
    if isinstance(model, type) or not 0 < len(absent) < len(members) - 1:
        return ""
    return f", which lacks {', '.join(absent)}; hpop.models.base.PlanarModel derives most of them from parts and laws"


def _of_tour(criterion: Criterion, tour: Tour | None) -> Criterion:
    """Return a criterion; if it counts missed stops (role "stops_missed"), return its copy for a tour."""
    return (
        cast(Criterion, cast(StopsMissed, criterion).of_tour(tour)) if criterion.role == "stops_missed" else criterion
    )


def _check_optional(tour: Tour | None, criteria: Sequence[Criterion]) -> None:
    """Raise QueryError if a tour has optional stops but no criterion counts those that are missed."""
    if tour is not None and tour.optional and index_of_role("stops_missed", criteria) is None:
        names = ", ".join(tour.names[i] for i in tour.optional)
        raise QueryError(
            f"a tour with optional stops ({names}) needs the criterion stops_missed, or they would never be visited; "
            "list it among the criteria, or leave optional out"
        )


def _checked_trajectory(trajectory: Trajectory) -> Trajectory:
    if not isinstance(trajectory, Trajectory):
        raise QueryError(f"expected a trajectory, such as front.knee().trajectory, got {shown(trajectory)}")
    return trajectory


@checked_arguments
class Planning:
    """Planner for many queries, each with its own start and goal, in one world with one robot and fixed criteria.

    If the planner's graph does not depend on the query, as that of a lattice, its free states, arcs and costs are
    computed for the first query and reused. Start and goal are then joined to the graph
    (:mod:`hpop.planners.graphs.joined_ends`). A graph that is drawn for each query, such as a roadmap, is built anew.

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
        """Store what all queries have in common.

        Parameters
        ----------
        planner : name, ``{name: options}`` or object
        question : ``quanta``, ``horizon`` and ``tour`` of every problem, as for :class:`hpop.Problem`
        """
        self.world, self.model, self.criteria = world, model, make_criteria(criteria)
        self.planner: Planner = make_planner(planner).anchored()
        self._question = question

    def problem(self, start: StateSpec, goal: GoalSpec) -> Problem:
        """Return the problem from a start to a goal; QueryError if one is invalid."""
        return Problem(self.world, self.model, start, goal, self.criteria, **self._question)

    def solve(self, start: StateSpec, goal: GoalSpec) -> Front:
        """Return the front from a start to a goal; raises the errors of :meth:`hpop.Problem.solve`."""
        return self.front(self.problem(start, goal))

    def front(self, problem: Problem) -> Front:
        """Return the front of a problem by the planner and its stored graph, without early stages."""
        return last_answer(problem, self.planner)

    def updated(self, world: World) -> Planning:
        """Return a planner for a changed world, which computes again only what the change may affect.

        Arcs of the lattice are checked again where the robot may meet the change. Costs are computed again for those
        arcs. Criteria that depend on the changed content (obstacles, people or zones) are computed for all arcs.
        """
        changed = Planning(world, self.model, self.criteria, self.planner, **self._question)
        family, margin = self.planner.graph_of_drives, self.planner.margin
        if family is not None:
            checked = with_quanta(self.criteria, self._question.get("quanta"))
            criteria = edge_objectives(checked, self.planner.name).optimised
            family.update(self.world.keeping(margin), world.keeping(margin), self.model, criteria)
        return changed
