"""Statistics for studies: tests of scores of the same people, effect sizes, choices, and power before a study.

SciPy is used for Friedman, Kruskal and Wallis, the normal approximation of Wilcoxon, and binomial intervals. Methods
missing in SciPy are implemented here, and all are tested against published values: exact Wilcoxon with ties and zeros,
Hodges and Lehmann's interval, Dunn's z, Holm, Bradley and Terry with ties, ordinal mixed models, and power by
simulation.
"""

from __future__ import annotations

from hpop.study.statistics.choices import Multinomial, Share, Strengths, bradley_terry, multinomial, share
from hpop.study.statistics.ordinal import Crossover, OrdinalFit, Ratio, crossover, factorial, ordinal_mixed
from hpop.study.statistics.pairs import Pair, wilcoxon
from hpop.study.statistics.power import Power, power
from hpop.study.statistics.scores import (
    Comparison,
    Described,
    Independent,
    Related,
    adjusted,
    cochran,
    describe,
    dunn,
    friedman,
    kruskal,
)

__all__ = [
    "Comparison",
    "Crossover",
    "Described",
    "Independent",
    "Multinomial",
    "OrdinalFit",
    "Pair",
    "Power",
    "Ratio",
    "Related",
    "Share",
    "Strengths",
    "adjusted",
    "bradley_terry",
    "cochran",
    "crossover",
    "describe",
    "dunn",
    "factorial",
    "friedman",
    "kruskal",
    "multinomial",
    "ordinal_mixed",
    "power",
    "share",
    "wilcoxon",
]
