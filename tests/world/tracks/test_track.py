"""Tracks: a person's position at each time, on numbers and on symbols; refusals of other input."""

from __future__ import annotations

import math
import pickle

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import MapError
from hpop.motions.symbolic import lift
from hpop.world import Track

L = Track.through([(0, 0, 0), (2, 2, 0), (3, 2, 1), (5, 2, 1)])  # east, north, then it stands

rising = st.lists(st.integers(0, 20), min_size=2, max_size=6, unique=True).map(sorted)


@st.composite
def tracks(draw: st.DrawFn) -> Track:
    times = draw(rising)
    places = st.lists(st.integers(-3, 3), min_size=len(times), max_size=len(times))
    return Track(times, draw(places), draw(places))


def by_hand(track: Track, t: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Place and velocity, leg by leg."""
    times, x, y = track.times.tolist(), track.x.tolist(), track.y.tolist()
    for i in range(len(times) - 1):
        if times[i] <= t < times[i + 1]:
            length = times[i + 1] - times[i]
            share = (t - times[i]) / length
            place = x[i] + share * (x[i + 1] - x[i]), y[i] + share * (y[i + 1] - y[i])
            return place, ((x[i + 1] - x[i]) / length, (y[i + 1] - y[i]) / length)
    end = -1 if t >= times[-1] else 0
    return (x[end], y[end]), (0.0, 0.0)


@given(tracks(), st.lists(st.integers(-4, 50), min_size=1, max_size=8))
def test_a_track_goes_straight_from_point_to_point(track, halves):
    t = np.array(halves) / 2.0
    places, velocities = np.stack(track.at(t), axis=1), np.stack(track.velocity(t), axis=1)
    for moment, place, velocity in zip(t, places, velocities, strict=True):
        expected = by_hand(track, moment)
        np.testing.assert_allclose(place, expected[0], atol=1e-12)
        np.testing.assert_allclose(velocity, expected[1], atol=1e-12)


@given(tracks(), st.integers(0, 12), st.lists(st.integers(0, 40), min_size=1, max_size=6))
def test_later_tracks_are_the_same_ones_asked_later(track, on, halves):
    t = np.array(halves) / 2.0
    later = track.later(float(on))
    np.testing.assert_allclose(later.at(t), track.at(t + on), atol=1e-12)
    np.testing.assert_allclose(later.velocity(t), track.velocity(t + on), atol=1e-12)


@pytest.mark.parametrize("kind", ["MX", "SX"])
def test_symbols_give_what_numbers_give_and_their_gradient_is_the_velocity(kind):
    symbol = getattr(casadi, kind).sym("t", 9)
    column = lift(symbol, 9)
    outputs = [part.to_casadi() for part in (*L.at(column), *L.velocity(column), *L.ahead(column))]
    outputs.append(casadi.diag(casadi.jacobian(outputs[0], symbol)))
    t = np.array([-1.0, 0.3, 1.5, 2.2, 2.9, 3.5, 4.9, 5.5, 80.0])
    values = [np.asarray(value).ravel() for value in casadi.Function("f", [symbol], outputs)(t)]
    expected = [*L.at(t), *L.velocity(t), *L.ahead(t), L.velocity(t)[0]]
    np.testing.assert_allclose(values, expected, atol=1e-12)


def test_who_stops_faces_where_the_last_steps_led():
    ux, uy = L.ahead(np.array([-1.0, 1.0, 2.5, 4.0, 9.0]))
    assert ux.tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert uy.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]
    assert Track.through([(0, 1, 1), (4, 1, 1)]).ahead(np.zeros(1)) is None


def test_a_part_of_a_track_ends_where_one_is_then():
    part = L.until(2.5)
    assert part == Track.through([(0, 0, 0), (2, 2, 0), (2.5, 2, 0.5)])
    assert L.until(9.0) == L
    with pytest.raises(MapError, match="cannot end at"):
        L.until(0.0)


@pytest.mark.parametrize(
    ("waypoints", "message"),
    [
        ([(0, 0, 0), (2, 1, 0), (1, 2, 0)], "goes back: 2 s at point 1, then 1 s"),
        ([(0, 0, 0), (2, 1, 0), (2, 2, 0)], "the same time twice: 2 s at point 1"),
        ([(0, 0, 0)], "2 to 100,000 points; got 1; a standing person"),
        ([], "2 to 100,000 points; got 0"),
        ([(0, 0, 0), (1, math.nan, 0)], "x of a track must be numbers .* got nan at point 1"),
        ([(0, 0, 0), (math.inf, 1, 0)], "times of a track must be numbers"),
        ([(0, 0, 0), (1, "1", 0)], "x of a track must be a list of numbers"),
        ([(0, 0), (1, 1)], r"waypoints must be a list of \(t, x, y\)"),
        ([1, 2], r"waypoints must be a list of \(t, x, y\)"),
        (7, r"waypoints must be a list of \(t, x, y\)"),
        ([(0, 0, 0), (1, 150, 0)], r"150 m/s, faster than anybody runs .* check the unit"),
        ([(0, 0, 0), (1e-320, 1, 0)], r"inf m/s, faster than anybody runs"),
    ],
)
def test_what_is_no_track_is_refused(waypoints, message):
    with pytest.raises(MapError, match=message):
        Track.through(waypoints)


def test_a_recorded_track_may_jump_but_not_fly():
    jumps = Track([0.0, 0.04, 8.0], [0.0, 0.5, 8.0], [0.0, 0.0, 0.0], recorded=True)
    assert jumps.speed == pytest.approx(12.5)
    with pytest.raises(MapError, match="check the unit"):
        Track([0.0, 1.0, 2.0], [0.0, 130.0, 260.0], [0.0, 0.0, 0.0], recorded=True)
    with pytest.raises(MapError, match="times, x and y of a track must have one length; got 2, 3 and 2"):
        Track([0.0, 1.0], [0.0, 1.0, 2.0], [0.0, 1.0])
    with pytest.raises(MapError, match="recorded must be true or false, got 1"):
        Track([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], recorded=1)


def test_tracks_are_values():
    again = Track(L.times.tolist(), L.x, L.y)
    assert again == L
    assert hash(again) == hash(L)
    assert again != L.later(1.0)
    assert L != "L"
    assert pickle.loads(pickle.dumps(L)) == L
    assert Track(**L.describe()) == L
    recorded = Track(L.times, L.x, L.y, recorded=True)
    assert recorded != L
    assert Track(**recorded.describe()) == recorded
    with pytest.raises(ValueError, match="read-only"):
        L.x[0] = 3.0
    assert repr(L) == "<Track: predicted, 4 points, 0 to 5 s>"


def test_recorded_points_at_all_but_the_same_time_in_two_places_are_refused():
    with pytest.raises(MapError, match="inf m/s, faster than anybody"):
        Track([0.0, 1e-320, 9.0], [0.0, 1.0, 2.0], [0.0, 0.0, 0.0], recorded=True)
    assert Track([0.0, 1e-320, 9.0], [0.0, 0.0, 2.0], [0.0, 0.0, 0.0], recorded=True).speed < 1.0
