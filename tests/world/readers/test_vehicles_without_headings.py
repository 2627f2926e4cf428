"""Vehicles of a road file whose states do not state where they face."""

import pytest
import shapely

from hpop import World
from hpop.errors import MapError
from tests.world.readers.test_commonroad import CAR, TWO_LANES, moving, road


def test_a_vehicle_that_stops_faces_where_it_went(tmp_path):
    north = [(9, 1 + min(step, 4) * 0.5, None, step) for step in range(9)]
    world = World.from_file(road(tmp_path, *TWO_LANES, moving(5, CAR, *north)))
    for step, (x, y, _, _) in enumerate(north):
        discs = [shapely.Point(*person.track.at(step * 0.1)).buffer(person.radius) for person in world.content.people]
        assert shapely.union_all(discs).covers(shapely.box(x - 0.85, y - 2.2, x + 0.85, y + 2.2))


def test_a_vehicle_that_neither_moves_nor_states_a_heading_is_refused(tmp_path):
    stands = road(tmp_path, *TWO_LANES, moving(5, CAR, (9, 1, None, 0), (9, 1, None, 1)))
    with pytest.raises(MapError, match="dynamicObstacle 5 neither moves nor has an orientation; add"):
        World.from_file(stands)
