"""Analysis of a study: tables of statistical tests of scores and choices, with every decision.

The default compares several stimuli rated by the same people: Friedman's test, then Wilcoxon's for each pair. The
method of the paper (Becerra et al. 2020) treats all scores as independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import one_of
from hpop.base.text import counted, shown
from hpop.errors import StudyError
from hpop.study.answers import Answers, Matrix
from hpop.study.conditions import unlike
from hpop.study.design import Design
from hpop.study.protocol import MEASURED
from hpop.study.results import BEFORE, Method, Row, choice_tables, score_tables, stimuli_table
from hpop.study.session import questions_of
from hpop.study.statistics.scores import CORRECTIONS, LEAST_STIMULI, Correction
from hpop.study.tasks import Variable, task_scores, variable

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from matplotlib.figure import Figure


PAPERS_POWER = (
    "It treats all scores as those of different people. Here the same people answered, so that each person's general "
    "level acts as noise and costs power, and more so if one person's answers are alike. Of 1,500 simulated studies "
    "(36 people, shifts 0, .25 and .5 standard deviations) it found a difference in .40, .31 and .26, and Friedman's "
    "test in .46, .72 and .95, at correlations of .3, .6 and .8"
)
DEFAULT = {
    "Test of all stimuli": "Friedman's test, by chi-square, and Kendall's W",
    "Tests of pairs": "Wilcoxon's signed-rank test, two-sided; p is exact for up to 200 people: the share of all "
    "assignments of signs to the ranks whose sum is at least as far from even",
    "Differences of zero": "ranked, then left out (Pratt)",
    "Effect sizes": "matched-pairs rank-biserial correlation; |z| / sqrt(people); Hodges and Lehmann's shift with its "
    "interval of 95 %: the shifts that this test does not reject, ties and zeros included",
    "Missing answers": "a score with a missing item is missing, not smaller. The test of all stimuli uses the people "
    "with all scores, the test of a pair those with both",
}
PAPER = {
    "Test of all stimuli": f"Kruskal and Wallis' test, by chi-square. {PAPERS_POWER}",
    "Tests of pairs": "Dunn's comparisons of mean ranks, two-sided; against the answers before: Wilcoxon's signed-rank "
    "test by the normal approximation",
    "Differences of zero": "left out before ranking (Wilcoxon, as SPSS does)",
    "Effect sizes": "epsilon squared H / (N - 1) and eta squared (H - k + 1) / (N - k); |z| / sqrt(people)",
    "Missing answers": "a score with a missing item is missing, not smaller; each test uses all available scores",
}
MIXED = {
    "Test of all stimuli": "ordinal mixed model (cumulative logits): stimuli and places as effects, a normal intercept "
    "for each person; maximum likelihood by adaptive Gauss-Hermite quadrature, 15 nodes; likelihood-ratio test without "
    "the stimuli",
    "Tests of pairs": "Wald tests of the effects of this model, two-sided; no test against the answers before",
    "Effect sizes": "ratios of odds of a higher score, the second stimulus against the first, with Wald's intervals of "
    "95 %",
    "Missing answers": "a score with a missing item is missing, not smaller; all other scores are used",
}
MIXED_CARRY_OVER = (
    "likelihood-ratio tests without the places, and without the effects of the stimulus before (first-order "
    "carry-over), which have the mean 0 over all stimuli; at the first place there is none"
)
CARRY_OVER = (
    "the test is repeated by place in the session instead of by stimulus, and for the stimuli at the first place "
    "alone, before which nothing was seen. If the place matters, look at the first place too. "
    'The method "mixed" tests the effect of the stimulus before'
)
CHOICES = (
    "shares with their intervals of 95 % and p by the exact binomial test (Clopper and Pearson), without the answers "
    '"neither"; a favourite was chosen '
    "over each other stimulus, among the people who compared all pairs; "
    "strengths by Bradley and Terry, with ties as in Davidson, and intervals that account for repeated choices of one "
    "person; no intervals if all people answered alike, because their variation is then unknown"
)


def planned(design: Design, score: Variable, method: Method, correction: Correction) -> dict[str, str]:
    """Return the decisions of an analysis that can be made before any answer, as text, by topic."""
    made = dict({"default": DEFAULT, "paper": PAPER, "mixed": MIXED}[method])
    if method == "default" and len(design.letters) < LEAST_STIMULI:
        made["Test of all stimuli"] = "none: two stimuli are one pair"
    made |= {
        **_source(score),
        "Correction": f"{correction.title()}, within each table of comparisons. The column p and the intervals are "
        "not corrected: an interval corresponds to p, and may exclude 0, or a ratio of 1, although the adjusted p is "
        "above .05",
        "Ties": "equal scores are one level" if method == "mixed" else "mean ranks, and variances corrected for them",
        "Quartiles": "by linear interpolation (type 7)",
        "Orders": "; ".join(design.uneven) or _orders(design),
        "Durations": _durations(design),
        "Carry-over": MIXED_CARRY_OVER if method == "mixed" else CARRY_OVER,
    }
    return made | ({"Choices of pairs": CHOICES} if questions_of(design) else {})


def decisions(answers: Answers, matrix: Matrix, plan: Mapping[str, str], notes: Sequence[str]) -> dict[str, str]:
    """Return every decision of an analysis as text, by topic.

    plan   decisions that were made before the answers
    notes  reasons why some tables were impossible
    """
    complete = int((~np.isnan(matrix.values).any(axis=1)).sum())
    left = [f"{one.participant} {'withdrew' if one.withdrawn else 'dropped out'}" for one in answers.design.left]
    return {
        **plan,
        "People": f"{counted(len(matrix.people), 'session')}; {complete:,} with all scores",
        "Drop-outs": "; ".join(left) or "none",
        "Faults of sessions": "; ".join(answers.faults) or "none",
        **answers.noted,
        "Dashes in tables": "no such number exists: the still view has no costs, and a test of several rows together "
        "has no values in the other rows",
        **({"Not done": "; ".join(notes)} if notes else {}),
    }


def _source(score: Variable) -> dict[str, str]:
    """Return the source of a questionnaire, and when in the session it is asked; or the task of a measure."""
    if score.form == MEASURED:
        return {
            "Measure": f"{score.title}. {score.source}, during each stimulus. Of a stimulus that was shown again, the "
            "last showing counts; of one that the participant stopped, the part until then. Without a record of the "
            "task, the score is missing"
        }
    when = {"before": "before the first stimulus", "after_each": "once after each", "after_all": "after all"}
    return {"Questionnaire": f"{score.source}. Asked {', '.join(when[one] for one in score.when)}"}


def _orders(design: Design) -> str:
    """Describe how the orders of stimuli were balanced."""
    return "drawn at random" if design.order == "random" else f"{design.order}, each as often as any other"


def _durations(design: Design) -> str:
    """Describe how long the stimuli last, with a warning if the longest lasts over 10 % longer than the shortest."""
    if lasting := unlike(design.conditions):
        return f"{lasting}, so a part of the differences may come from the durations, not from the paths"
    lasts = [condition.duration for condition in design.conditions]
    return f"stimuli last {min(lasts):.1f} to {max(lasts):.1f} s"


METHODS: tuple[Method, ...] = ("default", "paper", "mixed")


@checked_arguments
@dataclass(frozen=True, eq=False)
class Analysis:
    """Tables of a study's analysis, made by :func:`analyse`.

    method      "default", "paper" or "mixed"
    form        id of the questionnaire of the analysed score; "tasks" for a measure of a task
    score       name of the analysed score or measure
    correction  of the p values of several comparisons: "holm", "bonferroni" or "none"
    tables      rows by the name of the table: "stimuli", "scores", "test", "factors", "pairs", "against before",
                "places", "carry-over", "stimulus before", "balance", "choices", "favourites", "strengths", "live"; only
                those that the method, the design and the answers allow
    choices     every decision of the analysis by topic: the test, ties, people left out
    """

    design: Design
    answers: Answers
    method: Method
    form: str
    score: str
    correction: Correction
    tables: Mapping[str, Sequence[Row]]
    choices: Mapping[str, str]

    @property
    def matrix(self) -> Matrix:
        """Return the analysed scores after each stimulus, a row per person and a column per stimulus."""
        return self.answers.matrix(self.form, self.score)

    @property
    def variable(self) -> Variable:
        """Return what is analysed: its title, source, better end, and when it was obtained."""
        return variable(self.design, self.form, self.score)

    @property
    def before(self) -> FloatArray | None:
        """Return the scores (n,) before the first stimulus, or None if the questionnaire was not asked then."""
        asked = BEFORE in self.variable.when
        return self.answers.before(self.form, self.score) if asked else None

    @property
    def mark(self) -> str:
        """Return a warning for every page and figure if some answers are simulated; "" if people gave all answers."""
        sessions = self.answers.sessions
        simulated = sum(session.device.get("simulated") is True for session in sessions)
        if not simulated:
            return ""
        some = "all answers are" if simulated == len(sessions) else f"{simulated} of {len(sessions)} sessions are"
        return f"SIMULATED: {some} made by a program, and no person gave them"

    def text(self) -> str:
        """Return all tables and decisions as plain text."""
        from hpop.study.report import as_text  # reports draw with Matplotlib: slow to import

        return as_text(self)

    def draw(self, name: str = "scores") -> Figure:
        """Return a figure: "scores" (of each person, by stimulus), "order" (by place) or "choices" (of pairs)."""
        from hpop.study.figures import draw  # as above

        return draw(self, name)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write a report (report.html, tables as CSV, figures, and repeat.py) to a folder; return the page's path."""
        from hpop.study.report import save  # as above

        return save(self, folder)


@checked_arguments
def analyse(
    design: Design,
    answers: Answers,
    *,
    method: Method = "default",
    score: tuple[str, str] = ("ssq", "total"),
    correction: Correction | None = None,
) -> Analysis:
    """Analyse a study: test a score of each stimulus, and the choices between pairs.

    method      "default": Friedman's test and Kendall's W, then Wilcoxon's of each pair (Pratt's zeros, exact);
                "paper": Kruskal and Wallis' test and Dunn's comparisons; and, against the answers before the first
                stimulus, Wilcoxon's test by its normal approximation, zeros left out;
                "mixed": an ordinal mixed model of stimuli, places and the stimulus before (carry-over)
    score       form and name of a score, or of an item, asked after each stimulus; or "tasks" and the name of a measure
                of a task or of a video, such as ("tasks", "reaction_median") or ("tasks", "pauses")
    correction  of the comparisons of one table: "holm", "bonferroni" or "none"; by default "holm", or with the method
                "paper" "bonferroni"

    Tables that need more answers are left out, with the reason in the result's ``choices`` (decisions). Raises
    StudyError for a form that is not asked after each stimulus, and without answers.
    """
    asked, chosen = checked_question(design, method, score, correction)
    form, name = asked.form, asked.name
    matrix = answers.matrix(form, name)
    if np.isnan(matrix.values).all():
        what = f"measure {name}" if form == MEASURED else f"score {name} of form {form}"
        raise StudyError(f"no participant has all answers for the {what}; see `hpop study check`")
    before = answers.before(form, name) if BEFORE in asked.when else None
    tables, notes = score_tables(design, matrix, before, method, chosen)
    chosen_of_pairs, lacking = choice_tables(design, answers)
    live = {"live": answers.live} if answers.live else {}
    return Analysis(
        design=design,
        answers=answers,
        method=method,
        form=form,
        score=name,
        correction=chosen,
        tables={"stimuli": stimuli_table(design)} | tables | chosen_of_pairs | live,
        choices=decisions(answers, matrix, planned(design, asked, method, chosen), [*notes, *lacking]),
    )


def checked_question(
    design: Design, method: Method, score: tuple[str, str], correction: Correction | None
) -> tuple[Variable, Correction]:
    """Return what an analysis compares, and its correction; StudyError if they do not fit the design."""
    one_of("method", method, METHODS, error=StudyError)
    chosen: Correction = correction or ("bonferroni" if method == "paper" else "holm")
    one_of("correction", chosen, CORRECTIONS, error=StudyError)
    if isinstance(score, str) or len(score) != 2:
        raise StudyError(f"score must be a form and a name, such as ('ssq', 'total'), got {shown(score)}")
    form, name = score
    if form != MEASURED and "after_each" not in design.form(form).when:
        asked = [one.id for one in design.questionnaires if "after_each" in one.when]
        fitting = ", ".join([*asked, *([MEASURED] if task_scores(design) else [])]) or "none of the study"
        raise StudyError(
            f"form {form} is not asked after each stimulus, so there is nothing to compare; forms that are: {fitting}"
        )
    return variable(design, form, name), chosen
