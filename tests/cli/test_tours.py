"""A floor plan, drawn as a picture, is toured with the commands of README and the keys that a new scenario suggests."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image, ImageDraw

import hpop

ROOT = Path(__file__).resolve().parents[2]
PIXEL = 0.02  # m
DESK, PLANT = (1.4, 1.4), (6.6, 4.9)  # m


def draw_plan(path: Path) -> np.ndarray:
    """Draw two rooms of 4 x 6 m with a door of 1.2 m between them; return the pixels, row 0 at the bottom."""
    image = Image.new("L", (400, 300), 255)
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, 399, 299), outline=0, width=6)
    draw.rectangle((196, 0, 203, 110), fill=0)
    draw.rectangle((196, 170, 203, 299), fill=0)
    image.save(path)
    return np.asarray(image)[::-1]


def test_a_drawn_floor_plan_is_toured_with_the_commands_of_readme(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    pixels = draw_plan(tmp_path / "plan.png")
    readme = (ROOT / "README.md").read_text()
    look, new, plan = re.findall(r"^    hpop ((?:look|new|plan) plan\S*\.(?:png|yaml) .*?) *#", readme, re.MULTILINE)
    for command in (look, new):
        assert run(*shlex.split(command)).exit_code == 0

    # The file suggests landmarks and a tour in comments: without "# " they are keys.
    scenario = tmp_path / "plan_scenario.yaml"
    text = re.sub(
        r"# (landmarks:.*)\n# (.*)", rf"\1\n  - {{x: {PLANT[0]}, y: {PLANT[1]}, name: plant}}", scenario.read_text()
    )
    head, tour = text.split("# tour:")
    tour = re.sub(r"^# ", "", "# tour:" + tour, flags=re.MULTILINE)
    tour = re.sub(r"at: \[.*?\]", f"at: {list(DESK)}", tour).replace("hall", "desk")
    tour = tour.replace("door, within: 3.0, dwell: 10", "plant, within: 2.0, dwell: 5")
    scenario.write_text(head.replace("# - stops_missed", "- stops_missed").replace("step: 0.25", "step: 0.5") + tour)

    planned = run(*shlex.split(plan))
    assert planned.exit_code == 0, planned.output
    assert "stops, in the order of visits: 1 desk, 2 plant" in planned.output
    assert "verified" in run("show", "out/plan").output
    assert {"front.json", "front.html", "map.png", "front.png", "trace.png"} <= {
        p.name for p in Path("out/plan").iterdir()
    }

    front = hpop.Front.load("out/plan/front.json")
    assert set(front.costs[:, front.names.index("stops_missed")]) == {0.0, 1.0}
    for trajectory, origin in zip(front.trajectories, front.provenance, strict=True):
        visits = {visit["stop"]: (visit["begin"], visit["end"]) for visit in origin["visits"]}
        assert "desk" in visits
        for name, (begin, end) in visits.items():
            place, within, dwell = {"desk": (DESK, 1.0, 10.0), "plant": (PLANT, 2.0, 5.0)}[name]
            states = trajectory.at(np.linspace(begin, end, 9))
            away = np.stack([states.x, states.y]) - np.array(place)[:, None]
            assert end - begin == pytest.approx(dwell)
            assert np.ptp(away, axis=1) == pytest.approx([0.0, 0.0])
            assert np.hypot(*away).max() <= within + 1e-9
            if name == "plant":  # no dark pixel on the line of sight
                line = np.array(place)[:, None] + away[:, [0]] * np.linspace(0, 1, 300)
                column, row = (line / PIXEL).astype(int)
                assert (pixels[row, column] == 255).all()


@pytest.mark.proof
def test_the_tour_that_a_new_scenario_suggests_can_be_planned_as_it_is(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    draw_plan(tmp_path / "plan.png")
    scenario = tmp_path / "plan.yaml"
    assert run("new", str(tmp_path / "plan.png"), "--resolution", "0.02", "--out", str(scenario)).exit_code == 0
    head, suggested = scenario.read_text().split("# landmarks:")
    keys = re.sub(r"^# ", "", f"# landmarks:{suggested}", flags=re.MULTILINE)
    head = head.replace("# field_of_view", "field_of_view").replace("# - stops_missed", "- stops_missed")
    scenario.write_text(head.replace("step: 0.25", "step: 0.5") + keys)

    problem = hpop.scenario.load_scenario(scenario).problem
    assert problem.tour is not None
    assert problem.tour.names == ("hall", "door")
    hall = problem.tour.stops[0].at
    assert hall is not None
    for x, y, _ in (problem.start, *problem.goals):
        assert np.hypot(hall[0] - x, hall[1] - y) > 2.0  # so the robot drives to it
    assert set(problem.solve("lattice", step=0.5).costs[:, 2]) == {0.0, 1.0}
