"""Look round before choosing: the explorer of a front, a ride along two of its trajectories, one picture all round."""

from pathlib import Path

import hpop
from hpop.view import save_360, save_explorer, save_ride

folder = Path("out/look_around")
folder.mkdir(parents=True, exist_ok=True)

problem = hpop.examples.museum()
front = problem.solve("lattice", step=0.25)

save_explorer(problem, front, folder / "explorer.html")
save_ride(problem, front, folder / "ride.html", rows=["knee", "least length"])
save_360(problem, front.knee().trajectory, 12.0, folder / "view.png", width=1024)  # after 12 s
