"""The compiled inner loop of `hpop.world.obstruction.polygon_obstruction`."""

from __future__ import annotations

import math

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import kernel


@kernel
def _primitive(t: float, d: float, r: float, a: float) -> float:
    """Antiderivative over psi of (r^2 - rho^2)^(3/2) along the line at distance d, at t = d tan(psi)."""
    sin_u = min(max(t / a, -1.0), 1.0)
    cos_u = math.sqrt(1.0 - sin_u * sin_u)
    u = math.asin(sin_u)
    return (
        r * r * r * math.atan2(r * sin_u, d * cos_u)
        - 0.5 * d * (3.0 * r * r - d * d) * u
        - 0.5 * d * (r * r - d * d) * sin_u * cos_u
    )


@kernel
def _edge(px: float, py: float, qx: float, qy: float, r: float, c: float) -> float:
    """Volume between the heights 0 and c <= r of the ball part over the triangle (origin, p, q), signed."""
    cross = px * qy - py * qx
    length = math.hypot(qx - px, qy - py)
    if cross == 0.0 or length == 0.0:
        return 0.0
    d = abs(cross) / length
    far = 0.5 * c * r * r - c * c * c / 6.0
    volume = far * math.atan2(abs(cross), px * qx + py * qy)
    if d < r:
        t0 = (px * (qx - px) + py * (qy - py)) / length
        t1 = t0 + length
        a = math.sqrt(r * r - d * d)
        lo, hi = max(t0, -a), min(t1, a)
        if lo < hi:
            psi = math.atan2(hi, d) - math.atan2(lo, d)
            above = _primitive(hi, d, r, a) - _primitive(lo, d, r, a)
            rho2 = r * r - c * c
            if d * d < rho2:
                b = math.sqrt(rho2 - d * d)
                near_lo, near_hi = max(lo, -b), min(hi, b)
                if near_lo < near_hi:
                    near = math.atan2(near_hi, d) - math.atan2(near_lo, d)
                    above -= _primitive(near_hi, d, r, a) - _primitive(near_lo, d, r, a)
                    volume += 0.5 * c * d * (near_hi - near_lo) - far * near
                    psi -= near
            volume += (0.5 * c * rho2 + c * c * c / 3.0 - far) * psi - above / 3.0
    return math.copysign(volume, cross)


@kernel
def _up_to(px: float, py: float, qx: float, qy: float, r: float, z: float) -> float:
    """`_edge` for a height of either sign: odd in z."""
    if z == 0.0:
        return 0.0
    volume: float = _edge(px, py, qx, qy, r, abs(z))
    return volume if z > 0.0 else -volume


@kernel
def ball_volumes(
    edges: FloatArray,
    slab: IntArray,
    heights: FloatArray,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    r: float,
    out: FloatArray,
) -> None:
    """Add to out (M,) the volume (m^3) of the obstacles in the ball of radius r round each camera (x, y, z).

    edges (E, 4) m: x0, y0, x1, y1, outer rings counter-clockwise, holes clockwise, sorted by slab
    slab (S + 1,): the edges of slab s are slab[s]:slab[s + 1]; heights (S, 2) m: its bottom and top
    """
    for k in range(x.size):
        total = 0.0
        for s in range(heights.shape[0]):
            bottom = min(max(heights[s, 0] - z[k], -r), r)
            top = min(max(heights[s, 1] - z[k], -r), r)
            if bottom >= top:
                continue
            for e in range(slab[s], slab[s + 1]):
                px, py = edges[e, 0] - x[k], edges[e, 1] - y[k]
                qx, qy = edges[e, 2] - x[k], edges[e, 3] - y[k]
                if bottom == -top:
                    total += 2.0 * _edge(px, py, qx, qy, r, top)
                else:
                    total += _up_to(px, py, qx, qy, r, top) - _up_to(px, py, qx, qy, r, bottom)
        out[k] += total
