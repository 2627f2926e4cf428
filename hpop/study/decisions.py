"""What was decided in an analysis, in words: every choice that another person might have made otherwise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hpop.study.answers import Answers, Matrix
from hpop.study.design import Design
from hpop.study.results import Method
from hpop.study.session import questions_of
from hpop.study.statistics.corrections import Correction
from hpop.study.statistics.related import LEAST_STIMULI
from hpop.text import counted

PAPERS_POWER = (
    "It takes each score as another person's. Here the same people answered: how high each answers in general stays in "
    "as noise, and power is lost, the more so the more alike the answers of one person are. Of 1,500 simulated studies "
    "(36 people, shifts 0, .25 and .5 standard deviations) it found a difference in .40, .31 and .26, and Friedman's "
    "test in .46, .72 and .95, at correlations of .3, .6 and .8"
)
DEFAULT = {
    "Test of all stimuli": "Friedman's test, by chi-square, and Kendall's W",
    "Tests of pairs": "Wilcoxon's signed-rank test, two-sided; p counts out all signs (up to 200 people)",
    "Differences of zero": "ranked, then left out (Pratt)",
    "Effect sizes": "matched-pairs rank-biserial correlation; |z| / sqrt(people); Hodges and Lehmann's shift with its "
    "interval of 95 %",
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
    "shares with Wilson's intervals of 95 % and exact binomial p, who said neither left out; a favourite was chosen "
    "over each other stimulus; strengths by Bradley and Terry, ties as Davidson has them, intervals by people"
)


def decided(
    design: Design, answers: Answers, matrix: Matrix, method: Method, correction: Correction, notes: Sequence[str]
) -> dict[str, str]:
    """Every choice, by what it is about; ``notes`` say what could not be done."""
    complete = int((~np.isnan(matrix.values).any(axis=1)).sum())
    left = [f"{one.participant} {'withdrew' if one.withdrawn else 'dropped out'}" for one in design.left]
    made = dict(DEFAULT if method == "default" else PAPER)
    if method == "default" and len(matrix.conditions) < LEAST_STIMULI:
        made["Test of all stimuli"] = "none: two stimuli are one pair"
    made |= {
        "Correction": f"{correction.title()}, within each table of comparisons; the column p has none",
        "Ties": "mean ranks, and variances corrected for them",
        "Quartiles": "by linear interpolation (type 7)",
        "People": f"{counted(len(matrix.people), 'session')}; {complete:,} with all scores",
        "Drop-outs": "; ".join(left) or "nobody left",
        "Faults of sessions": "; ".join(answers.faults) or "none",
        "Groups and devices": "; ".join(answers.notes) or "as planned",
        "Stimuli": "; ".join(design.notes) or "of like duration, in orders that are equally frequent",
        "Carry-over": CARRY_OVER,
    }
    if questions_of(design):
        made["Choices of pairs"] = CHOICES
    if notes:
        made["Not done"] = "; ".join(notes)
    return made
