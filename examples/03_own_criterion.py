"""Write a criterion in ten lines and plan with it: the camera should not look into the evening sun."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hpop


@hpop.criterion("glare", group="C", unit="s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class Glare:
    """Seconds of glare, weighted by the fourth power of the cosine between the direction of view and the sun."""

    azimuth: float = 0.0  # rad, direction of the sun

    def cost(self, m: hpop.Motions) -> np.ndarray:
        """Return the time integral of the weight (M,), s."""
        return m.integrate(lambda s: np.maximum(np.cos(s.camera.yaw - self.azimuth), 0.0) ** 4)


def main() -> hpop.Front:
    """Check the criterion, plan with it and two built-in criteria, and print the costs."""
    from hpop.testing import check_criterion

    check_criterion(Glare())  # costs are finite, >= 0, and agree on edges, trajectories and CasADi symbols

    world = hpop.World.from_geojson(Path(__file__).parent / "museum.geojson")
    problem = hpop.Problem(
        world=world,
        model=hpop.DifferentialDrive(),
        start=(2.0, 10.0, 0.0),
        goal=(28.0, 10.0, 0.0),
        criteria=[Glare(), "turns", "length"],
    )
    front = problem.solve("lattice", step=0.5)
    print(f"{len(front)} optimal trajectories")
    for label, point in {
        "knee": front.knee(),
        "least glare": front.best("glare"),
        "shortest": front.best("length"),
    }.items():
        print(f"{label}: " + ", ".join(f"{name} {value:.2f}" for name, value in point.costs.items()))
    return front


if __name__ == "__main__":
    main()
