"""Studies: what people say of trajectories of a front, from the choice of stimuli to the weights of one person."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.study.forms import Form
    from hpop.study.scoring import score

__all__ = [
    "Form",
    "score",
]

_HOMES = {
    "Form": "hpop.study.forms",
    "score": "hpop.study.scoring",
}

__getattr__ = on_first_use(__name__, _HOMES)
