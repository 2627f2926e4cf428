"""What a planner found among people who move before a deadline, as JSON: it is told again, for it would differ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.motion_table import MotionTable
from hpop.planners.base import Candidates
from hpop.planners.objectives import Objectives
from hpop.status import Status

if TYPE_CHECKING:
    from hpop.problem import Problem


def described_candidates(candidates: Candidates) -> dict[str, Any]:
    """Candidates as JSON."""
    ways = candidates.trajectories
    return {
        "ways": MotionTable.of(ways).describe() if len(ways) else None,
        "planned": candidates.planned.tolist(),
        "tolerance": candidates.tolerance.tolist(),
        "status": str(candidates.status),
        "certificate": candidates.certificate,
        "provenance": list(candidates.provenance),
        "notes": list(candidates.notes),
        "stats": dict(candidates.stats),
    }


def candidates_from(answer: Mapping[str, Any], problem: Problem, objectives: Objectives) -> Candidates:
    """The candidates that :func:`described_candidates` described."""
    shape = (-1, len(objectives.optimised))
    ways = answer["ways"]
    return Candidates(
        objectives=objectives.optimised,
        trajectories=() if ways is None else MotionTable.from_description(problem.model, ways).trajectories(),
        planned=np.array(answer["planned"], float).reshape(shape),
        tolerance=np.array(answer["tolerance"], float).reshape(shape),
        status=Status(answer["status"]),
        certificate=answer["certificate"],
        provenance=tuple(answer["provenance"]),
        notes=tuple(answer["notes"]),
        stats=answer["stats"],
        filters=objectives.filters,
    )
