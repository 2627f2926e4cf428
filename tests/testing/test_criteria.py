"""Conformance checks: every criterion that comes with hpop passes, and each kind of mistake fails the right check."""

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from hpop.criteria import make_criterion
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.testing import check_criterion, conformance, random_motions, random_world
from tests.faulty_criteria import (
    Base,
    Below,
    Boastful,
    Columns,
    Crowded,
    Failing,
    Flat,
    Grown,
    Haunted,
    Infinite,
    Kinked,
    Likeliest,
    Limited,
    Mean,
    Memory,
    Moody,
    MoodyMemory,
    Negative,
    NegativeMemory,
    NegativeMemoryAtLeft,
    Northward,
    NotANumber,
    NumbersOnly,
    OneForAll,
    OtherOnSymbols,
    Relative,
    Square,
    Timed,
    Tiny,
    TurningMotions,
    Unpicklable,
    Words,
)
from tests.own_criteria import NAMES, own_criterion

FRAME = "costs the same in any frame of the world"
BOUND = "bounds the cost of every trajectory from below"
WALK = "adds up along lattice edges to the trajectory's cost"
PICKLE = "gives the same costs after pickling"
DECLARED = "has valid declarations"
STANDS_IN = "has an integral that costs each motion the same"
FINITE = "costs a finite number >= 0 for each motion"
AGAIN = "gives the same costs when evaluated again"
EDGES = "costs the same on a trajectory as on its edges"
ALONE = "costs a motion the same alone and in a batch"
HALVES = "costs the two halves of a move or hold as much as the whole"
CUT = "costs the same wherever a curve is cut"
SYMBOLS = "has the same value on CasADi symbols"
FUTURES = "takes each possible future of a person into account"
GONE = "ignores people who have left"
GRADIENT = "has a gradient that agrees with finite differences"
SMOOTH_RATE = "has a rate without jumps"


def declaring(**declared):
    """Return a length with other declarations."""
    return type("Declaring", (Base,), {"cost": lambda self, m: m.base.length, **declared})()


DECLARES = {
    "group must be one of P, C, R, O, got 'X'": {"group": "X"},
    "aggregate must be one of sum, time-mean, max, trajectory, got 'total'": {"aggregate": "total"},
    "role must be one of None, duration, length, turns, stops_missed, got 'way'": {"role": "way"},
    "smooth must be one of True, False, got 'yes'": {"smooth": "yes"},
    "world_frame must be one of True, False, got None": {"world_frame": None},
    "unit must be a text that is not empty, got ''": {"unit": ""},
    r"requires must be a tuple of names, such as \('camera',\), got 'camera'": {"requires": "camera"},
    "instead must hold names of registered criteria, got lenght": {"instead": ("lenght",)},
    "quantum must be a positive number, got 0": {"quantum": 0},
    "bound must be a method or None, got 1.0": {"bound": 1.0},
    "convex must be a method or None, got True": {"convex": True},
    "integral must be None unless aggregate is 'time-mean', but aggregate is 'sum'": {"integral": Square()},
}


@pytest.mark.parametrize("said", DECLARES)
def test_a_criterion_is_told_what_it_declares_otherwise_than_its_protocol_asks(said):
    with pytest.raises(CriterionError, match=f"fails 1 check:\n  {DECLARED}: {said}"):
        check_criterion(declaring(**DECLARES[said]))


def test_a_criterion_whose_parameters_could_change_is_told_to_freeze_them():
    declared = {name: value for name, value in vars(Base).items() if not name.startswith("__")}
    Thawed = dataclass(type("Thawed", (), {**declared, "cost": lambda self, m: m.base.length}))
    with pytest.raises(CriterionError, match=r"the dataclass must be frozen.*write @dataclass\(frozen=True\)"):
        check_criterion(Thawed())


@pytest.mark.parametrize(
    ("cost", "said"),
    [
        (lambda self, m: m.integrate(lambda s: 1.0 if s.camera.x > 3 else 0.0), "instead of if write np.where"),
        (
            lambda self, m: m.integrate(lambda s: s.camra.x),
            r"no attribute 'camra'\. Did you mean 'camera'\? It has .*base",
        ),
    ],
)
def test_an_error_in_a_cost_is_told_with_what_to_write(cost, said):
    with pytest.raises(CriterionError, match=said):
        check_criterion(type("Own", (Base,), {"cost": cost})())


def test_what_stands_in_for_a_mean_costs_as_much():
    with pytest.raises(CriterionError, match=f"{STANDS_IN}: wrong of a motion: expected"):
        check_criterion(Mean())


WRONG = [
    (Negative(), FINITE, "0 or more|>= 0"),
    (NotANumber(), FINITE, "nan"),
    (Infinite(), FINITE, "inf"),
    (OneForAll(), FINITE, "shape"),
    (Columns(), FINITE, "shape"),
    (Words(), FINITE, "numbers"),
    (Failing(), FINITE, "AttributeError: .*lenght"),
    (Moody(), AGAIN, "in the second evaluation"),
    (NegativeMemory(), FINITE, "'trajectory' motions cost -"),
    (MoodyMemory(), AGAIN, "in the second evaluation"),
    (Unpicklable(lambda: 1.0), PICKLE, "pickle|lambda"),
    (Relative(), ALONE, "a move alone"),
    (Timed(), EDGES, "this planner plans without time"),
    (Northward(), FRAME, "in another frame"),
    (Crowded(), WALK, "along lattice edges"),
    (Boastful(), BOUND, r"bound\(\) must be at most the cost 2 of a trajectory, and at least 0, got 2.2"),
    pytest.param(Flat(), HALVES, "in two halves", marks=pytest.mark.proof),
    (Flat(1e-5), HALVES, "in two halves"),
    pytest.param(Square(), HALVES, "in two halves", marks=pytest.mark.proof),
    (Square(1e-4), HALVES, "in two halves"),
    (Grown(), HALVES, "in two halves"),
    (TurningMotions(), CUT, "in 2 pieces"),
    (NumbersOnly(), SYMBOLS, "Error"),
    (OtherOnSymbols(), SYMBOLS, "on symbols"),
    (Kinked(), GRADIENT, "d cost/d state"),
    (Likeliest(), FUTURES, "for a person with two futures, the cost must be between"),
    (Haunted(), GONE, "with a person who has left"),
]


@pytest.mark.parametrize(("criterion", "claim", "text"), WRONG, ids=lambda value: type(value).__name__)
def test_a_mistake_fails_the_check_that_names_it(criterion, claim, text):
    with pytest.raises(CriterionError, match=text) as raised:
        check_criterion(criterion)
    first, *faults = str(raised.value).split("\n  ")
    assert first == f"criterion 'wrong' fails {len(faults)} check{'s' * (len(faults) > 1)}:"
    failed = {fault.partition(": ")[0] for fault in faults}
    assert claim in failed
    if isinstance(criterion, (Relative, Flat, TurningMotions, Square, OtherOnSymbols, Kinked, Likeliest, Haunted)):
        assert failed <= {claim, HALVES, CUT, GRADIENT}  # one mistake fails one check where it can


@pytest.mark.parametrize("criterion", [wrong for wrong, claim, _ in WRONG if claim == FINITE], ids=repr)
def test_a_criterion_that_gives_no_costs_is_told_so_once(criterion):
    """Every other check needs costs, and would say the same under a name that misleads."""
    assert [check.claim for check in conformance(criterion)] == [DECLARED, FINITE]


#: Sums, means, worst moments and complements of what another one takes, which is checked.
ALIKE = (
    "peak_optic_flow",
    "mean_heading_mismatch",
    "obstruction",
    "worst_obstruction",
    "openness",
    "landmark_visibility",
    "field_worst",
    "time_below",
    "stale_view",
)
#: Checked in another world by their own tests.
ELSEWHERE = (
    *("against_flow", "cutting_between", "social_force", "speeding", "time_to_collision", "visibility_to_people"),
    *("expected_contacts", "hall_zones"),
)
#: Of a moving camera or of joints: their own tests check them alone, on trajectories and on symbols.
IN_SPACE = ("camera_length", "camera_roll", "hand_eye_misalignment", "joint_length", "joint_limits", "view_distance")
#: Checked with few rays in every run, since few are enough to find a fault.
FEWER = {"optic_flow": {"bearings": 4}}
#: Each is built like one that every run checks: clearance, look_at, joint_energy, o_space, exposure, rotation, jerk.
BESIDE = (
    *("worst_intrusion", "proximity", "heading_mismatch", "singularity", "energy"),
    *("passing_distance", "personal_space", "enclosure", "rotation_time"),
    *("felt_acceleration", "squared_acceleration", "bending_energy", "unseen_landmarks", "speed_changes", "msdv"),
)
IN_PROOF = {*ALIKE, *ELSEWHERE, *IN_SPACE, *FEWER, *BESIDE}
JUMPS = {"occlusion", "energy"}  # see below
PROVED = [
    pytest.param(name, marks=pytest.mark.proof) if name in IN_PROOF else name for name in NAMES if name not in JUMPS
]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.proof) if name == "occlusion" else name for name in sorted(JUMPS)]
)
def test_two_criteria_have_a_rate_that_jumps(name):
    """One counts blocked rays, which jump at an obstacle's corner; one is the energy, where a wheel turns backwards."""
    assert {check.claim for check in conformance(own_criterion(name)) if check.fault} == {SMOOTH_RATE}


@pytest.mark.parametrize("name", PROVED)
def test_every_criterion_that_comes_with_hpop_passes(name):
    """With its defaults; other options and other worlds are in the criterion's own tests."""
    check_criterion(own_criterion(name))


@pytest.mark.proof
@pytest.mark.parametrize("name", FEWER)
def test_criteria_of_many_rays_pass_with_few(name):
    """In a world that is turned few rays look elsewhere."""
    checks = list(conformance(make_criterion({name: FEWER[name]})))
    assert len(checks) >= 11
    assert {check.claim for check in checks if check.fault} <= {FRAME}


LIMITS = {
    "x": (-20.0, -3.3, 0.0, 2.0, 3.3, 5.0, 20.0),
    "y": (-5.0, 0.0, 2.0, 5.0),
    "yaw": (-2.0, 0.0, 1.0),
    "speed": (-2.0, 0.0, 0.05, 0.5, 2.0, 3.3),
    "turn rate": (-1.0, 0.0, 0.3, 2.0),
    "clearance": (0.05, 0.5, 2.0, 5.0),
    "from the origin": (0.5, 2.0, 5.0, 20.0),
    "from a person": (0.1, 0.5, 2.0, 3.3),
}
EVERY = [(quantity, limit) for quantity, limits in LIMITS.items() for limit in limits]
FEW = {("x", -20.0), ("speed", 0.0), ("turn rate", 2.0), ("clearance", 5.0)}


@pytest.mark.parametrize(
    ("quantity", "limit"),
    [case if case in FEW else pytest.param(*case, marks=pytest.mark.proof) for case in EVERY],
)
def test_a_rate_that_jumps_at_a_limit_is_found_wherever_the_limit_is(quantity, limit):
    with pytest.raises(CriterionError, match=f"{SMOOTH_RATE}: the rate jumps from .* let it rise gradually"):
        check_criterion(Limited(quantity, limit))


def test_the_place_and_the_size_of_a_jump_are_told():
    for quantity, limit, where in (("x", 3.3, " near x = 3.3, "), ("speed", 0.5, " at a speed of 0.5 near x = ")):
        checks = conformance(Limited(quantity, limit, more=0.5))
        (fault,) = [check.fault for check in checks if check.claim == SMOOTH_RATE]
        assert re.match(rf"the rate jumps from (1 to 1\.5|1\.5 to 1){where}", fault)


@pytest.mark.cases("x", "from a person")
@pytest.mark.parametrize("quantity", ["x", "speed", "turn rate", "from a person"])
def test_a_rate_that_rises_gradually_passes(quantity):
    claims = {check.claim for check in conformance(Limited(quantity, 0.5, gradually=True)) if check.fault}
    assert SMOOTH_RATE not in claims


@pytest.mark.parametrize(
    "criterion",
    [Below("x", 0.0), Below("y", 0.0), Below("x", -15.0), Below("speed", 0.0), Below("turn rate", -2.0)],
    ids=repr,
)
def test_a_cost_that_is_negative_only_beyond_a_limit_is_found(criterion):
    with pytest.raises(CriterionError, match=f"{FINITE}: .* must cost a finite number >= 0"):
        check_criterion(criterion)


def test_memory_that_is_negative_only_at_negative_positions_is_found():
    with pytest.raises(CriterionError, match=f"{FINITE}: .* 'trajectory' motions cost -"):
        check_criterion(NegativeMemoryAtLeft())


def test_a_good_criterion_in_an_unusual_unit_passes():
    check_criterion(Tiny())


def test_smooth_criteria_alone_are_checked_on_symbols_and_memory_ends_early():
    claims = [check.claim for check in conformance(make_criterion("turns"))]
    assert claims == [DECLARED, FINITE, PICKLE, AGAIN, FRAME, EDGES, WALK, ALONE, HALVES, CUT, SMOOTH_RATE]
    assert [check.claim for check in conformance(make_criterion("length"))] == [
        *claims[:5],
        BOUND,
        *claims[5:],
        SYMBOLS,
        GRADIENT,
    ]
    assert [check.claim for check in conformance(Memory())] == [DECLARED, FINITE, PICKLE, AGAIN, FRAME]
    check_criterion(Memory())


@dataclass(frozen=True)
class OtherOnOneSymbol(Base):
    """Right but on symbols of one motion of a kind, such as one that takes a single row for a number."""

    kind: str = "move"
    smooth: ClassVar[bool] = True

    def cost(self, m):
        alone = not isinstance(m.duration, np.ndarray) and m.duration.shape == (1,) and m.kind == self.kind
        return m.duration * (2.0 if alone else 1.0)


@pytest.mark.parametrize("kind", ["move", "turn", "drive", "hold"])
def test_symbols_of_one_motion_are_looked_at_of_each_kind(kind):
    claims = {check.claim for check in conformance(OtherOnOneSymbol(kind)) if check.fault}
    assert claims == {SYMBOLS}


@pytest.mark.parametrize("kind", ["move", "turn", "drive"])
@pytest.mark.parametrize("size", [1, 40])
def test_random_motions_are_what_they_say(kind, size):
    rng = np.random.default_rng(3)
    world = random_world(rng)
    model = DifferentialDrive()
    m = random_motions(rng, world, model, kind, size)
    assert len(m) == size
    assert (world.clearance(m.start.x, m.start.y) > 0.5).all()
    if kind == "move":
        ahead = np.arctan2(m.end.y - m.start.y, m.end.x - m.start.x)
        assert np.cos(ahead - m.start.yaw) == pytest.approx(1.0)
        assert (m.end.yaw == m.start.yaw).all()
    elif kind == "drive":
        assert m.law.strays(m.start, m.end).max() < 1e-12
        assert (m.base.length < 0.5).all()
        assert size == 1 or np.sign(m.start.turn_rate * m.end.turn_rate).tolist().count(-1.0) == 10
    else:
        assert (m.end.x == m.start.x).all()
        assert (m.base.turned >= 0.2).all()
        assert (m.base.turned < np.pi).all()


def test_the_same_seed_draws_the_same_world():
    one, other = (random_world(np.random.default_rng(5)) for _ in range(2))
    assert [o.polygon.wkb for o in one.obstacles] == [o.polygon.wkb for o in other.obstacles]
