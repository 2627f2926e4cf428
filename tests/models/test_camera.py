"""The field of view: a parameter of models, checked, kept, and all round by default."""

import json
import math

import pytest

from hpop import DifferentialDrive
from hpop.base.registry import make_model, with_optional_members
from hpop.errors import ModelError
from hpop.models.rigid import field_of_view
from hpop.motions import MODEL_DEFAULTS


def test_it_is_kept_with_the_model_and_left_out_where_there_is_none():
    narrow = DifferentialDrive(field_of_view=(1.92, 1.2))
    assert make_model(json.loads(json.dumps(narrow.describe()))) == narrow
    assert "field_of_view" not in DifferentialDrive().describe()["differential_drive"]


def test_a_model_that_does_not_say_sees_all_round_and_a_criterion_may_ask_for_less():
    for model in (DifferentialDrive(), with_optional_members(type("Plain", (), {})(), MODEL_DEFAULTS)):
        assert field_of_view(model) == (2 * math.pi, math.pi)
    narrow = DifferentialDrive(field_of_view=(1.92, 1.2))
    assert field_of_view(narrow) == (1.92, 1.2)
    assert field_of_view(narrow, 3.0) == (3.0, math.pi)


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (1.9, r"field_of_view must be \(horizontal, vertical\) in rad, or None for all round, got 1.9"),
        ((1.0, 1.0, 1.0), r"field_of_view must be \(horizontal, vertical\) in rad"),
        ((0.0, 1.0), r"\(horizontal, vertical\) in rad, each an angle from 1e-06 to 6.28.*, got 0.0"),
        ((110, 60), "to 6.28.*, got 110"),
        ((1.0, 4.0), "to 3.14.*, got 4.0"),
        ((1.0, math.nan), "to 3.14.*, got nan"),
    ],
)
def test_what_is_no_pair_of_angles_is_refused(bad, said):
    with pytest.raises(ModelError, match=said):
        DifferentialDrive(field_of_view=bad)
