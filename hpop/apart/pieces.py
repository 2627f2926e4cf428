"""Cut a mesh into nearly convex pieces, by CoACD (Wei, Liu, Ling and Su 2022, doi 10.1145/3528223.3530103)."""

from __future__ import annotations

from typing import Any

import numpy as np

from hpop.apart.child import ChildAnswer, ChildRefused

SIMILAR = 0.05
"""Concavity up to which a piece is not cut further, the default of CoACD."""

QUICK = {"preprocess_resolution": 30, "resolution": 1000, "mcts_nodes": 10, "mcts_iterations": 40, "mcts_max_depth": 2}
"""Parameters of CoACD with which it takes a fraction of its usual time, and makes a few pieces more."""


def extract(data: bytes, options: dict[str, Any]) -> ChildAnswer:
    """Return the pieces of a mesh: the array "points" (N, 3) with the corners of one piece after another.

    Its word "sizes" lists the number of corners of each piece. The data are the coordinates of ``options["vertices"]``
    vertices as floats, then for each triangle the indices of its three vertices as integers. At most
    ``options["most"]`` pieces are made.
    """
    import coacd  # installed by the extra hpop[arm]

    count = int(options["vertices"])
    vertices = np.frombuffer(data, "<f8", 3 * count).reshape(-1, 3)
    faces = np.frombuffer(data, "<i8", offset=24 * count).reshape(-1, 3)
    coacd.set_log_level("off")
    mesh = coacd.Mesh(vertices, faces)
    found = coacd.run_coacd(mesh, threshold=SIMILAR, max_convex_hull=int(options["most"]), seed=0, **QUICK)
    points = [np.asarray(corners, np.float64) for corners, _ in found]
    if not points:
        raise ChildRefused("CoACD found no pieces")
    return ChildAnswer({"sizes": [len(part) for part in points]}, {"points": np.concatenate(points)})
