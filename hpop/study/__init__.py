"""Studies: what people say of trajectories of a front, from the choice of stimuli to the weights of one person."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.preference import Best, People, Preference, Prior
    from hpop.study.analysis import Analysis, analyse
    from hpop.study.answers import Answers, Choice
    from hpop.study.conditions import Baseline, Condition, pick
    from hpop.study.design import Design
    from hpop.study.design_file import Protocol
    from hpop.study.documents import front_digest
    from hpop.study.folder import Checked, check, prepare
    from hpop.study.forms import Form, score
    from hpop.study.learning import Fitted, fit_criterion
    from hpop.study.leaving import Withdrawal, replace, withdraw
    from hpop.study.page import session_page
    from hpop.study.participants import Participant
    from hpop.study.simulating import simulate
    from hpop.study.statistics import Power, power
    from hpop.study.stimuli import save_stimuli

__all__ = [
    "Analysis",
    "Answers",
    "Baseline",
    "Best",
    "Checked",
    "Choice",
    "Condition",
    "Design",
    "Fitted",
    "Form",
    "Participant",
    "People",
    "Power",
    "Preference",
    "Prior",
    "Protocol",
    "Withdrawal",
    "analyse",
    "check",
    "fit_criterion",
    "front_digest",
    "pick",
    "power",
    "prepare",
    "replace",
    "save_stimuli",
    "score",
    "session_page",
    "simulate",
    "withdraw",
]

_HOMES = {
    "Analysis": "hpop.study.analysis",
    "Answers": "hpop.study.answers",
    "Baseline": "hpop.study.conditions",
    "Best": "hpop.preference",
    "Checked": "hpop.study.folder",
    "Choice": "hpop.study.answers",
    "Condition": "hpop.study.conditions",
    "Design": "hpop.study.design",
    "Fitted": "hpop.study.learning",
    "Form": "hpop.study.forms",
    "Participant": "hpop.study.participants",
    "People": "hpop.preference",
    "Power": "hpop.study.statistics",
    "Preference": "hpop.preference",
    "Prior": "hpop.preference",
    "Protocol": "hpop.study.design_file",
    "Withdrawal": "hpop.study.leaving",
    "analyse": "hpop.study.analysis",
    "check": "hpop.study.folder",
    "fit_criterion": "hpop.study.learning",
    "front_digest": "hpop.study.documents",
    "pick": "hpop.study.conditions",
    "power": "hpop.study.statistics",
    "prepare": "hpop.study.folder",
    "replace": "hpop.study.leaving",
    "save_stimuli": "hpop.study.stimuli",
    "score": "hpop.study.forms",
    "session_page": "hpop.study.page",
    "simulate": "hpop.study.simulating",
    "withdraw": "hpop.study.leaving",
}

__getattr__ = on_first_use(__name__, _HOMES)
