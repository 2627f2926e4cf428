"""Make the pictures of the documentation site: `make docs` runs this before Sphinx.

Each is made by a command that a page shows, as it stands there, in a folder where the clone's examples lie. What it
printed and drew is kept in out/pictures with a digest of all that it may depend on (the package, the examples, the
versions): it is made again only where one of these has changed.

    python docs/make_pictures.py [NAME ...]      # these alone
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
MADE = ROOT / "out" / "pictures"
WIDTH = 480  # pixels of a thumbnail
MOST = 600  # s by the clock that one command may take
#: How a command is run that a page shows: this Python, this clone.
RUN = {
    "python": [sys.executable],
    "hpop": [sys.executable, "-c", "from hpop.entry import main; main()"],
    "notebook": [sys.executable, str(ROOT / "docs" / "run_notebook.py")],
}


@dataclass(frozen=True)
class Recipe:
    """A command, and what is to be seen in what it draws.

    name      of the folder in out/pictures
    command   as a reader types it in a clone
    page      of the site, and its section, that shows the command and what it runs
    captions  of the pictures that the gallery has, by their paths in the folder where the command ran
    live      pages that it wrote, by these paths, and where the site has them
    """

    name: str
    command: str
    page: str
    captions: dict[str, str]
    live: dict[str, str] = field(default_factory=dict)


def example(name: str, captions: dict[str, str], arguments: str = "") -> Recipe:
    """Return a recipe that runs an example, which has a tutorial."""
    shown = {f"out/{name}/{picture}.png": caption for picture, caption in captions.items()}
    return Recipe(name, f"python examples/{name}.py{arguments}", f"tutorials/{name}", shown)


def notebook(name: str) -> Recipe:
    """Return a recipe that runs a notebook, which has a tutorial with all its output."""
    return Recipe(f"notebook_{name}", f"notebook examples/notebooks/{name}.ipynb", f"tutorials/notebook_{name}", {})


RECIPES = [
    example(
        "01_museum",
        {
            "map": "All optimal trajectories on the map; thick: the best in each criterion, and the knee",
            "front": "What they cost, pair by pair",
            "trace": "When each criterion is incurred along the knee",
            "where": "Where it is incurred",
        },
    ),
    example(
        "02_ros_map",
        {"map": "The same on a map that a robot has recorded"},
        " examples/notebooks/floor.yaml 1.2 -3 12.6 2.3",
    ),
    Recipe(
        "03_own_criterion",
        "hpop plan examples/own_criterion.yaml --out out/own_criterion --import examples/03_own_criterion.py",
        "tutorials/03_own_criterion",
        {"out/own_criterion/map.png": "A criterion of one's own: ways that spare the camera the evening sun"},
    ),
    example(
        "04_study",
        {
            "study": "The three trajectories of the paper's study",
            "report/scores": "A study's scores, person by person (simulated answers)",
            "report/choices": "What was chosen of pairs (simulated answers)",
        },
    ),
    example(
        "05_pan_tilt",
        {
            "map": "A camera on a pan-tilt head: the way, and where it looks",
            "states": "Yaw of the base and pan of the head in time",
        },
    ),
    Recipe(
        "06_arm",
        "python examples/06_arm.py",
        "tutorials/06_arm",
        {"out/06_arm/side.png": "An arm with the camera in its hand visits three cans on a shelf, in any order"},
    ),
    example("06_two_arms", {"side": "An arm watches another arm at its work", "states": "Its joints over time"}),
    example("07_mobile_arm", {"map": "A base drives an arm to a shelf", "side": "The way of the camera in its hand"}),
    example(
        "07_drive",
        {
            "plan": "A plan over time among people who move: it waits, and lets a visitor pass",
            "drive": "A drive: what could be chosen after each event",
        },
    ),
    example("08_many_queries", {}),
    example("09_batch", {"summary": "Three planners on two hundred problems: time, front size and joint hypervolume"}),
    example(
        "10_guided_tour",
        {
            "map": "A guided tour with stops: the fastest tours that show two, three and four exhibits",
            "front": "Its front: time against calm driving, for each number of skipped exhibits",
            "trace": "One tour over time, with the names of its stops and its speeds",
        },
    ),
    example(
        "11_wifi_survey",
        {"map": "A floor, shaded by the strength of its Wi-Fi; paths that trade it against turns and length"},
        " examples/notebooks/floor.yaml 1.2 -3 12.6 2.3",
    ),
    example(
        "12_passenger",
        {
            "felt": "A passenger on a road: speed and felt acceleration of a fast, a balanced and a gentle ride",
            "front": "Its front: the time of the ride against the passenger's motion sickness dose",
        },
    ),
    Recipe(
        "paper_figure",
        "python examples/paper_figure/paper_figure.py",
        "tutorials/paper_figure",
        {"out/paper_figure/map.png": "The structure of the paper's example: three walls, each with a slit"},
    ),
    Recipe(
        "look_around",
        "python docs/look_around.py",
        "gallery#the-explorer-and-the-ride",
        {"out/look_around/view.png": "What the viewer sees all round, 12 s along the knee"},
        {
            "out/look_around/explorer.html": "live/explorer.html",
            "out/look_around/ride.html": "live/ride.html",
        },
    ),
    Recipe(
        "session",
        "python docs/session.py",
        "study#the-session",
        {},
        {"out/session/pages/p01.html": "live/session.html"},
    ),
    Recipe(
        "session_picture",
        "python docs/session_picture.py",
        "study#the-session",
        {
            "out/session.png": "A study's session: left the questionnaire before the first ride, right a ride on a "
            "phone; the button that stops is always in view"
        },
    ),
    Recipe(
        "look",
        "hpop look examples/museum.yaml --out out/look.png",
        "gallery#a-map-before-anything-is-planned",
        {"out/look.png": "Where the robot, as large as it is, is free"},
    ),
    Recipe(
        "arm_shelf",
        "hpop demo arm_shelf --out out/arm_shelf",
        "gallery#an-arm-from-the-command-line",
        {
            "out/arm_shelf/side.png": "All optimal ways of an arm's camera, from the side",
            "out/arm_shelf/states.png": "Joints in time, within their limits",
        },
    ),
    *(notebook(name) for name in ("01_museum", "02_own_criterion", "03_real_map", "04_own_graph")),
]


def by_name() -> dict[str, Recipe]:
    """All recipes."""
    return {recipe.name: recipe for recipe in RECIPES}


def sources() -> Iterator[Path]:
    """Files that any picture may depend on."""
    for folder, endings in (("hpop", {".py", ".js", ".css"}), ("examples", None)):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts and (endings is None or path.suffix in endings):
                yield path
    yield from (ROOT / "constraints.txt", *sorted((ROOT / "docs").glob("*.py")))


@cache
def state() -> str:
    """Digest of all of them."""
    digest = hashlib.sha256(sys.version.encode())
    for path in sources():
        digest.update(f"{path.relative_to(ROOT)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def of(name: str) -> dict[str, Any]:
    """Return the record of a recipe: the ``state`` it was made of, and what it ``printed``."""
    made: dict[str, Any] = json.loads((MADE / name / "made.json").read_text(encoding="utf-8"))
    return made


def is_made(recipe: Recipe) -> bool:
    """Return True if a recipe was made of these very files."""
    try:
        made = of(recipe.name)
    except (FileNotFoundError, json.JSONDecodeError):
        return False
    return bool((made["state"], made["recipe"]) == (state(), repr(recipe)))


def make(recipe: Recipe) -> None:
    """Run a recipe in a new folder, and put it in the place of the old one."""
    folder, work = MADE / recipe.name, MADE / f"{recipe.name}.new"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    for shown in ("docs", "examples"):
        (work / shown).symlink_to(ROOT / shown)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "110", "NO_COLOR": "1", "MPLBACKEND": "agg"}
    program, *arguments = shlex.split(recipe.command)
    done = subprocess.run(
        [*RUN[program], *arguments],
        cwd=work,
        env=environment,
        capture_output=True,
        text=True,
        timeout=MOST,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{recipe.command}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    if lacking := [picture for picture in (*recipe.captions, *recipe.live) if not (work / picture).is_file()]:
        sys.exit(f"{recipe.command} did not write {', '.join(lacking)}")
    for picture in recipe.captions:
        thumbnail(work / picture).save(work / small(picture), quality=85)
    made = {"state": state(), "recipe": repr(recipe), "printed": done.stdout}
    (work / "made.json").write_text(json.dumps(made, indent=1), encoding="utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    work.rename(folder)


def small(picture: str) -> str:
    """Name of a picture's thumbnail, beside made.json."""
    return picture.removeprefix("out/").removesuffix(".png").replace("/", "_") + "_small.jpg"


def thumbnail(picture: Path) -> Image.Image:
    """Return the picture on white, a few hundred pixels wide."""
    with Image.open(picture) as image:
        page = Image.new("RGB", image.size, "white")
        page.paste(image.convert("RGBA"), mask=image.convert("RGBA").getchannel("A"))
    page.thumbnail((WIDTH, 2 * WIDTH), Image.Resampling.LANCZOS)
    return page


def main(names: list[str]) -> None:
    """Make what is not made yet."""
    recipes = by_name()
    if unknown := set(names) - set(recipes):
        sys.exit(f"no recipe {', '.join(sorted(unknown))}; there are {', '.join(recipes)}")
    for name, recipe in recipes.items():
        if (not names or name in names) and not is_made(recipe):
            print(recipe.command, flush=True)
            make(recipe)


if __name__ == "__main__":
    main(sys.argv[1:])
