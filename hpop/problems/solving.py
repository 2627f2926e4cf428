"""Solution of a problem: run planners one after another, re-evaluate their candidates, and join their fronts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arguments import checked_arguments
from hpop.base.registry import GROUPS
from hpop.base.text import shown, some
from hpop.criteria.base import Criterion, make_criterion
from hpop.criteria.costs import quanta_statement, trajectory_costs
from hpop.criteria.visits import all_visits, hidden_targets, missed_weights
from hpop.errors import NOTE, CriterionError, OptionError, QueryError
from hpop.frontier.dominance import MAX_QUANTA
from hpop.frontier.points import JOINT
from hpop.goals import Goal, GoalSet
from hpop.motions import Model, States
from hpop.planners.base import Candidates, Planner, PlannerSpec, joined, make_planner, stages_of
from hpop.planners.judgement import evaluable_in_time
from hpop.planners.needs import check_goal, refuse_unsupported
from hpop.planners.spending import Spending
from hpop.problems.front import Front
from hpop.runtime.limits import Budget, Progress, ProgressCallback, Status, log
from hpop.search.machinery.checkpoint import Checkpoint
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Landmark
from hpop.world.files import by_names

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

StageCallback = Callable[[Front], None]
SOME = 4_000  # number of points that are re-evaluated and saved within half a second
SOME_WITH_MEMORY = 40  # as SOME, with criteria of the whole trajectory, which take about 8 ms for each point


def notes_on_targets(world: World, model: Model, goal: Goal, trajectories: Sequence[Trajectory]) -> tuple[str, ...]:
    """Return notes for the user on trajectories at whose end an obstacle hides the target of a look_at goal."""
    looks = [(look, look.looked_at) for look in goal.alternatives() if look.looked_at is not None and not look.visible]
    if not looks or not len(trajectories):
        return ()
    names = model.space.names
    ends = States(**{name: np.array([getattr(t.states, name)[-1] for t in trajectories]) for name in names})
    notes = []
    for look, target in looks:
        there = look.reached(model, ends)
        hidden = there & hidden_targets(world, model, ends, target)
        if hidden.any():
            share = "" if hidden.sum() == there.sum() else f"{hidden.sum()} of {there.sum()} trajectories, by number "
            share += "" if not share else some([str(i) for i in np.flatnonzero(hidden).tolist()])
            x, y, z = target
            notes.append(
                f"an obstacle hides the target ({x:g}, {y:g}, {z:g}) of look_at at the end of "
                f"{share or 'all trajectories'}: check its position and height, require visible: true, or list the "
                "criterion 'occlusion'"
            )
    return tuple(notes)


def notes_on_goals(problem: Problem) -> tuple[str, ...]:
    """Return notes for the user on blocked states in a list of goals; states with free angles are not looked at."""
    alternatives = problem.target.alternatives()
    listed = [values for each in alternatives for values in each.listed if None not in values]
    if len(listed) < 2 and len(alternatives) < 2:
        return ()
    space, collision = problem.model.space, problem.model.collision(problem.world)
    reasons = [(values, collision.why_blocked(space.state(values))) for values in listed]
    return tuple(
        f"{GoalSet((values,))}, one of several goals, is left out: {reason}" for values, reason in reasons if reason
    )


def notes_on_landmarks(world: World, model: Model, start: States, criteria: Iterable[Criterion]) -> tuple[str, ...]:
    """Return a note for the user on landmarks that are enclosed by obstacles, if a criterion needs landmarks."""
    if not world.content.landmarks or not any("landmarks" in criterion.requires for criterion in criteria):
        return ()
    pose = model.pose("camera", start)
    camera = tuple(float(np.ravel(column)[0]) for column in (pose.x, pose.y, pose.z))
    walled = [mark for mark in world.content.landmarks if _walled_in(world, mark, camera)]
    if not walled:
        return ()
    walled_names = [f"{mark.name!r} at ({mark.x:.4g}, {mark.y:.4g})" for mark in walled]
    return (
        f"obstacles enclose these landmarks, so that they cannot be seen: {some(walled_names)} (in a map image, white "
        "letters on a dark object are free space within an obstacle): move them, or correct the map",
    )


def notes_on_speed_zones(problem: Problem, trajectories: Sequence[Trajectory], **parts: Any) -> tuple[str, ...]:
    """Return a note for the user if trajectories are too fast in speed zones and no criterion of the problem tells.

    parts  further arguments of `trajectory_costs`
    """
    world, speeding = problem.world, make_criterion("speeding")
    if "speed zones" not in world.content.present or "base" not in problem.model.provides or not len(trajectories):
        return ()
    if any(criterion.name == speeding.name for criterion in problem.criteria):
        return ()
    fast = int((trajectory_costs([speeding], trajectories, world, **parts) > speeding.quantum).sum())
    share = "each trajectory" if fast == len(trajectories) else f"{fast} of {len(trajectories)} trajectories"
    said = (
        f"too fast for speed zones: {share}, because planned speeds do not depend on zones; list the criterion "
        "speeding to see by how much, or use `hpop retime`, which keeps the limits"
    )
    return (said,) if fast else ()


def _walled_in(world: World, mark: Landmark, camera: tuple[float, ...]) -> bool:
    """Return whether obstacles enclose a landmark, so that the camera (x, y, z) can never see it.

    Only obstacles that span all heights between landmark and camera count, and none that contains the landmark.
    """
    low, high = sorted((mark.z, camera[2]))
    if world.has_heights:
        solid: list[BaseGeometry] = [o.polygon for o in world.obstacles if o.z_min <= low and o.z_max >= high]
        raster = world.raster
        if raster is not None and raster.z_min <= low and raster.z_max >= high:
            solid.append(raster.solid())
        region = shapely.difference(world.extent, shapely.union_all(solid))
    else:
        region = world.ground.free_space((low, high)).region
    parts = shapely.get_parts(region)
    position, eye = shapely.Point(mark.x, mark.y), shapely.Point(camera[:2])
    around_mark, around_eye = (parts[shapely.intersects(parts, point)] for point in (position, eye))
    return bool(around_mark.size and around_eye.size) and not any(a.equals(b) for a in around_mark for b in around_eye)


GRACE, MOST_GRACE = 0.03, 0.3  # share of a time limit, and s: by how much the evaluation of results may exceed it


@checked_arguments
def fronts(
    problem: Problem,
    planners: Iterable[PlannerSpec],
    options: Mapping[str, Any],
    *,
    progress: ProgressCallback | None = None,
    executor: Executor | None = None,
    stage: StageCallback | None = None,
) -> Iterator[Front]:
    """Run planners one after another and yield the front so far after each; see :meth:`hpop.Problem.fronts`."""
    made = [make_planner(planner, options) for planner in planners]
    _check_joinable(made)
    _check_checkpoints(made)
    for planner in made:
        refuse_unsupported(planner, problem.model)
        check_goal(problem, planner)
    before: Front | None = None
    for planner in made:
        spending = _spending(problem, planner)
        stages: Candidates | None = None
        last: Candidates | None = None
        try:
            for now in _stages(problem, planner, progress, executor):
                stages = stages if last is None else joined(stages, last)
                last = replace(now, stats={"planner": planner.name, **now.stats})
                if stage is not None and now.status is Status.UNFINISHED:
                    candidates = joined(stages, last)
                    if len(candidates.trajectories):
                        with spending.paused():
                            stage(_union(before, front(problem, candidates)))
        except KeyboardInterrupt:
            if last is not None:
                last = replace(last, status=Status.INTERRUPTED)
            elif before is not None:
                yield replace(before, status=f"{before.status}{JOINT}{Status.INTERRUPTED}")
                return
            else:
                raise
        assert last is not None  # a planner has at least one stage
        save = partial(_save_some, problem, before, stages, stage)
        last = evaluable_in_time(last, partial(_until_limit, spending), partial(front, problem))
        before = _union(before, _evaluated(problem, stages, last, save, progress))
        log.info("%s: %s found, front of %d, %s", planner.name, len(last.trajectories), len(before), last.status)
        yield before
        if Status.INTERRUPTED in before.status:
            return


def last_answer(problem: Problem, planner: Planner) -> Front:
    """Run a planner to its end and return the front of its final result, without earlier stages.

    Raises the errors of :meth:`hpop.Problem.solve`.
    """
    refuse_unsupported(planner, problem.model)
    check_goal(problem, planner)
    spending = _spending(problem, planner)
    try:
        found = planner.solve(problem)
    except QueryError as error:
        _note_map(error, problem)
        raise
    found = replace(found, stats={"planner": planner.name, **found.stats})
    return front(problem, evaluable_in_time(found, partial(_until_limit, spending), partial(front, problem)))


def front(problem: Problem, candidates: Candidates, progress: ProgressCallback | None = None) -> Front:
    """Return the front of a planner's candidates: re-evaluated by the criteria, with dominated ones dropped.

    Every cost in the front is computed by its criterion from the trajectory. If it differs from the sum that the
    planner computed by more than the planner's tolerance, that is a bug, and the certificate says so.
    """
    objectives = (*candidates.objectives, *candidates.filters)
    means = [c for c in problem.criteria if c not in objectives]
    trajectories = candidates.trajectories
    several: dict[str, Any] = {}
    if len(trajectories) > 1:
        several["table"] = MotionTable.of(trajectories)
        if progress is not None:
            several["say"] = lambda done: progress(Progress("evaluation", detail=done))
    costs, reported = (trajectory_costs(some, trajectories, problem.world, **several) for some in (objectives, means))
    for criterion, most in zip(objectives, costs.max(axis=0, initial=0.0).tolist(), strict=True):
        if most > MAX_QUANTA * criterion.quantum:
            raise CriterionError(
                f"costs of {criterion.name} must be at most 2**53 times its quantum {criterion.quantum:g}, got "
                f"{most:.3g} {criterion.unit} on a trajectory; set a coarser quantum, or plan shorter motions"
            )
    provenance, unvisited = candidates.provenance, False
    if problem.tour is not None:
        visits = all_visits(problem.tour, problem.world, trajectories, missed_weights(problem.criteria))
        visited = zip(provenance, visits, strict=True)
        provenance = tuple(origin | {"visits": each.described(problem.tour)} for origin, each in visited)
        unvisited = not all(each.complete for each in visits)
    optimised = costs[:, : len(candidates.objectives)]
    off = np.abs(optimised - candidates.planned) > candidates.tolerance + 1e-9 * np.abs(optimised)
    certificate = candidates.certificate + quanta_statement(objectives, problem.quanta)
    if off.any():
        names = [objectives[j].name for j in np.flatnonzero(off.any(axis=0))]
        certificate = f"NOT VALID: planned and re-evaluated {', '.join(names)} differ, please report ({certificate})"
    if unvisited:
        certificate = f"NOT VALID: a trajectory does not visit all stops, please report ({certificate})"
    notes = [
        *candidates.notes,
        *_empty_groups(problem.criteria),
        *problem.model.notes,
        *problem.model.notes_on(trajectories),
        *problem.notes,
        *notes_on_speed_zones(problem, trajectories, **several),
        *notes_on_goals(problem),
        *notes_on_targets(problem.world, problem.model, problem.target, trajectories),
    ]
    world = problem.world
    is_bare = world.source is None and not (world.content.present or world.content.zones)  # geometry alone is large
    result = Front.of(
        costs,
        trajectories,
        names=[c.name for c in objectives],
        units=[c.unit for c in objectives],
        quanta=[c.quantum for c in objectives],
        groups=[c.group for c in objectives],
        reported=reported,
        reported_names=[c.name for c in means],
        reported_units=[c.unit for c in means],
        status=str(candidates.status),
        certificate=certificate,
        provenance=provenance,
        problem=problem.describe_query() if is_bare else problem.describe(),
        runs=[
            {
                "notes": [by_names(note) for note in notes],
                "evaluated": [c.name for c in candidates.filters],
                **candidates.stats,
            }
        ],
    )
    return result.in_world(world) if is_bare else result


def _spending(problem: Problem, planner: Planner) -> Spending:
    """Return the account of the time that a planner has spent, including the evaluation of its results.

    The time for reading the map counts too if the planner's limits include it.
    """
    budget = planner.budget()
    if budget is None:
        return Spending(Budget(planner.time_limit))
    return Spending(Budget(budget.time_limit), spent=problem.read_seconds)


def _until_limit(spending: Spending) -> float | None:
    """Return the time, s, until a planner's limit, plus the time by which the evaluation of results may exceed it.

    Without this grace, few points could be evaluated. Returns None without a limit.
    """
    limit, until = spending.limits.time_limit, spending.until_limit()
    return None if limit is None or until is None else until + min(GRACE * limit, MOST_GRACE)


def _stages(
    problem: Problem, planner: Planner, progress: ProgressCallback | None, executor: Executor | None
) -> Iterator[Candidates]:
    """Yield a planner's candidates in stages; an error about start or goal gets the notes of the map."""
    try:
        yield from stages_of(planner, problem, progress, executor)
    except QueryError as error:
        _note_map(error, problem)
        raise


def _note_map(error: QueryError, problem: Problem) -> None:
    """Add the notes of the map to an error, since they may explain why start or goal cannot be used."""
    for note in problem.world.notes:
        error.add_note(f"{NOTE}{note}")


def _evaluated(
    problem: Problem,
    stages: Candidates | None,
    last: Candidates,
    save: Callable[[Candidates], bool],
    progress: ProgressCallback | None,
) -> Front:
    """Return the front of a planner's final result and its earlier stages; a first Ctrl-C does not stop this."""
    if progress:
        progress(Progress("evaluation"))
    is_some_saved = save(last)
    try:
        return front(problem, joined(stages, last), progress)
    except KeyboardInterrupt:
        if is_some_saved:
            raise
    last = replace(last, status=Status.INTERRUPTED)
    save(last)
    return front(problem, joined(stages, last), progress)


def _save_some(
    problem: Problem, before: Front | None, stages: Candidates | None, stage: StageCallback | None, last: Candidates
) -> bool:
    """After an interruption with many points, pass a front of some of them to ``stage``; return whether it was done.

    So a second Ctrl-C, during the evaluation of all points, does not lose everything.
    """
    number = SOME_WITH_MEMORY if any(c.aggregate == "trajectory" for c in problem.criteria) else SOME
    if stage is None or last.status is not Status.INTERRUPTED or len(last.trajectories) <= number:
        return False
    some = last.spread(number)
    said = f"; {len(some.trajectories):,} of the {len(last.trajectories):,} points, before the others are re-evaluated"
    some = replace(some, certificate=f"{some.certificate}{said}")
    stage(_union(before, front(problem, joined(stages, some))))
    return True


def _union(before: Front | None, found: Front) -> Front:
    """Return the union of the front so far, if any, and another front."""
    return found if before is None else before | found


def _check_joinable(planners: Iterable[Planner]) -> None:
    """Raise OptionError if some of the planners minimise a time-mean and others its integral."""
    if len({planner.max_detour is not None for planner in planners}) > 1:
        raise OptionError(
            "max_detour must be given to all planners or to none, because with it a planner minimises a mean and "
            "without it the mean's integral, so that their fronts cannot be joined; change the options, or run them "
            "one by one"
        )


def _check_checkpoints(planners: Iterable[Planner]) -> None:
    """Raise OptionError if two searches use one checkpoint file, because each would read the other's state."""
    searches_by_file: dict[str, str] = {}
    for planner in planners:
        for name, checkpoint in _checkpoints(planner):
            file = os.path.realpath(checkpoint.path)
            if file in searches_by_file:
                raise OptionError(
                    f"each search needs its own checkpoint file, but {searches_by_file[file]} and {name} both have "
                    f"{shown(os.fspath(checkpoint.path))}; change the option checkpoint of one, or run them one by one"
                )
            searches_by_file[file] = name


def _checkpoints(planner: Planner) -> Iterator[tuple[str, Checkpoint]]:
    """Yield name and checkpoint file of a planner and of its warm start's planner; leave out those without a file."""
    warm = planner.warm_start
    searches = [(planner.name, planner.checkpoint)]
    for name, options in warm.items() if isinstance(warm, Mapping) else ():
        searches.append((str(name), options.get("checkpoint") if isinstance(options, Mapping) else None))
    yield from ((name, Checkpoint.of(file)) for name, file in searches if file is not None)


def _empty_groups(criteria: Sequence[Criterion]) -> list[str]:
    """Return a reminder for the user of the groups (performance, comfort, robot, others) without a criterion."""
    empty = [name for group, name in GROUPS.items() if all(c.group != group for c in criteria)]
    about = {"robot": "the robot (energy, wear)", "others": "people nearby"}
    words = " or ".join(f"{about.get(name, name)}" for name in empty)
    return [f"none of your criteria is about {words} (hpop explain group)"] if empty else []
