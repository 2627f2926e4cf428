"""A small tour with several orders of visits on its front, for tests of pages, pictures and exports."""

from __future__ import annotations

import numpy as np
import shapely

import hpop
from hpop.goals import Tour
from hpop.world.content.content import Landmark

STOPS = [
    {"at": (6.5, 1.0), "within": 0.6, "dwell": 3, "name": "east"},
    {"at": (1.0, 5.0), "within": 0.6, "dwell": 2, "name": "north"},
    {"landmark": "vase", "within": 2.0, "dwell": 1.5, "optional": True},
    {"at": (5.0, 5.0), "within": 0.8, "name": "passed", "optional": True},
]


def tour_problem() -> hpop.Problem:
    world = hpop.World.from_polygons([shapely.box(3, 0, 4, 3)], extent=shapely.box(0, 0, 8, 6))
    return hpop.Problem(
        world=world.with_content(landmarks=(Landmark(6.5, 5.5, 1.2, name="vase"),)),
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2, field_of_view=(np.pi / 2, np.pi / 3)),
        start=(2, 3.5, 0),
        goal=(2, 4, None),
        criteria=["turns", "length", "exposure", "stops_missed"],
        tour=Tour(STOPS, order="any"),
    )


def tour_front(problem: hpop.Problem) -> hpop.Front:
    return problem.solve("lattice", step=0.5, eps=0.02)
