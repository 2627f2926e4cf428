"""What was decided in an analysis, in words: every choice that another person might have made otherwise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hpop.base.text import counted
from hpop.study.answers import Answers, Matrix
from hpop.study.conditions import unlike
from hpop.study.design import Design
from hpop.study.forms import Form
from hpop.study.results import Method
from hpop.study.session import questions_of
from hpop.study.statistics.corrections import Correction
from hpop.study.statistics.related import LEAST_STIMULI

PAPERS_POWER = (
    "It takes each score as another person's. Here the same people answered: how high each answers in general stays in "
    "as noise, and power is lost, the more so the more alike the answers of one person are. Of 1,500 simulated studies "
    "(36 people, shifts 0, .25 and .5 standard deviations) it found a difference in .40, .31 and .26, and Friedman's "
    "test in .46, .72 and .95, at correlations of .3, .6 and .8"
)
DEFAULT = {
    "Test of all stimuli": "Friedman's test, by chi-square, and Kendall's W",
    "Tests of pairs": "Wilcoxon's signed-rank test, two-sided; p is exact for up to 200 people: of all ways to "
    "put signs to the ranks, the share that is as far from even",
    "Differences of zero": "ranked, then left out (Pratt)",
    "Effect sizes": "matched-pairs rank-biserial correlation; |z| / sqrt(people); Hodges and Lehmann's shift with its "
    "interval of 95 %: the shifts that this very test does not reject, ties and zeros included",
    "Missing answers": "a score with a missing item is missing, not smaller. The test of all stimuli takes who has all "
    "scores; a pair takes who has both",
}
PAPER = {
    "Test of all stimuli": f"Kruskal and Wallis' test, by chi-square. {PAPERS_POWER}",
    "Tests of pairs": "Dunn's comparisons of mean ranks, two-sided; against the answers before: Wilcoxon's signed-rank "
    "test by the normal approximation",
    "Differences of zero": "left out before ranking (Wilcoxon, as SPSS does)",
    "Effect sizes": "epsilon squared H / (N - 1) and eta squared (H - k + 1) / (N - k); |z| / sqrt(people)",
    "Missing answers": "a score with a missing item is missing, not smaller; each test takes the scores that there are",
}
CARRY_OVER = (
    "the same test by place instead of stimulus, and the stimuli at the first place alone, where nothing was seen "
    "before. Where the place matters, look at the first place too"
)
CHOICES = (
    "shares with the intervals of 95 % that the exact binomial test leaves (Clopper and Pearson), and its p; who "
    "said neither left out; a favourite was chosen "
    "over each other stimulus, by those who compared all pairs; "
    "strengths by Bradley and Terry, ties as Davidson has them, intervals by people: none where all people answered "
    "alike, which tells nothing of how others would differ"
)


def decided(
    design: Design,
    answers: Answers,
    matrix: Matrix,
    form: str,
    method: Method,
    correction: Correction,
    notes: Sequence[str],
) -> dict[str, str]:
    """Every choice, by what it is about; ``notes`` say what could not be done."""
    complete = int((~np.isnan(matrix.values).any(axis=1)).sum())
    left = [f"{one.participant} {'withdrew' if one.withdrawn else 'dropped out'}" for one in design.left]
    made = dict(DEFAULT if method == "default" else PAPER)
    if method == "default" and len(matrix.conditions) < LEAST_STIMULI:
        made["Test of all stimuli"] = "none: two stimuli are one pair"
    made |= {
        "Questionnaire": _asked(design.form(form)),
        "Correction": f"{correction.title()}, within each table of comparisons. The column p and the intervals "
        "have none: an interval belongs to p, and may leave out 0 where the adjusted p is above .05",
        "Ties": "mean ranks, and variances corrected for them",
        "Quartiles": "by linear interpolation (type 7)",
        "People": f"{counted(len(matrix.people), 'session')}; {complete:,} with all scores",
        "Drop-outs": "; ".join(left) or "nobody left",
        "Faults of sessions": "; ".join(answers.faults) or "none",
        "Orders": "; ".join(design.uneven) or _orders(design),
        "Durations": _durations(design),
        "Carry-over": CARRY_OVER,
        **answers.noted,
        "Dashes in tables": "there is no such number: the still view has no costs, and a test of several rows of a "
        "table stands beside these alone",
    }
    if questions_of(design):
        made["Choices of pairs"] = CHOICES
    if notes:
        made["Not done"] = "; ".join(notes)
    return made


def _asked(form: Form) -> str:
    """Where a form comes from, and when it is asked."""
    when = {"before": "before the first stimulus", "after_each": "once after each", "after_all": "after all"}
    return f"{' '.join(form.source.split())}. Asked {', '.join(when[one] for one in form.when)}"


def _orders(design: Design) -> str:
    """How orders were balanced, where they are."""
    return "drawn at random" if design.order == "random" else f"{design.order}, each as often as any other"


def _durations(design: Design) -> str:
    """How long the stimuli last, and what that means where they differ."""
    if lasting := unlike(design.conditions):
        return f"{lasting}, so a part of what differs may come from how long they last, not from the way"
    lasts = [condition.duration for condition in design.conditions]
    return f"stimuli last {min(lasts):.1f} to {max(lasts):.1f} s"
