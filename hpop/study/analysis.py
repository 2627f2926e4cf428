"""The analysis of a study: its scores and choices as tables of tests, with every choice that was made on the way.

The default asks what the same people make of several stimuli: Friedman's test, then Wilcoxon's of each pair. The method
of the paper (Becerra et al. 2020) takes the scores as if each were another person's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import one_of
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.study.answers import Answers, Matrix
from hpop.study.decisions import decided
from hpop.study.design import Design
from hpop.study.results import BEFORE, Method, Row, choice_tables, score_tables, stimuli_table
from hpop.study.statistics.corrections import CORRECTIONS, Correction

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from matplotlib.figure import Figure

METHODS: tuple[Method, ...] = ("default", "paper")


@checked_arguments
@dataclass(frozen=True, eq=False)
class Analysis:
    """Tables of a study; :func:`analyse` makes it.

    method      "default" or "paper"
    form        whose score was analysed
    score       its name
    correction  of the p values of several comparisons: "holm", "bonferroni" or "none"
    tables      rows by the name of the table: "stimuli", "scores", "test", "pairs", "against before", "places",
                "carry-over", "balance", "choices", "favourites", "strengths", as far as the answers go
    choices     what was decided, and how: the test, ties, who was left out
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
        """The scores that were analysed."""
        return self.answers.matrix(self.form, self.score)

    @property
    def before(self) -> FloatArray | None:
        """The scores (n,) before the first stimulus, where the form was asked then."""
        asked = BEFORE in self.design.form(self.form).when
        return self.answers.before(self.form, self.score) if asked else None

    @property
    def mark(self) -> str:
        """What every page and figure says of answers that nobody gave; nothing where all are people's."""
        sessions = self.answers.sessions
        simulated = sum(session.device.get("simulated") is True for session in sessions)
        if not simulated:
            return ""
        some = "all answers are" if simulated == len(sessions) else f"{simulated} of {len(sessions)} sessions are"
        return f"SIMULATED: {some} made by a program, and nobody gave them"

    def text(self) -> str:
        """All tables and choices as plain text."""
        from hpop.study.report import as_text

        return as_text(self)

    def draw(self, name: str = "scores") -> Figure:
        """A figure: "scores" (each person's, with medians), "order" (by place) or "choices" (of pairs)."""
        from hpop.study.figures import draw

        return draw(self, name)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the report: report.html, each table as CSV, the figures, and repeat.py; the page's path."""
        from hpop.study.report import save

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
    """Test a score of a form that was asked after each stimulus, and the choices of pairs.

    method      "default": Friedman's test and Kendall's W, then Wilcoxon's of each pair (Pratt's zeros, exact);
                "paper": Kruskal and Wallis' test and Dunn's comparisons, and Wilcoxon's against the answers before by
                its normal approximation, zeros left out
    score       form and name of a score, or of an item
    correction  of the comparisons of one table: "holm" by default, "bonferroni" as the paper does

    A table that the answers do not suffice for is left out, and ``choices`` say why. Raises StudyError for a form that
    is not asked after each stimulus, and for answers of nobody.
    """
    one_of("method", method, METHODS, error=StudyError)
    chosen: Correction = correction or ("bonferroni" if method == "paper" else "holm")
    one_of("correction", chosen, CORRECTIONS, error=StudyError)
    if isinstance(score, str) or len(score) != 2:
        raise StudyError(f"a score is named by its form and its name, such as ('ssq', 'total'), got {shown(score)}")
    form, name = score
    if "after_each" not in (when := design.form(form).when):
        raise StudyError(f"form {form} is not asked after each stimulus, so there is nothing to compare")
    matrix = answers.matrix(form, name)
    if np.isnan(matrix.values).all():
        raise StudyError(f"nobody's answers give the score {name} of form {form}; see `hpop study check`")
    before = answers.before(form, name) if BEFORE in when else None
    tables, notes = score_tables(design, matrix, before, method, chosen)
    chosen_of_pairs, lacking = choice_tables(design, answers)
    return Analysis(
        design=design,
        answers=answers,
        method=method,
        form=form,
        score=name,
        correction=chosen,
        tables={"stimuli": stimuli_table(design)} | tables | chosen_of_pairs,
        choices=decided(design, answers, matrix, form, method, chosen, [*notes, *lacking]),
    )
