"""Claims: a front within eps or a tolerance covers the exact one; a stopped search tells how much may be missing."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely

from hpop import DifferentialDrive, Problem, World
from hpop.errors import OptionError, OutputError
from hpop.planners import Lattice
from hpop.runtime.limits import Budget, Progress, Status

ROOM = World.from_polygons(
    [shapely.box(3, 0, 3.4, 3.6), shapely.box(6, 1.6, 6.4, 6), shapely.box(4.5, 4.2, 5, 5)],
    extent=shapely.box(0, 0, 10, 6),
)
QUANTUM_SLACK = 1e-3  # costs of fronts are re-evaluated, those of the search are rounded edge by edge


def problem(criteria=("exposure", "turns", "length")) -> Problem:
    return Problem(ROOM, DifferentialDrive(), (1, 1, 0), (9, 5, None), list(criteria))


def covers(found, exact, eps: float, tolerance) -> bool:
    most = exact.costs * (1 + eps) + np.asarray(tolerance) + QUANTUM_SLACK
    return bool((found.costs[None] <= most[:, None]).all(axis=2).any(axis=1).all())


def test_eps_covers_every_exact_point_with_fewer():
    exact = problem().solve("lattice", step=0.5)
    found = problem().solve("lattice", step=0.5, eps=0.1)
    assert 1 < len(found) < len(exact)
    assert covers(found, exact, 0.1, 0.0)
    assert "is covered within a factor 1.1" in found.certificate
    assert "exact on" not in found.certificate


def test_a_tolerance_is_in_the_units_of_its_cost():
    exact = problem().solve("lattice", step=0.5)
    found = problem().solve("lattice", step=0.5, tolerance={"length": 1.0, "exposure": 0.5})
    assert 1 < len(found) < len(exact)
    assert covers(found, exact, 0.0, [0.5, 0.0, 1.0])
    assert "within 1 in length and 0.5 in exposure" in found.certificate


def test_tolerances_hold_where_turns_only_break_ties():
    asked = problem(("exposure", "length"))
    exact = asked.solve("lattice", step=0.5)
    found = asked.solve("lattice", step=0.5, tolerance={"exposure": 0.4})
    assert len(found) < len(exact)
    assert covers(found, exact, 0.0, [0.4, 0.0])


def test_a_stopped_search_tells_how_much_better_what_is_missing_may_be():
    exact = problem().solve("lattice", step=0.25)
    stopped = problem().solve("lattice", step=0.25, max_labels=exact.runs[0]["labels_generated"] // 2)
    gap = stopped.runs[0]["gap"]
    assert 0 < gap < 1
    assert covers(stopped, exact, gap, 0.0)
    told = re.search(r"at most ([0-9.]+) % worse in every cost", stopped.certificate)
    assert told
    assert 100 * gap <= float(told[1]) * (1 + 1e-6) <= 110 * gap  # rounded up, to two digits


def test_a_stopped_search_with_a_tolerance_claims_no_less_than_that():
    """Found by trying: a way with three turns less is missing, whose other costs no point comes so near."""
    exact, tolerance = problem().solve("lattice", step=0.25), {"turns": 3.0}
    made = Lattice(step=0.25, tolerance=tolerance).solve(problem()).stats["labels_generated"]
    stopped = problem().front(Lattice(step=0.25, tolerance=tolerance, max_labels=int(0.95 * made)).solve(problem()))
    gap = stopped.runs[0]["gap"]
    assert covers(stopped, exact, gap, [0.0, 3.0, 0.0])
    assert not covers(stopped, exact, gap, 0.0)
    assert stopped.certificate.endswith("% worse in every cost, besides 3 in turns")


def test_an_interrupted_search_proves_its_gap_too():
    def stop(progress: Progress) -> None:
        if progress.stage == "search" and progress.front > 3:
            raise KeyboardInterrupt

    exact = problem().solve("lattice", step=0.125)
    front = problem().solve("lattice", step=0.125, progress=stop)
    assert "interrupted" in front.certificate
    assert covers(front, exact, front.runs[0]["gap"], 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"eps": -0.01}, "eps must be a number, such as"),
        ({"eps": "much"}, "eps must be a number, such as"),
        ({"tolerance": 0.1}, "tolerance must map names of costs to amounts"),
        (
            {"tolerance": {"lenght": 0.1}},
            r"tolerance must name costs that the search minimises .*, got 'lenght'. Did you mean 'length'",
        ),
        ({"tolerance": {"length": -1}}, "tolerance of length must be a number from 0"),
        ({"eps": 0.1, "max_detour": 1.2}, "max_detour cannot be combined with eps"),
    ],
)
def test_what_is_no_precision_is_refused(options, message):
    with pytest.raises(OptionError, match=message):
        problem().solve(Lattice(step=0.5, **options))


@pytest.mark.parametrize("wrong", [{"tolerance": {"lenght": 0.1}}, {"checkpoint": "/nowhere/search.ckpt"}])
def test_what_the_last_stage_would_refuse_is_refused_before_the_first(wrong):
    stages, said = [], []
    with pytest.raises((OptionError, OutputError)):
        list(problem().fronts([Lattice(step=0.25, **wrong)], stage=stages.append, progress=said.append))
    assert (stages, said) == ([], [])


def test_at_the_memory_limit_a_note_says_how_many_labels_there_are_and_are_open():
    query = Lattice(step=0.5).query(problem())
    whole = query.exact("lattice", Budget())
    stopped = query.exact("lattice", Budget(max_memory=whole.stats["peak_memory"] - 1))
    assert stopped.status is Status.MEMORY_LIMIT
    made, waiting = stopped.stats["labels_generated"], stopped.stats["labels_open"]
    assert 0 < waiting <= made - stopped.stats["labels_expanded"] + 1  # the source is open, not generated
    (note,) = [note for note in stopped.notes if note.startswith("memory limit")]
    assert f"{made:,} labels" in note
    assert f"{waiting:,} of them still open; raise max_memory" in note
    assert whole.stats["labels_open"] == 0
