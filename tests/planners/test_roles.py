"""Planners know a criterion by its role: a criterion of any name may have it."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import shapely

import hpop
from hpop.base.registry import criteria
from hpop.criteria.base import criterion, index_of_role
from hpop.criteria.comfort.motion import Length
from hpop.criteria.comfort.rotation import Turns
from hpop.planners.programs.epsilon_constraint.grid import Roles

WORLD = hpop.World.from_polygons([shapely.box(2, 1, 3, 3)], extent=shapely.box(0, 0, 5, 4))


@pytest.fixture
def renamed(monkeypatch):
    """Rename turns and length, and list length after another smooth cost."""
    monkeypatch.setattr(criteria, "_types", dict(criteria))

    @criterion("stops", group="C", unit="1", aggregate="sum", smooth=False, quantum=1.0, role="turns")
    @dataclass(frozen=True)
    class Stops(Turns):
        pass

    @criterion("mileage", group="R", unit="m", aggregate="sum", role="length")
    @dataclass(frozen=True)
    class Mileage(Length):
        pass

    return hpop.Problem(
        WORLD, hpop.DifferentialDrive(radius=0.2), (1, 2, 0), (4, 2, 0), ["rotation", "stops", "mileage"]
    )


def test_the_bound_on_turns_holds_for_the_criterion_that_counts_them(renamed):
    stops = index_of_role("turns", renamed.criteria)
    most = int(renamed.solve("lattice", step=0.5).costs[:, stops].min())
    assert renamed.solve("lattice", step=0.5, max_turns=most).costs[:, stops].max() == most
    assert "Raise max_turns" in str(renamed.solve("lattice", step=0.5, max_turns=most - 1).notes)


def test_the_length_is_minimised_unless_said_otherwise_and_bounded_by_the_way_round(renamed):
    roles = Roles.of(renamed.criteria, None, renamed)
    assert roles.criteria[roles.minimise].name == "mileage"
    with pytest.raises(hpop.errors.OptionError, match=r"every trajectory from start to goal has at least 4\.\d+ m"):
        roles.limits({"mileage": 3.1}, renamed)


def test_no_role_is_no_place(renamed):
    assert index_of_role("duration", renamed.criteria) is None
