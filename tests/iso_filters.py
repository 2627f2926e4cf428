"""Filters of ISO 2631-1:1997 as state spaces of scipy, from zeros, poles and gains; they share no code with hpop."""

from __future__ import annotations

import numpy as np
from scipy.signal import zpk2ss


def corner(frequency, quality):
    """Return the two roots of s² + s w/Q + w²."""
    w = 2 * np.pi * frequency
    return np.roots([1.0, w / quality, w * w])


def motion_sickness():
    """Return the weighting Wf (table A.1) as matrices A, B, C and D.

    Its high pass (0.08 Hz) has two zeros at 0; low pass (0.63 Hz) and transition (0.25 Hz) have none; the upward step
    has zeros (0.0625 Hz) and poles (0.1 Hz), and gain 1 at high frequencies.
    """
    zeros = np.concatenate([[0.0, 0.0], corner(0.0625, 0.80)])
    poles = np.concatenate([corner(0.08, 2**-0.5), corner(0.63, 2**-0.5), corner(0.25, 0.86), corner(0.1, 0.80)])
    return zpk2ss(zeros, poles, (2 * np.pi) ** 4 * (0.63 * 0.25) ** 2)
