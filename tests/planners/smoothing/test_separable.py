"""Derivatives part by part, against those that CasADi takes of whole columns."""

import casadi
import numpy as np
import pytest

from hpop.base import registry
from hpop.base.math import instead_of_hinges
from hpop.criteria import make_criterion
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.motions.symbolic import lift
from hpop.planners.programs.nlp import SparseWorld, moments, vector
from hpop.planners.programs.smoothing.interval import NODES, Forward, Interval
from hpop.planners.programs.smoothing.separable import Separable
from hpop.problems.problem import Problem
from hpop.testing import random_world
from hpop.world import Field
from hpop.world.ground import WHOLE
from tests.own_criteria import LEARNT

FIELD = Field(np.random.default_rng(5).random((7, 9)), 0.3, (1.0, 2.0, 0.4))
OTHER = Field(np.random.default_rng(6).random((5, 5)), 0.5)
SMOOTH = [
    name
    for name in registry.criteria
    if name not in registry.criteria.own()  # what other tests register
    if registry.criteria[name].smooth and registry.criteria[name].aggregate in ("sum", "max")
    if "joints" not in registry.criteria[name].requires  # which no robot on wheels has
]
TARGET = {"target": (5.0, 3.0, 1.0)}
ASKED = {
    "learnt": {"file": str(LEARNT)},
    "optic_flow": {"bearings": 4},
    "peak_optic_flow": {"bearings": 4},
    "look_at": TARGET,
    "view_distance": TARGET,
    "field_exposure": {"good": 60.0, "bad": 120.0},
    "field_worst": {"good": 60.0, "bad": 120.0},
    "time_below": {"limit": 90.0, "width": 20.0},
}
N = 5


def derivatives(x, p, values, slopes, bends, rates, point):
    """Numbers: values, Jacobian and the Hessian of the sum of values times rates."""
    function = casadi.Function("f", [x, p, *rates], [*values, *slopes, bends])
    rng = np.random.default_rng(1)
    return [np.array(part) for part in function(*point, *(rng.normal(size=rate.shape) for rate in rates))]


def by_parts(parts, x, p, point):
    rates = [casadi.MX.sym("r", *y.shape) for y in parts.values]
    return derivatives(x, p, parts.values, parts.slopes, parts.bends(x, p, *rates), rates, point)


def as_a_whole(groups, x, p, point):
    rates = [casadi.MX.sym("r", *y.shape) for y in groups]
    total = sum(casadi.dot(rate, y) for rate, y in zip(rates, groups, strict=True))
    slopes = [casadi.jacobian(casadi.vec(y), x) for y in groups]
    return derivatives(x, p, groups, slopes, casadi.triu(casadi.hessian(total, x)[0]), rates, point)


def assert_same(found, expected):
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(theirs).max(initial=0)))


def test_parts_that_share_variables_have_the_derivatives_of_the_whole():
    x, p = casadi.MX.sym("x", 2 * (N + 1)), casadi.MX.sym("p", N, 2)
    where = np.array([np.arange(N), np.arange(N) + 1, np.arange(N) + N + 1, np.arange(N) + N + 2])

    def formula(a, b, c, d, p, q):
        seen = [FIELD(a + p, c * d), FIELD(b, d), OTHER(a * a, q)]
        first = np.where(a < b, np.exp(seen[0]) * b, np.maximum(c, q)) + np.minimum(seen[1], 0.4) ** 3
        return [first, seen[1] * seen[2] + p], [2.0 * d + q]

    def write(z, given):
        groups = formula(*(lift(z[i], 1) for i in range(4)), *(lift(given[i], 1) for i in range(2)))
        return [casadi.vertcat(*(vector(column, 1) for column in group)) for group in groups]

    parts = Separable.of(write, where, x, p)
    columns = [lift(x[places.tolist()], N) for places in where] + [lift(p[:, i], N) for i in range(2)]
    whole = [casadi.horzcat(*(vector(column, N) for column in group)) for group in formula(*columns)]
    rng = np.random.default_rng(2)
    for low, high in ((0.5, 4.0), (-9.0, 9.0)):  # inside the fields, and beyond their borders
        point = rng.uniform(low, high, x.numel()), rng.normal(size=p.shape)
        assert_same(by_parts(parts, x, p, point), as_a_whole(whole, x, p, point))
    assert (by_parts(parts, x, p, point)[-1] != 0).any()


def test_a_place_may_depend_on_what_is_read_elsewhere():
    x, p = casadi.MX.sym("x", 2 * N), casadi.MX.sym("p", N, 1)
    where = np.arange(2 * N).reshape(2, N)

    def formula(a, b, p):
        near = FIELD(a, b + p)
        far = OTHER(near * a, b)
        return [near + FIELD(a + 0.3 * far, b - near) ** 2, OTHER(b, a)]

    def write(z, given):
        return [casadi.vertcat(*(vector(column, 1) for column in formula(*(lift(s, 1) for s in (z[0], z[1], given)))))]

    parts = Separable.of(write, where, x, p)
    columns = [lift(x[places.tolist()], N) for places in where]
    whole = [casadi.horzcat(*(vector(column, N) for column in formula(*columns, lift(p, N))))]
    rng = np.random.default_rng(4)
    point = rng.uniform(1.0, 2.5, x.numel()), 0.1 * rng.normal(size=p.shape)
    assert_same(by_parts(parts, x, p, point), as_a_whole(whole, x, p, point))


def test_two_variables_of_a_part_may_be_one():
    x, p = casadi.MX.sym("x", 3), casadi.MX.sym("p", 3, 1)
    where = np.array([[0, 1, 2], [1, 1, 0], [2, 2, 2]])  # the second part has x1 twice, the third x2
    parts = Separable.of(lambda z, _: [z[0] ** 2 * z[1] * casadi.exp(z[2])], where, x, p)
    a, b, c = (x[places.tolist()] for places in where)
    rng = np.random.default_rng(8)
    point = rng.normal(size=3), np.zeros(3)
    assert_same(by_parts(parts, x, p, point), as_a_whole([a**2 * b * casadi.exp(c)], x, p, point))


def test_constants_and_zeros_are_values_too():
    x, p = casadi.MX.sym("x", 3), casadi.MX.sym("p", 3, 1)
    parts = Separable.of(lambda z, _: [casadi.vertcat(7.0, 0.0 * z), z], np.arange(3)[None], x, p)
    values, identity, none, one, bends = by_parts(parts, x, p, (np.arange(3.0), np.zeros(3)))
    np.testing.assert_array_equal(values, [[7, 0]] * 3)
    np.testing.assert_array_equal(identity, np.arange(3.0)[:, None])
    assert none.shape == (6, 3)
    assert not none.any()
    np.testing.assert_array_equal(one, np.eye(3))
    assert not bends.any()


def test_a_field_is_read_on_scalar_symbols_only_where_somebody_takes_the_looks():
    x = casadi.SX.sym("x", 1)
    with pytest.raises(TypeError, match="looking"):
        FIELD(lift(x, 1), lift(x, 1))


@pytest.mark.cases(
    "angular_acceleration",
    "clearance",
    "exposure",
    "personal_space",
)
@pytest.mark.parametrize(
    "spec",
    [
        *({name: ASKED[name]} if name in ASKED else name for name in SMOOTH),
        *(pytest.param(name, marks=pytest.mark.proof) for name in SMOOTH if name.endswith("optic_flow")),
    ],
    ids=str,
)
def test_every_smooth_criterion_has_the_derivatives_of_whole_columns(spec):
    rng = np.random.default_rng(3)
    world, model, criterion = random_world(rng), DifferentialDrive(), make_criterion(spec)
    problem = Problem(world, model, (1, 1, 0), (2, 2, 0), ["length"])
    interval = Interval(problem, (criterion,), (WHOLE,), (0.25, 0.75))
    nodes, hinges = len(NODES), interval.hinges
    x, signs = casadi.MX.sym("x", nodes * (N + 1) + (1 + hinges) * N), casadi.MX.sym("signs", N)
    first = np.arange(nodes)[:, None] * (N + 1) + np.arange(N)
    last = nodes * (N + 1) + np.arange(N)
    slacks = last[-1] + 1 + np.arange(hinges * N).reshape(hinges, N)
    parts = Separable.of(interval.write, np.vstack([first, first + 1, last, slacks]), x, signs)

    start, end = (
        States(**{m: lift(x[(first[i] + k).tolist()], N) for i, m in enumerate(NODES)}, clock=lift(clock, N))
        for k, clock in ((0, casadi.MX.zeros(N)), (1, x[last.tolist()]))
    )
    motions = Motions(world.stand_in(SparseWorld), model, Forward(sign=lift(signs, N)), start, end, panels=2)
    batches = moments(motions) if criterion.aggregate == "max" else [motions]
    columns = iter(slacks.tolist())
    token = instead_of_hinges.set(lambda below: lift(x[next(columns)], N))
    whole = [casadi.horzcat(*(vector(criterion.cost(batch), N) for batch in batches))]
    instead_of_hinges.reset(token)
    point = np.concatenate(
        [
            *(begin + np.cumsum(rng.uniform(0.1, 0.3, N + 1)) for begin in (3.0, 4.0)),
            np.cumsum(rng.uniform(0.05, 0.2, N + 1)),
            *rng.uniform(0.3, 0.9, (2, N + 1)),
            rng.uniform(0.2, 0.5, (1 + hinges) * N),
        ]
    )
    rates = [casadi.MX.sym("r", *y.shape) for y in parts.values]
    none = [casadi.MX.zeros(*rate.shape) for rate in rates]
    bends = parts.bends(x, signs, *none[:2], rates[2], *none[3:])
    found = derivatives(x, signs, parts.values[2:3], parts.slopes[2:3], bends, rates[2:3], (point, np.ones(N)))
    assert_same(found, as_a_whole(whole, x, signs, (point, np.ones(N))))
