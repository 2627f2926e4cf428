"""Plan for a robot guide among visitors in a gallery of the Field Museum, Chicago, with five costs.

python examples/field_museum.py DATA_FOLDER

The folder holds main_level_outline.geojson, _labels and _areas from https://github.com/arcataroger/openlayers_indoor_map
(content CC-BY-4.0). People and display cases are made up. `hpop plan examples/field_museum.yaml` plans the same.
"""

import sys
from math import pi
from pathlib import Path

import hpop
from hpop.view import save_pictures
from hpop.world.content import Landmark, Person
from hpop.world.readers import geojson_content

# Conversion of EPSG:3857 to metres: it stretches lengths by 1 / cos(latitude). (0, 0) is the south-west corner.
METRES = {"scale": 0.7447, "origin": (-9753627.0, 5140874.0)}
NORTH, EAST, SOUTH, WEST = pi / 2, 0.0, -pi / 2, pi


def museum(data: Path) -> hpop.World:
    """Return the main level: closed areas are keep-out zones, labels and cases are landmarks, visitors stand still."""
    building = hpop.World.from_geojson(data / "main_level_outline.geojson", polygons="outline", **METRES)
    labels, areas = data / "main_level_labels.geojson", data / "main_level_areas.geojson"
    content, notes = geojson_content.read(landmarks=labels, zones=areas, **METRES)
    for note in notes:
        print(f"note: {note}")
    cases = [
        Landmark(66.0, 113.2, facing=SOUTH, weight=8, name="owls"),
        Landmark(56.0, 113.0, facing=SOUTH, weight=8, name="penguins"),
        Landmark(46.0, 112.8, facing=SOUTH, weight=8, name="birds of paradise"),
    ]
    visitors = [
        Person(62.5, 108.4, EAST, name="Ada"),
        Person(63.7, 108.4, WEST, name="Bo"),
        Person(66.0, 111.2, NORTH),
        Person(57.0, 110.9, 1.7),
        Person(55.4, 111.1, 1.4),
        Person(51.0, 107.5, 0.3),
        Person(47.2, 110.4, NORTH),
        Person(46.0, 109.6, 1.5),
    ]
    return building.with_content(
        people=visitors, groups=[(0, 1)], landmarks=[*content.landmarks, *cases], zones=content.zones
    )


def main(data: Path, folder: Path = Path("out/field_museum"), step: float = 0.5) -> hpop.Front:
    """Plan along the north wall of the bird gallery: see the cases, and keep away from people and walls."""
    problem = hpop.Problem(
        world=museum(data),
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(72.0, 112.0, WEST),
        goal=(36.0, 111.0, None),
        criteria=[
            "exposure",
            "turns",
            "length",
            {"landmark_blindness": {"near": 2.0, "far": 10.0}},
            "personal_space",
        ],
    )
    front = problem.solve(planner="lattice", step=step, time_limit=60.0)
    print(f"{len(front)} trajectories ({front.status}); {front.certificate}")
    for name in front.names:
        best = front.best(name)
        print(f"least {name}:", ", ".join(f"{key} {value:.3g}" for key, value in best.costs.items()))
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
