"""Pictures of a problem and its front: maps, charts of costs and of one trajectory over time, panoramas and web pages.

The explorer is a web page to choose a trajectory in a browser.

Each ``draw_`` function returns a ``matplotlib.figure.Figure`` outside pyplot's global state: ``draw_map(problem,
front).savefig("map.pdf")``. A notebook shows the figure if it is the last value of a cell. Once this package is
imported, notebooks also show small pictures of worlds, problems and fronts. With ``ax=`` a function draws in your own
figure. The core of hpop never imports this package.
"""

from __future__ import annotations

from hpop.runtime import matplotlib_folder

matplotlib_folder.provide()
matplotlib_folder.forget_current_folder()

from hpop.view import save
from hpop.view.arm_page import save_arm_page
from hpop.view.felt import draw_felt
from hpop.view.front_plot import draw_batch, draw_front, draw_preference
from hpop.view.map import draw_map
from hpop.view.moments import draw_drive, draw_encounters
from hpop.view.ride.equirect import render_360, save_360
from hpop.view.ride.page import save_ride
from hpop.view.ride.video import save_frames, save_video
from hpop.view.save import save_explorer, save_pictures, widget
from hpop.view.side import draw_side
from hpop.view.trace import draw_states, draw_trace
from hpop.view.where import draw_where

save.provide()

__all__ = [
    "draw_batch",
    "draw_drive",
    "draw_encounters",
    "draw_felt",
    "draw_front",
    "draw_map",
    "draw_preference",
    "draw_side",
    "draw_states",
    "draw_trace",
    "draw_where",
    "render_360",
    "save_360",
    "save_arm_page",
    "save_explorer",
    "save_frames",
    "save_pictures",
    "save_ride",
    "save_video",
    "widget",
]
