"""Conformance checks, on random worlds, of the rules for criteria, models and planners.

``hpop check module:Name`` prints the checks. :func:`check_criterion`, :func:`check_model` and :func:`check_planner`
are for use in tests: they raise an error if a check fails.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hpop.base import registry
from hpop.base.arguments import checked_arguments
from hpop.base.randomness import RNG
from hpop.criteria.base import Criterion
from hpop.motions import Model
from hpop.testing.contracts import Check
from hpop.testing.criteria import check_criterion, criterion_checks
from hpop.testing.models import check_model, model_checks
from hpop.testing.planners import check_planner, planner_checks
from hpop.testing.worlds import random_motions, random_world, reframed

__all__ = [
    "Check",
    "check_criterion",
    "check_model",
    "check_planner",
    "conformance",
    "kind_of",
    "random_motions",
    "random_world",
    "reframed",
]


@checked_arguments
def kind_of(plugin: Any) -> registry.Registry[type]:
    """Return the registry of criteria or of models for such an object; that of planners for any other object."""
    if isinstance(plugin, Criterion):
        return registry.criteria
    return registry.models if isinstance(plugin, Model) else registry.planners


@checked_arguments
def conformance(plugin: Any, *, rng: RNG = 0) -> Iterator[Check]:
    """Yield the checks of a criterion, a model or a planner, one after the other; ``rng`` draws the worlds.

    Any object that is neither a criterion nor a model is checked as a planner.
    """
    if isinstance(plugin, Criterion):
        return criterion_checks(plugin, rng=rng)
    return model_checks(plugin, rng=rng) if isinstance(plugin, Model) else planner_checks(plugin, rng=rng)
