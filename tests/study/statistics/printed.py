"""Data of textbooks, with what they or R print of them."""

from __future__ import annotations

import numpy as np

# Hollander and Wolfe 1973, table 6.1: half-time of mucociliary clearance, in h, by group. Quoted in R's kruskal.test.
MUCOCILIARY = [[2.9, 3.0, 2.5, 2.6, 3.2], [3.8, 2.7, 4.0, 2.4], [2.8, 3.4, 3.7, 2.2, 2.0]]

# Hollander and Wolfe 1973, table 7.1: rounding first base, in s, by player and method. Quoted in R's friedman.test.
ROUNDING = np.array(
    [
        [5.40, 5.50, 5.55],
        [5.85, 5.70, 5.75],
        [5.20, 5.60, 5.50],
        [5.55, 5.50, 5.40],
        [5.90, 5.85, 5.70],
        [5.45, 5.55, 5.60],
        [5.40, 5.40, 5.35],
        [5.45, 5.50, 5.35],
        [5.25, 5.15, 5.00],
        [5.85, 5.80, 5.70],
        [5.25, 5.20, 5.10],
        [5.65, 5.55, 5.45],
        [5.60, 5.35, 5.45],
        [5.05, 5.00, 4.95],
        [5.50, 5.50, 5.40],
        [5.45, 5.55, 5.50],
        [5.55, 5.55, 5.35],
        [5.45, 5.50, 5.55],
        [5.50, 5.45, 5.25],
        [5.65, 5.60, 5.40],
        [5.70, 5.65, 5.55],
        [6.30, 6.30, 6.25],
    ]
)

# Hollander and Wolfe 1973, table 3.1: depression before and after. Quoted in R's wilcox.test.
DEPRESSION = (
    [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30],
    [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29],
)

# Pulse by kind of exercise, of the data set "exercise" (30 people, each at three times), in its order.
PULSE = {
    "rest": [
        *(85, 85, 88, 90, 92, 93, 97, 97, 94, 80, 82, 83, 91, 92, 91),
        *(83, 83, 84, 87, 88, 90, 92, 94, 95, 97, 99, 96, 100, 97, 100),
    ],
    "running": [
        *(93, 98, 110, 98, 104, 112, 98, 105, 99, 87, 132, 120, 94, 110, 116),
        *(95, 126, 143, 100, 126, 140, 103, 124, 140, 94, 135, 130, 99, 111, 150),
    ],
    "walking": [
        *(86, 86, 84, 93, 103, 104, 90, 92, 93, 95, 96, 100, 89, 96, 95),
        *(84, 86, 89, 103, 109, 90, 92, 96, 101, 97, 98, 100, 102, 104, 103),
    ],
}
