"""Preferences of a person: weights of costs learnt from choices, the next question, and the best point of a front."""

from __future__ import annotations

from hpop.preference.answers import PairAnswer
from hpop.preference.fit_check import FitCheck
from hpop.preference.people import People
from hpop.preference.posterior import Best
from hpop.preference.preference import Preference
from hpop.preference.prior import Prior

__all__ = ["Best", "FitCheck", "PairAnswer", "People", "Preference", "Prior"]
