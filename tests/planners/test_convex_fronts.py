"""All planners against fronts that are known: two convex problems with analytic fronts, and one with a dent."""

import math

import numpy as np
import pytest
import shapely
from scipy.integrate import quad
from scipy.optimize import brentq

from hpop.criteria import Clearance, Length
from hpop.models import DifferentialDrive
from hpop.planners import EpsilonConstraint, Lattice, WeightedSum
from hpop.problems.problem import Problem
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
QUADRATURE = 1e-3  # relative: sums over pieces, and fields of 0.1 m cells, against integrals
EIGHT_WAYS = 1 / math.cos(math.pi / 8) - 1  # by how much a way in eight directions may be longer than a curve: 8.2 %

# Length against proximity to a wall: ∫ ds and ∫ ds / y between (-4, 1) and (4, 1) above the wall y = 0.
#
# For the weight w of proximity the best curve is the light ray in a medium of index n(y) = 1 + w / y: n cos(slope) is
# the same all along (Snell), hence n at its apex. For w to infinity it is the geodesic of Poincaré's half-plane, a
# half-circle about (0, 0). The curve depends continuously on w, so the whole front is supported, and
# min (length + w proximity) for all w says all of it.

ACROSS, ABOVE = 4.0, 1.0  # m
WALL = World.from_polygons([], extent=shapely.box(-10, 0, 10, 20))
BESIDE = Problem(WALL, ROBOT, (-ACROSS, ABOVE, 0), (ACROSS, ABOVE, None), ["length", "proximity"])
WEIGHTS = np.geomspace(0.1, 10.0, 7)


def ray(w, apex):
    """Half the width, the length and the proximity of the ray with an apex; y = apex - t² takes away the pole."""

    def integral(of):
        def slice_(t):
            y = apex - t * t
            n, least = 1 + w / y, 1 + w / apex
            return 2 * of(y, n, least) / math.sqrt(w * (n + least) / (y * apex))

        return quad(slice_, 0, math.sqrt(apex - ABOVE))[0]

    return integral(lambda y, n, least: least), integral(lambda y, n, least: n), integral(lambda y, n, least: n / y)


def best(w):
    """Length and proximity of the curve that is best for a weight of proximity."""
    top = math.hypot(ACROSS, ABOVE)
    apex = brentq(lambda a: ray(w, a)[0] - ACROSS, ABOVE + 1e-9, top + 1e-6)
    return tuple(2 * part for part in ray(w, apex)[1:])


def weighted(costs):
    """Least weighted sum of a front for each weight."""
    return np.array([(costs[:, 0] + w * costs[:, 1]).min() for w in WEIGHTS])


def test_the_analytic_front_ends_in_a_straight_line_and_in_a_half_circle():
    assert best(1e-4) == pytest.approx((2 * ACROSS, 2 * ACROSS / ABOVE), rel=1e-3)
    radius = math.hypot(ACROSS, ABOVE)
    half_circle = (2 * radius * math.atan2(ACROSS, ABOVE), 2 * math.log((radius + ACROSS) / ABOVE))
    assert best(1e5) == pytest.approx(half_circle, rel=1e-4)


@pytest.mark.parametrize(
    ("planner", "options", "above"),
    [
        ("lattice", {"step": 0.5}, EIGHT_WAYS),
        pytest.param("lattice", {"step": 0.25}, EIGHT_WAYS, marks=pytest.mark.proof),
        ("weighted-sum", {"step": 0.5}, EIGHT_WAYS),
        pytest.param(
            "epsilon-constraint", {"step": 0.5}, 0.02, marks=pytest.mark.proof
        ),  # few segments, as lattices have
        ("any-angle", {"step": 0.5}, EIGHT_WAYS),
        pytest.param("roadmap", {"samples": 300}, 0.05, marks=pytest.mark.proof),
    ],
)
def test_length_against_proximity_to_a_wall(planner, options, above):
    front = BESIDE.solve(planner, **options)
    least = np.array([length + w * proximity for w in WEIGHTS for length, proximity in [best(w)]])
    assert (weighted(front.costs) >= least * (1 - QUADRATURE)).all()
    assert (weighted(front.costs) <= least * (1 + above)).all()


def test_on_a_convex_front_weighted_sums_are_all_that_the_lattice_has_for_a_weight():
    lattice, sums = (planner(step=0.5).solve(BESIDE).planned for planner in (Lattice, WeightedSum))
    assert weighted(sums) == pytest.approx(weighted(lattice), rel=1e-12)


# Length against the least distance kept from a disc: two tangents of the circle of that distance, and its arc between.
# Its length is a convex function of the radius, since its derivative 2 asin(radius / half) rises.

HALF, DISC, ENOUGH = 4.0, 1.0, 2.5  # m: start and goal are HALF from the centre of the disc
ROUND = World.from_polygons([shapely.Point(0, 0).buffer(DISC, quad_segs=64)], extent=shapely.box(-8, -8, 8, 8))
PAST = Problem(ROUND, ROBOT, (-HALF, 0, 0), (HALF, 0, None), [Length(), Clearance(enough=ENOUGH)])


def shortest(shortfall):
    """Least length of a curve that keeps ENOUGH - shortfall from the disc."""
    radius = DISC + ENOUGH - shortfall
    return 2 * math.sqrt(HALF**2 - radius**2) + 2 * radius * math.asin(radius / HALF)


@pytest.mark.parametrize(
    ("planner", "options", "above"),
    [
        ("lattice", {"step": 0.5}, EIGHT_WAYS),
        pytest.param(
            "epsilon-constraint", {"step": 0.5}, 0.03, marks=pytest.mark.proof
        ),  # few segments, as lattices have
        ("weighted-sum-corridor", {"step": 0.5}, 0.07),  # tangents of the disc in place of the disc
        ("any-angle", {"step": 0.5}, 0.1),  # corners on the lattice's grid
        pytest.param("roadmap", {"samples": 300}, 0.12, marks=pytest.mark.proof),  # random corners
    ],
)
def test_length_against_distance_from_a_disc(planner, options, above):
    costs = PAST.solve(planner, **options).costs
    least = np.array([shortest(shortfall) for shortfall in costs[:, 1]])
    assert (costs[:, 0] >= least * (1 - QUADRATURE)).all()
    assert (costs[:, 0] <= least * (1 + above)).all()
    assert costs[:, 1].max() >= 2.0
    assert costs[:, 1].min() < 0.7


# A front with a dent: ways past a block, one side or the other.

BLOCK = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
DENT = Problem(BLOCK, ROBOT, (1, 2, 0), (5, 2, None), ["length", "exposure"])


@pytest.fixture(scope="module")
def dented(hull):
    """Return the lattice's front, exact in quanta, and those of its points that are not supported."""
    front = in_quanta(Lattice(step=0.5).solve(DENT))
    unsupported = {y for y in front if not hull.supported(y, front)}
    assert len(unsupported) >= 5
    assert set(front) - unsupported == hull.extreme(front)  # so none is supported without being a corner
    return front, unsupported


def in_quanta(candidates):
    quanta = np.array([criterion.quantum for criterion in candidates.objectives])
    return [tuple(row) for row in np.rint(candidates.planned / quanta).astype(int).tolist()]


def test_weighted_sums_miss_exactly_the_unsupported_points(dented):
    front, unsupported = dented
    assert set(front) - set(in_quanta(WeightedSum(step=0.5).solve(DENT))) == unsupported


@pytest.mark.proof
def test_epsilon_constraint_finds_what_weighted_sums_miss(dented):
    """A point at or below each unsupported point of the lattice; in `make test`, below every point of a coarser one."""
    _, unsupported = dented
    candidates = EpsilonConstraint(step=0.5).solve(DENT)
    quanta = np.array([criterion.quantum for criterion in candidates.objectives])
    costs = DENT.front(candidates).costs
    for y in np.array(sorted(unsupported)) * quanta:
        assert (costs <= y * (1 + 1e-3)).all(axis=1).any()
