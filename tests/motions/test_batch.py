"""Batches of motions: integrals, worst moments, and bodies, against quadrature by scipy and closed forms."""

import casadi
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from hpop.errors import UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States, lacking
from hpop.motions.symbolic import SymbolicMotions, lift
from hpop.runtime import limits
from hpop.world import World

WORLD = World.from_polygons([shapely.box(4, 4, 5, 5)], extent=shapely.box(0, 0, 10, 10))
OFF_AXIS = DifferentialDrive(camera_offset=(0.4, -0.2), speed=0.8, acceleration=0.5)
KINDS = ("move", "turn", "run", "spin")

place = st.floats(2.0, 8.0)
angle = st.floats(-3.1, 3.1)


def one(model, kind, x, y, yaw, amount, t0=None):
    """One motion: ``amount`` metres ahead, or ``amount`` radians to the left."""
    straight = kind in ("move", "run")
    start = States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw]))
    end = States(
        x=start.x + straight * amount * np.cos(yaw),
        y=start.y + straight * amount * np.sin(yaw),
        yaw=start.yaw + (not straight) * amount,
    )
    return Motions(WORLD, model, model.laws[kind], start, end, t0=None if t0 is None else np.array([t0]))


def trapezoid(distance, top, acceleration, t):
    """Distance covered at time t of a movement from rest to rest, from the textbook."""
    if distance < top * top / acceleration:
        top = np.sqrt(distance * acceleration)
    ramp, whole = top / acceleration, distance / top + top / acceleration
    t = min(max(t, 0.0), whole)
    if t < ramp:
        return 0.5 * acceleration * t * t
    if t > whole - ramp:
        return distance - 0.5 * acceleration * (whole - t) ** 2
    return top * (t - 0.5 * ramp)


def rest_to_rest(distance, top, acceleration):
    if distance < top * top / acceleration:
        return 2 * np.sqrt(distance / acceleration)
    return distance / top + top / acceleration


def state_at(model, kind, x, y, yaw, amount, t):
    """Time-stamped state of one motion, written down independently of the library; and its duration."""
    size, sign = abs(amount), np.sign(amount)
    loss = model.speed / model.acceleration
    if kind == "move":
        done, whole = model.speed * t, size / model.speed
    elif kind == "run":
        done = trapezoid(size, model.speed, model.acceleration, t)
        whole = rest_to_rest(size, model.speed, model.acceleration)
    else:
        wait = loss / 2 if kind == "turn" else 0.0
        done = trapezoid(size, model.turn_rate, model.turn_acceleration, t - wait)
        whole = rest_to_rest(size, model.turn_rate, model.turn_acceleration) + 2 * wait
    if kind in ("move", "run"):
        return (x + done * np.cos(yaw), y + done * np.sin(yaw), yaw), whole
    return (x, y, yaw + sign * done), whole


def camera_at(model, state):
    x, y, yaw = state
    ahead, left = model.camera_offset
    return (
        x + ahead * np.cos(yaw) - left * np.sin(yaw),
        y + ahead * np.sin(yaw) + left * np.cos(yaw),
    )


@pytest.mark.parametrize("kind", KINDS)
@given(x=place, y=place, yaw=angle, amount=st.floats(0.05, 3.0), sign=st.sampled_from([-1.0, 1.0]))
@settings(max_examples=settings.default.max_examples // 2)
def test_the_integral_of_a_rate_of_the_camera_equals_scipy_quad(kind, x, y, yaw, amount, sign):
    amount = amount * (sign if kind in ("turn", "spin") else 1.0)
    _, whole = state_at(OFF_AXIS, kind, x, y, yaw, amount, 0.0)

    def rate(t):
        cx, cy = camera_at(OFF_AXIS, state_at(OFF_AXIS, kind, x, y, yaw, amount, t)[0])
        return np.sin(1.3 * cx) + cy * cy

    expected = quad(rate, 0.0, whole, limit=200, points=np.linspace(0, whole, 9)[1:-1])[0]
    motions = one(OFF_AXIS, kind, x, y, yaw, amount)
    found = motions.integrate(lambda s: np.sin(1.3 * s.camera.x) + s.camera.y**2)
    assert found.shape == (1,)
    assert found[0] == pytest.approx(expected, rel=2e-5, abs=1e-6)
    assert motions.duration[0] == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_integrals_of_constants_positions_and_time_have_their_closed_forms(kind):
    motions = one(OFF_AXIS, kind, 3.0, 4.0, 0.3, 1.7, t0=5.0)
    T = motions.duration[0]
    assert motions.integrate(lambda s: 1.0)[0] == pytest.approx(T, rel=1e-14)
    assert motions.integrate(lambda s: s.t)[0] == pytest.approx(5.0 * T + T * T / 2, rel=1e-12)
    assert motions.integrate(lambda s: s.t**2)[0] == pytest.approx(((5.0 + T) ** 3 - 5.0**3) / 3, rel=1e-12)
    # All laws are symmetric in time, so the mean of a state is the middle of its ends.
    for name in ("x", "y", "yaw"):
        middle = (getattr(motions.start, name)[0] + getattr(motions.end, name)[0]) / 2
        assert motions.integrate(lambda s, name=name: getattr(s.state, name))[0] == pytest.approx(middle * T)


@pytest.mark.parametrize("kind", ["turn", "spin"])
def test_a_rate_of_the_heading_alone_is_integrated_as_finely_as_one_of_the_position(kind):
    robot = DifferentialDrive()  # with its camera on the axis, so that nothing moves
    motions = one(robot, kind, 3.0, 4.0, 0.3, 3.0)
    whole = motions.duration[0]

    def rate(t):
        return np.cos(3.0 * state_at(robot, kind, 3.0, 4.0, 0.3, 3.0, t)[0][2])

    expected = quad(rate, 0.0, whole, limit=200, points=np.linspace(0, whole, 9)[1:-1])[0]
    assert motions.integrate(lambda s: np.cos(3.0 * s.camera.yaw))[0] == pytest.approx(expected, abs=1e-4)
    assert motions.worst(lambda s: -np.cos(3.0 * s.camera.yaw))[0] == pytest.approx(1.0, abs=0.01)


def test_a_rate_that_reads_nothing_that_changes_is_exact_and_evaluated_once_a_place():
    calls = []

    def rate(s):
        calls.append(s.base.x.size)
        return np.exp(np.sin(17.0 * s.base.x))

    x = np.array([3.3] * 50 + [5.1] * 30 + [3.3])
    states = States(x=x, y=np.full(81, 4.0), yaw=np.linspace(0.0, 1.0, 81))
    end = States(x=x, y=states.y, yaw=states.yaw + 1.5)
    motions = Motions(WORLD, OFF_AXIS, OFF_AXIS.laws["turn"], states, end)
    np.testing.assert_array_equal(motions.integrate(rate), np.exp(np.sin(17.0 * x)) * motions.duration)
    np.testing.assert_array_equal(motions.worst(rate), np.exp(np.sin(17.0 * x)))
    assert calls == [1, 3, 1, 3]  # each time one motion to learn what is read, then the three places


def test_no_motions_cost_nothing():
    nothing = States(x=np.zeros(0), y=np.zeros(0), yaw=np.zeros(0))
    for kind in ("move", "turn"):
        motions = Motions(WORLD, OFF_AXIS, OFF_AXIS.laws[kind], nothing, nothing)
        for rate in (lambda s: s.base.x, lambda s: s.camera.yaw, lambda s: s.speed):
            assert motions.integrate(rate).shape == motions.worst(rate).shape == (0,)


def test_a_rate_that_reads_the_camera_off_the_axis_is_not_constant_during_a_turn():
    motions = one(OFF_AXIS, "turn", 3.0, 4.0, 0.0, 3.0)
    assert motions.worst(lambda s: s.camera.x)[0] > motions.camera.start.x[0] + 0.01


@given(yaw=angle, amount=st.floats(-3.1, 3.1).filter(lambda a: abs(a) > 0.05))
def test_the_worst_moment_of_a_turn_is_within_its_promise_of_the_true_maximum(yaw, amount):
    motions = one(OFF_AXIS, "turn", 5.0, 5.0, yaw, amount)
    yaws = yaw + amount * np.linspace(0, 1, 20001)
    lever, bearing = np.hypot(0.4, 0.2), np.arctan2(-0.2, 0.4)
    true = (5.0 + lever * np.cos(yaws + bearing)).max()
    found = motions.worst(lambda s: s.camera.x)[0]
    assert true - WORLD.cell / 4 <= found <= true + 1e-9


@pytest.mark.parametrize("kind", ["move", "run"])
@given(peak=st.floats(0.0, 4.0))
def test_the_worst_moment_misses_at_most_a_quarter_of_a_cell_times_the_slope(kind, peak):
    motions = one(OFF_AXIS, kind, 2.0, 5.0, 0.0, 4.0)
    found = motions.worst(lambda s: 10.0 - np.abs(s.base.x - 2.0 - peak))[0]
    assert 10.0 - WORLD.cell / 4 - 1e-9 <= found <= 10.0


def test_the_worst_moment_may_be_at_either_end():
    for kind in ("move", "run"):
        motions = one(OFF_AXIS, kind, 2.0, 5.0, 0.0, 1.03)
        assert motions.worst(lambda s: s.base.x)[0] == pytest.approx(3.03, abs=1e-12)
        assert motions.worst(lambda s: -s.base.x)[0] == pytest.approx(-2.0, abs=1e-12)


def test_a_constant_rate_gives_one_worst_value_a_motion():
    assert one(OFF_AXIS, "move", 2.0, 5.0, 0.0, 1.0).worst(lambda s: 3.0).tolist() == [3.0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_costs_the_same_alone_and_among_others(kind):
    singles = [one(OFF_AXIS, kind, 2.0 + i, 3.0, 0.4 * i, 0.2 + 0.5 * i, t0=2.0 * i) for i in range(5)]
    start, end = (
        States(**{n: np.concatenate([getattr(getattr(m, side), n) for m in singles]) for n in ("x", "y", "yaw")})
        for side in ("start", "end")
    )
    batch = Motions(WORLD, OFF_AXIS, OFF_AXIS.laws[kind], start, end, t0=np.arange(5) * 2.0)
    for rate in (lambda s: s.camera.x * s.t, lambda s: np.hypot(s.camera.x, s.camera.y)):
        assert batch.integrate(rate) == pytest.approx(np.concatenate([m.integrate(rate) for m in singles]))
        assert batch.worst(rate).tolist() == [m.worst(rate)[0] for m in singles]


@pytest.mark.parametrize("kind", KINDS)
def test_bodies_have_the_path_length_and_rotation_that_sampling_shows(kind):
    amount = -2.2 if kind in ("turn", "spin") else 2.2
    motions = one(OFF_AXIS, kind, 3.0, 4.0, 0.7, amount)
    whole = motions.duration[0]
    states = [state_at(OFF_AXIS, kind, 3.0, 4.0, 0.7, amount, t)[0] for t in np.linspace(0, whole, 4001)]
    camera = np.array([camera_at(OFF_AXIS, s) for s in states])
    assert motions.camera.length[0] == pytest.approx(np.hypot(*np.diff(camera, axis=0).T).sum(), rel=1e-6)
    base = np.array(states)
    assert motions.base.length[0] == pytest.approx(np.hypot(*np.diff(base[:, :2], axis=0).T).sum(), rel=1e-9)
    assert motions.base.rotation[0] == pytest.approx(base[-1, 2] - base[0, 2])
    assert motions.camera.turned[0] == pytest.approx(abs(base[-1, 2] - base[0, 2]))
    assert (motions.camera.end.x[0], motions.camera.end.y[0]) == pytest.approx(camera[-1])
    assert motions.camera.start.z.tolist() == [OFF_AXIS.camera_height]
    assert motions.base.start.z.tolist() == motions.camera.start.pitch.tolist() == [0.0]


def test_edges_without_time_say_so_when_a_rate_asks_for_it():
    with pytest.raises(UnsupportedCriterion, match="this planner plans without time"):
        one(OFF_AXIS, "move", 3.0, 4.0, 0.7, 1.0).integrate(lambda s: s.t)


def test_a_rate_that_asks_for_a_state_which_the_model_has_not_hears_which_it_has():
    with pytest.raises(AttributeError, match="no state 'tilt'; this model has x, y, yaw"):
        one(OFF_AXIS, "move", 3.0, 4.0, 0.7, 1.0).integrate(lambda s: s.state.tilt)


def test_a_rate_may_ask_for_the_names_and_a_part_of_its_states():
    motions = one(OFF_AXIS, "move", 2.0, 5.0, 0.0, 2.0)

    def rate(s):
        assert s.state.names == ("x", "y", "yaw")
        everything = s.state.take(slice(None))
        assert everything.names == s.state.names
        assert everything.size == s.state.size
        return everything.x

    assert motions.integrate(rate)[0] == pytest.approx(3.0 * motions.duration[0])


def test_a_batch_of_no_motions_costs_nothing():
    nothing = States(x=np.zeros(0), y=np.zeros(0), yaw=np.zeros(0))
    motions = Motions(WORLD, OFF_AXIS, OFF_AXIS.laws["move"], nothing, nothing)
    assert motions.integrate(lambda s: s.base.x).shape == (0,)
    assert motions.worst(lambda s: s.base.x).shape == (0,)


@pytest.mark.parametrize("kind", KINDS)
def test_symbols_give_the_numbers_of_as_many_panels(kind):
    motions = one(OFF_AXIS, kind, 3.0, 4.0, 0.7, 1.3)
    motions = Motions(WORLD, OFF_AXIS, motions.law, motions.start, motions.end, panels=3)
    symbols = SymbolicMotions.of(motions)
    for cost in (
        lambda m: m.integrate(lambda s: np.sin(s.camera.x) + s.camera.y),
        lambda m: m.worst(lambda s: np.sin(s.camera.x) + s.camera.y),
        lambda m: m.duration,
        lambda m: m.camera.length,
        lambda m: m.camera.turned,
    ):
        value, _ = symbols.values_and_jacobian(cost(symbols.motions))
        assert value == pytest.approx(cost(motions), rel=1e-12)


def test_motions_with_numbers_in_some_states_and_symbols_in_others_are_symbolic():
    yaw = lift(casadi.MX.sym("yaw", 1), 1)
    x = np.array([3.0])
    start, end = States(x=x, y=x, yaw=np.array([0.0])), States(x=x, y=x, yaw=yaw)
    motions = Motions(WORLD, OFF_AXIS, OFF_AXIS.laws["spin"], start, end)
    expression = casadi.MX(motions.integrate(lambda s: s.camera.x))
    value = casadi.Function("f", casadi.symvar(expression), [expression])(1.0)
    numbers = Motions(WORLD, OFF_AXIS, motions.law, start, States(x=x, y=x, yaw=np.array([1.0])), panels=3)
    assert float(value) == pytest.approx(numbers.integrate(lambda s: s.camera.x)[0])


def test_what_a_criterion_requires_and_nobody_has_is_missing():
    assert lacking(("camera", "obstacles"), OFF_AXIS, WORLD) == []
    assert lacking(("people", "camera", "arm"), OFF_AXIS, WORLD) == ["arm", "people"]


def long_moves():
    """Return a move of 2 km beside three short ones, 20,000 panels of 0.1 m."""
    world = World.from_polygons([shapely.box(900, 4, 901, 5)], extent=shapely.box(0, 0, 2100, 10))
    x, lengths = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.5, 2000.0, 1.0, 0.0])
    start = States(x=x, y=np.full(4, 2.0), yaw=np.zeros(4))
    end = States(x=x + lengths, y=start.y, yaw=start.yaw)
    model = DifferentialDrive()
    return Motions(world, model, model.laws["move"], start, end)


def test_a_long_motion_is_integrated_in_blocks_to_the_same_cost(monkeypatch):
    sizes = []

    def rate(s):
        sizes.append(s.base.x.size)
        return np.exp(-s.base.x / 500.0)

    expected = [[f(rate)] for f in (long_moves().integrate, long_moves().worst)]
    assert max(sizes) == 40_032  # two nodes a panel: 20,000 panels, 5, 10 and 1
    sizes.clear()
    monkeypatch.setattr("hpop.motions.quadrature.AT_ONCE", 500)
    found = [[f(rate)] for f in (long_moves().integrate, long_moves().worst)]
    assert max(sizes) <= 2 * 2 * 500
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    begins = np.exp(-np.array([1.0, 2.0, 3.0, 4.0]) / 500.0)
    lengths = np.array([0.5, 2000.0, 1.0, 0.0])
    np.testing.assert_allclose(found[0][0], 500.0 * begins * -np.expm1(-lengths / 500.0) / DifferentialDrive().speed)
    np.testing.assert_allclose(found[1][0], begins)


def test_limits_are_asked_between_the_blocks_of_a_long_motion(monkeypatch):
    class Late(Exception):
        pass

    class Limits:
        def check(self, doing, memory=0):
            assert doing == "costs were integrated along motions"
            raise Late

    monkeypatch.setattr("hpop.motions.quadrature.AT_ONCE", 500)
    moves = long_moves()
    for read in (moves.integrate, moves.worst):
        with pytest.raises(Late), limits.within(Limits()):
            read(lambda s: np.exp(-s.base.x))
