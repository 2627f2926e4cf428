"""Studies in which people rate or compare trajectories of a front: design, pages, answers, statistics, learning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:
    from hpop.preference import Best as Best
    from hpop.preference import FitCheck as FitCheck
    from hpop.preference import People as People
    from hpop.preference import Preference as Preference
    from hpop.preference import Prior as Prior
    from hpop.study import documents as documents
    from hpop.study import folder as folder
    from hpop.study.analysis import Analysis as Analysis
    from hpop.study.analysis import analyse as analyse
    from hpop.study.answers import Answers as Answers
    from hpop.study.answers import Choice as Choice
    from hpop.study.conditions import Baseline as Baseline
    from hpop.study.conditions import Condition as Condition
    from hpop.study.conditions import pick as pick
    from hpop.study.design import Design as Design
    from hpop.study.documents import front_digest as front_digest
    from hpop.study.folder import Checked as Checked
    from hpop.study.folder import Withdrawal as Withdrawal
    from hpop.study.folder import check as check
    from hpop.study.folder import prepare as prepare
    from hpop.study.folder import replace as replace
    from hpop.study.folder import withdraw as withdraw
    from hpop.study.forms import Form as Form
    from hpop.study.forms import score as score
    from hpop.study.learning import Fitted as Fitted
    from hpop.study.learning import fit_criterion as fit_criterion
    from hpop.study.page import save_stimuli as save_stimuli
    from hpop.study.page import session_page as session_page
    from hpop.study.participants import Participant as Participant
    from hpop.study.preregister import preregistration as preregistration
    from hpop.study.protocol import Protocol as Protocol
    from hpop.study.simulated import simulate as simulate
    from hpop.study.statistics import Power as Power
    from hpop.study.statistics import power as power
    from hpop.study.tasks import dwell as dwell

_HOMES = homes_of(__name__)
__all__ = [name for name, home in _HOMES.items() if home]
__getattr__ = on_first_use(__name__, _HOMES)
