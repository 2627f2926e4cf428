"""The compiled inner loop of `hpop.criteria.comfort.svc`."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.runtime.compiled import kernel


@kernel
def integrate(
    force: FloatArray,
    rotation: FloatArray,
    told: FloatArray,
    told_rotation: FloatArray,
    gravity: FloatArray,
    constants: FloatArray,
    step: float,
    incidence: FloatArray,
    conflict: FloatArray,
) -> None:
    """Euler steps of the model of `hpop.criteria.comfort.svc`: rows are vectors in the head's frame.

    force, rotation        (N, 3)  m/s², rad/s  what the head feels
    told, told_rotation    (N, 3)  m/s², rad/s  what the eyes tell
    gravity                (3,)    m/s²         at the start, when the head has been at rest for long
    incidence, conflict    (N,)    %, m/s²      written: after each step; |v - v_hat| before it
    """
    ka, kw, kwc, kvc, kac, tau_d, tau_a, tau, b, percent, tau_i = constants
    g, v, v_hat, g_hat = gravity.copy(), gravity.copy(), gravity.copy(), gravity.copy()
    canal, canal_rate, known = np.zeros(3), np.zeros(3), np.zeros(3)
    sick = sick_rate = 0.0
    for n in range(len(incidence)):
        f, w = force[n], rotation[n]
        canal_change = w - (1.0 / tau_d + 1.0 / tau_a) * canal_rate - canal / (tau_d * tau_a)
        w_sensed = canal_change
        w_expected = (known + kw * w + told_rotation[n] + kwc * w_sensed) / (1.0 + kwc)
        f_hat = (ka * (f - g) + told[n] + g_hat + kac * (f - v + v_hat)) / (1.0 + kac)
        v_change = (f - v) / tau - np.cross(w_sensed, v)
        v_hat_change = (f_hat - v_hat) / tau - np.cross(w_expected, v_hat)
        g_hat_change = kvc * (v - v_hat)
        g_change = -np.cross(w, g)
        square = np.sum((v - v_hat) ** 2) / b**2
        sick_change = (percent * square / (1.0 + square) - sick) / tau_i**2 - 2.0 * sick_rate / tau_i
        conflict[n] = b * np.sqrt(square)
        canal = canal + step * canal_rate
        canal_rate = canal_rate + step * canal_change
        known = known - step * w_expected / tau_d
        g, v = g + step * g_change, v + step * v_change
        v_hat, g_hat = v_hat + step * v_hat_change, g_hat + step * g_hat_change
        sick, sick_rate = sick + step * sick_rate, sick_rate + step * sick_change
        incidence[n] = sick
