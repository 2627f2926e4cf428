"""Preregistration of a study: its plan as text, from the design, before anyone is asked.

Headings follow the template of the Open Science Framework. What hpop cannot know, such as hypotheses, is left to fill
in. The text names no letters, so that its readers stay blind.
"""

from __future__ import annotations

import hpop
from hpop.base.arguments import checked_arguments
from hpop.base.text import counted, printable
from hpop.study.analysis import checked_question, planned
from hpop.study.design import Design
from hpop.study.forms import Form
from hpop.study.protocol import MEASURED
from hpop.study.results import Method
from hpop.study.statistics.power import Power
from hpop.study.statistics.scores import Correction
from hpop.study.tasks import task_scores

FILL = "[fill in: {}]"
WHEN = {"before": "before the first stimulus", "after_each": "after each stimulus", "after_all": "after all stimuli"}


@checked_arguments
def preregistration(
    design: Design,
    *,
    score: tuple[str, str] = ("ssq", "total"),
    method: Method = "default",
    correction: Correction | None = None,
    power: Power | None = None,
) -> str:
    """Return a preregistration of a study as Markdown; parameters are those of :func:`hpop.study.analyse`.

    power  result of :func:`hpop.study.power`, the reason for the number of participants

    Raises StudyError for a score, a method or a correction that does not fit the design.
    """
    asked, chosen = checked_question(design, method, score, correction)
    plan = planned(design, asked, method, chosen)
    primary, better = f"{asked.form}.{asked.name}", asked.better_words and f" ({asked.better_words})"
    others = [f"{one.id}.{made}" for one in design.questionnaires for made in one.score_names]
    others += [f"{MEASURED}.{made}" for made in task_scores(design)]
    others.remove(primary) if primary in others else None
    parts = {
        "Study information": [
            f"**Title.** {FILL.format('title')}",
            f"**Authors.** {FILL.format('names')}",
            f"**Hypotheses.** {FILL.format('which stimulus scores higher, and why')}. All tests below are two-sided.",
        ],
        "Design plan": [
            "**Type.** Experiment; each participant rates every stimulus (within subjects).",
            "**Blinding.** Participants, and tables before the report, know the stimuli by letters that were drawn at "
            "random.",
            "**Stimuli.**\n\n" + _stimuli(design),
            f"**Orders.** {plan['Orders']}. Random numbers have the seed {design.seed}."
            + (f" Balanced within orders: {_strata(design)}." if design.enrolled[0].strata else ""),
            f"**Rest.** At least {design.protocol.rest_s:g} s after each stimulus, until participants feel as before. "
            f"**Stopping.** {printable(design.protocol.stop_rule)}",
            f"**Exposure.** {plan['Durations']}.",
        ],
        "Sampling plan": [
            f"**Data.** {FILL.format('that no data were collected yet')}",
            f"**Participants.** {len(design.enrolled):,}. {FILL.format('who, and how they are found')}",
            f"**Reason for this number.** {power.text() if power else FILL.format('see hpop study power')}",
            "**End of data collection.** When all planned sessions are complete. Participants who drop out or withdraw "
            "are replaced, in an equal order; data of those who withdraw are deleted.",
        ],
        "Variables": [
            f"**Manipulated.** {' x '.join(['trajectory', *_factors(design)])}; the place in the order is balanced.",
            "**Measured.**\n\n" + "\n".join(_measured(one) for one in design.questionnaires),
            f"**Tasks during a stimulus.** {_tasks(design) or 'none'}.",
        ],
        "Analysis plan": [
            f"**Primary score.** {primary}{better}.",
            *(f"**{topic}.** {said}." for topic, said in plan.items() if topic not in ("Orders", "Durations")),
            "**Inference.** p below .05, adjusted as above.",
            "**Exclusions.** Participants who stop or drop out keep the scores that they gave. "
            f"{FILL.format('further criteria, such as videos not watched, rides under 60 frames per second')}",
            f"**Exploratory.** {', '.join(others) or 'no other scores'}.",
        ],
        "Other": [
            f"Written by hpop {hpop.__version__} for the design with the SHA-256 {design.digest}; its consent text "
            "and all questions are in design.json."
        ],
    }
    return "# Preregistration\n" + "".join(
        f"\n## {heading}\n\n" + "\n\n".join(texts) + "\n" for heading, texts in parts.items()
    )


def _stimuli(design: Design) -> str:
    """Return a list of the stimuli with durations and costs, without letters, by name."""
    lines = []
    for one in design.conditions:
        costs = ", ".join(f"{name} {cost:.4g}" for name, cost in one.costs.items())
        lines.append(f"- {one}: {one.kind}, {one.duration:.1f} s{f'; {costs}' if costs else ''}")
    return "\n".join(sorted(lines))


def _strata(design: Design) -> str:
    """Return the strata with their levels."""
    levels = {name: sorted({person.strata[name] for person in design.enrolled}) for name in design.enrolled[0].strata}
    return "; ".join(f"{name} ({', '.join(of)})" for name, of in levels.items())


def _factors(design: Design) -> list[str]:
    """Return the factors beside the trajectory, with their levels."""
    names = dict.fromkeys(name for one in design.conditions for name in one.factors)
    levels = {
        name: dict.fromkeys(str(one.factors[name]) for one in design.conditions if name in one.factors)
        for name in names
    }
    return [f"{name} ({', '.join(of)})" for name, of in levels.items()]


def _tasks(design: Design) -> str:
    """Return the tasks with their options."""
    return "; ".join(
        f"{name} ({', '.join(f'{option} {value:g}' for option, value in options.items())})"
        for name, options in design.protocol.options.items()
    )


def _measured(form: Form) -> str:
    """Return a line on a questionnaire: questions, times, scores and source."""
    scores = f"scores {', '.join(form.score_names)}; " if form.score_names else ""
    when = ", ".join(WHEN[one] for one in form.when)
    return f"- {form.id}: {counted(len(form.items), 'question')}, {when}; {scores}{' '.join(form.source.split())}"
