"""The page of a participant of a small study in the museum: to be tried, and nothing of it is sent anywhere."""

from pathlib import Path

import hpop
from hpop import study

CONSENT = """A robot with a camera drives through a museum, and you see what it sees. You will be shown two rides and a
still view, and asked how you feel. This page is an example of hpop's documentation: your answers stay in it."""

front = hpop.examples.museum().solve("lattice", step=0.25)
design = study.Design.of(
    front,
    ["knee", "least turns", "view"],
    participants=6,
    consent=CONSENT,
    protocol=study.Protocol(rest_s=10),
    seed=4,
)
study.prepare(design, front, Path("out/session"))
