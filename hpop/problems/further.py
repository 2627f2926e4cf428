"""Further criteria on a front that exists: evaluated on its trajectories, reported beside its costs, not optimised."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.text import shown
from hpop.criteria.base import (
    Criterion,
    CriterionSpec,
    check_usable,
    describe_criterion,
    make_criterion,
    trajectory_costs,
)
from hpop.errors import CriterionError, QueryError
from hpop.frontier.strict_json import plain
from hpop.frontier.union import each_claim
from hpop.planners.objectives import edge_objectives
from hpop.problems.front import Front, question_of

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

ALSO = "also"  # key of a front's problem: what was evaluated beside what it asks for


def evaluated(
    problem: Problem, front: Front, also: Sequence[CriterionSpec], say: Callable[[str], None] | None = None
) -> Front:
    """A front with further criteria as reported columns; see :meth:`hpop.Problem.evaluate`."""
    _check_answers(problem, front)
    known = {criterion.name: criterion for criterion in criteria_of(front)} | claimable(problem)
    columns = front.names + front.reported_names
    wanted = made(problem, also, [criterion for name, criterion in known.items() if name in columns])
    if not wanted:
        return front
    values = trajectory_costs(wanted, front.trajectories, problem.world, say=say)
    names = [criterion.name for criterion in wanted]
    said = f"{{}}; {', '.join(names)} evaluated on what was found, not optimised"
    asked = problem.describe() if front.problem is None else front.problem
    listed = [*asked.get(ALSO, []), *map(describe_criterion, wanted)]
    return replace(
        front,
        reported=np.hstack([front.reported, values]),
        reported_names=(*front.reported_names, *names),
        reported_units=(*front.reported_units, *(criterion.unit for criterion in wanted)),
        certificate=each_claim(front.certificate, said),
        problem={**asked, ALSO: listed},
    )


def made(problem: Problem, also: Sequence[CriterionSpec], there: Sequence[Criterion]) -> list[Criterion]:
    """The criteria asked for, each once, without those that are there.

    Raises CriterionError for what robot and world do not have, and for two of one name with different parameters.
    """
    if isinstance(also, str | Mapping) or not isinstance(also, Sequence):
        raise CriterionError(f"also is a list of criteria such as ['sickness', 'rotation'], got {shown(also)}")
    known, wanted = {criterion.name: criterion for criterion in there}, list[Criterion]()
    for criterion in map(make_criterion, also):
        other = known.setdefault(criterion.name, criterion)
        if other is criterion:
            check_usable(criterion, problem.model, problem.world)
            wanted.append(criterion)
        elif plain(describe_criterion(criterion)) != plain(describe_criterion(other)):
            raise CriterionError(
                f"{criterion.name!r} is there already with other parameters, {shown(other)}, and a name stands for one "
                f"column; got {shown(criterion)}"
            )
    return wanted


def criteria_of(front: Front) -> list[Criterion]:
    """The criteria that were evaluated on a front beside those that its problem asks for."""
    listed = (front.problem or {}).get(ALSO, [])
    if not isinstance(listed, list):
        raise CriterionError(f"a front's further criteria are a list of them, got {shown(listed)}")
    return [make_criterion(spec) for spec in listed]


def claimable(problem: Problem) -> dict[str, Criterion]:
    """Criteria whose costs a front of this problem may hold: those asked for, and what stands in for a mean."""
    additive = [c for c in problem.criteria if c.aggregate != "trajectory"]
    optimised = edge_objectives(additive, "front").optimised if additive else ()
    return {criterion.name: criterion for criterion in (*optimised, *problem.criteria)}


def _check_answers(problem: Problem, front: Front) -> None:
    """Raise QueryError where the front's costs are of another world, robot or criteria."""
    if front.problem is None:
        return
    asked, answered = question_of(plain(problem.describe())), question_of(front.problem)
    differing = [key for key in ("world", "model", "criteria", "quanta") if asked.get(key) != answered.get(key)]
    if differing:
        raise QueryError(
            f"the front answers another problem: {', '.join(differing)} differ; evaluate it by its own, "
            "hpop.Problem.from_description(front.problem)"
        )
