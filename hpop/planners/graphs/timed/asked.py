"""What a planner is asked where people move, and whether they do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from hpop.errors import OptionError
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.search.machinery.checkpoint import CheckpointSpec

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


class Asked(NamedTuple):
    """What a planner is asked beside its graph.

    planner    its name
    options    of time
    eps, tolerance, checkpoint, max_turns  as it has them
    in_stages  whether a first answer comes before the exact one
    """

    planner: str
    options: TimeOptions
    eps: float = 0.0
    tolerance: Mapping[str, float] | None = None
    checkpoint: CheckpointSpec | None = None
    max_turns: int | None = None
    in_stages: bool = True


def people_move(problem: Problem) -> bool:
    """Whether somebody moves, so that a planner needs a clock."""
    return any(person.moves for person in problem.world.content.people)


def needless(problem: Problem, options: TimeOptions) -> tuple[str, ...]:
    """A note that names the options of time that are given where nobody moves, so that there is no clock.

    Raises OptionError where a time of arrival is asked for, which would not be kept.
    """
    if people_move(problem):
        return ()
    if options.arrive_by is not None:
        raise OptionError(
            "arrive_by needs a clock, and where nobody moves there is none; leave it out, and list the criterion "
            "'duration'"
        )
    names = ("clock", "hold") if problem.world.content.bodies else ("clock", "hold", "margin")
    given = [name for name in names if getattr(options, name) != getattr(TimeOptions(), name)]
    if not given:
        return ()
    return (f"nobody moves, so there is no clock: {', '.join(given)} did not matter",)
