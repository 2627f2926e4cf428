"""The picture of a drive: a map an event, with all ways that there were to choose from then."""

from __future__ import annotations

import numpy as np
import pytest

import hpop
from hpop.drive.script import Event, performed
from hpop.errors import OptionError
from hpop.view.moments import MOST, draw_drive
from hpop.world import Future, Person
from tests.drive.rooms import planned


@pytest.fixture(scope="module")
def driven():
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    events = [Event(1.0, "close", "north"), Event(3.0, "options"), Event(4.0, "open", "north")]
    return drive, list(performed(drive, events))


def lines(axes, gid):
    return [line for line in axes.lines if line.get_gid() == gid]


def test_each_event_has_a_map_with_its_options_and_what_was_closed(driven):
    drive, happenings = driven
    *maps, last = draw_drive(drive, happenings).axes
    assert [len(lines(axes, "option")) for axes in maps] == [len(h.options) for h in happenings]
    assert [len(lines(axes, "taken")) for axes in maps] == [int(h.taken is not None) for h in happenings]
    closed = [sum(patch.get_gid() == "closed" for patch in axes.patches) for axes in (*maps, last)]
    assert closed == [1, 1, 0, 0]
    titles = [axes.get_title() for axes in maps]
    assert titles == ["1  1.0 s: close: 'north'", "2  3.0 s: options", "3  4.0 s: open: 'north'"]


def test_the_last_map_shows_what_was_driven(driven):
    drive, happenings = driven
    last = draw_drive(drive, happenings).axes[-1]
    (way,) = [line for line in last.lines if line.get_gid() == "driven"]
    np.testing.assert_allclose(way.get_xdata()[[0, -1]], drive.plan.states.x[[0, -1]])
    assert last.get_title() == f"in the end: driven in {drive.plan.duration:.1f} s"


def test_of_many_events_the_first_are_drawn_and_the_title_says_so(driven):
    drive, happenings = driven
    figure = draw_drive(drive, happenings[1:2] * 40)
    assert len(figure.axes) == MOST + 1
    assert f"the first {MOST} of 40 events" in figure.get_suptitle()


def test_a_drive_on_which_nothing_happened_is_no_picture(driven):
    with pytest.raises(OptionError, match="at least one event"):
        draw_drive(driven[0], [])


def test_who_may_do_several_things_is_drawn_while_any_of_them_is_to_come():
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    several = Person(3.0, 3.0, futures=(Future(1, velocity=(0.1, 0.0)), Future(1)), until=4.0)
    happenings = list(performed(drive, [Event(1.0, "people", [several]), Event(6.0, "options")]))
    bodies = [sum(patch.get_gid() == "person" for patch in axes.patches) for axes in draw_drive(drive, happenings).axes]
    assert bodies == [1, 0, 0]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_drive_that_does_not_arrive_is_not_called_driven_and_only_what_is_drawn_is_explained(driven):
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    free = list(performed(drive, [Event(0.5, "options")]))
    assert "closed" not in legend(draw_drive(drive, free))
    shut = list(performed(drive, [Event(1.0, "close", "north"), Event(1.0, "close", "south")]))
    figure = draw_drive(drive, shut)
    assert figure.axes[-1].get_title() == "in the end: it stops before a closed area"
    assert {"robot", "closed"} < set(legend(figure))
    assert "person" not in legend(figure)
    assert "option taken" not in legend(draw_drive(drive, free))
    assert "option" in legend(draw_drive(drive, free))


def test_who_is_there_in_the_end_is_on_the_last_map():
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    stands = hpop.world.Person(10.2, 5.2, name="Ada")
    goes = hpop.world.Person(10.2, 5.6, velocity=(-0.1, 0.0), until=1.0, name="Ben")
    happened = list(performed(drive, [Event(0.5, "people", (stands, goes))]))
    first, last = draw_drive(drive, happened).axes
    shown = [[patch.center for patch in axes.patches if patch.get_gid() == "person"] for axes in (first, last)]
    assert shown == [[(10.2, 5.2), (10.2, 5.6)], [(10.2, 5.2)]]
