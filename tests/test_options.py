"""Numbers that users give are checked against bounds, whatever they are."""

import contextlib
import dataclasses
import math
from fractions import Fraction

import numpy as np
import pytest

import hpop
from hpop.base.options import real, whole
from hpop.base.registry import criteria, models, planners
from hpop.errors import CriterionError, HpopError, OptionError
from hpop.planners import make_planner


class _Strange:
    def __repr__(self):
        raise RuntimeError("no repr")


NO_NUMBERS = [
    None,
    True,
    np.True_,
    "1",
    "1e-3",
    [1.0],
    np.array([1.0]),
    1j,
    math.nan,
    math.inf,
    -math.inf,
    np.float32("nan"),
]
TOO_LARGE = [1e30, 10**400, -(10**400), 10**5000, 2**63, Fraction(10**400, 3)]


@pytest.mark.parametrize("value", [*NO_NUMBERS, *TOO_LARGE, _Strange()], ids=range(len([*NO_NUMBERS, *TOO_LARGE]) + 1))
@pytest.mark.parametrize("check", [real, whole])
def test_what_is_no_number_within_the_bounds_is_refused_in_a_short_message(check, value):
    with pytest.raises(OptionError, match=r"^step must be a .*number from 0 to 1,000, got") as caught:
        check("step", value, 0, 1000)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("value", [1, 1.5, np.float64(1.5), np.float32(1.5), np.int64(3), Fraction(1, 3), 0, 1000])
def test_numbers_within_the_bounds_come_back_as_numbers_of_python(value):
    assert real("step", value, 0, 1000) == float(value)
    assert type(real("step", value, 0, 1000)) in (int, float)


@pytest.mark.parametrize("value", [1, np.int64(3), np.uint8(7), 0, 1000])
def test_whole_numbers_come_back_as_whole_numbers_of_python(value):
    assert whole("samples", value, 0, 1000) == value
    assert type(whole("samples", value, 0, 1000)) is int


def test_a_number_with_a_fraction_is_no_whole_number():
    with pytest.raises(OptionError, match=r"must be a whole number from 0 to 1,000, got 1\.5"):
        whole("samples", 1.5, 0, 1000)


def test_the_error_is_of_the_kind_that_is_asked_for_and_says_what_the_number_is():
    with pytest.raises(CriterionError, match=r"'fov' must be an angle in rad from 0.001 to 6.28319, got 360"):
        real("'fov'", 360, 1e-3, 2 * math.pi, "an angle in rad", error=CriterionError)


def test_text_that_yaml_did_not_read_as_a_number_is_explained():
    with pytest.raises(OptionError, match=r"YAML reads 1e-3 as text: write 0\.001"):
        real("step", "1e-3", 0, 1)


def test_an_array_in_the_place_of_a_word_or_a_yes_is_refused() -> None:
    with pytest.raises(hpop.errors.ModelError, match="turning must be one of fixed, level, unwound, got array"):
        hpop.ViewModel(hpop.DifferentialDrive(), np.zeros(2))
    for planner in ("lattice", "weighted-sum"):
        with pytest.raises(OptionError, match="corner_cutting must be true or false, got array"):
            make_planner({planner: {"corner_cutting": np.zeros(2)}}, {})


def test_a_number_beyond_the_greatest_is_told_the_greatest() -> None:
    with pytest.raises(OptionError, match="seed must be a whole number from 0 to 9,223,372,036,854,775,807, got"):
        make_planner({"rrt": {"seed": 2**64}}, {})
    with pytest.raises(OptionError, match="seed must be a whole number of at least 0, got -1"):
        make_planner({"rrt": {"seed": -1}}, {})


ODD_ARRAYS = [np.array(0.5), np.array([]), np.ones((2, 2)), np.array([None]), [np.array(0.5)]]


@pytest.mark.parametrize("registry", [criteria, planners, models], ids=["criteria", "planners", "models"])
def test_odd_arrays_as_parameters_of_plugins_are_accepted_or_refused_by_an_error_of_hpop(registry):
    tried = 0
    for name in registry:
        fields = [field for field in dataclasses.fields(registry[name]) if field.init]
        needed = {f.name: 0.5 for f in fields if f.default is f.default_factory is dataclasses.MISSING}
        for field in fields:
            for value in ODD_ARRAYS:
                with contextlib.suppress(HpopError):  # any other error fails the test
                    repr(registry[name](**{**needed, field.name: value}))
                tried += 1
    assert tried > 100
