"""Pages of a study: stimuli and sessions."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop import study
from hpop.errors import StudyError
from hpop.runtime.limits import Progress
from hpop.study import Design
from hpop.study.documents import words
from hpop.study.page import rides_of, session_page
from hpop.world.content.content import Landmark, Person
from tests.study.conftest import CONSENT
from tests.study.sessions import answered


@pytest.fixture(scope="module")
def design(front: hpop.Front) -> study.Design:
    """Two rows and the still view."""
    return study.Design.of(front, ["knee", "least turns", "view"], participants=6, consent=CONSENT, seed=3)


@pytest.fixture(scope="module")
def folder(front: hpop.Front, design: study.Design, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a study whose world has names: of a person, which is not shown, and of a plate."""
    made = tmp_path_factory.mktemp("study")
    problem = hpop.Problem.from_description(front.problem or {})
    world = problem.world.with_content(
        people=[Person(4.5, 3.5, name="Ada")], landmarks=[Landmark(4.9, 1, z=1.2, name="exit")]
    )
    named = hpop.Problem(world, problem.model, problem.start, problem.goal, problem.criteria)
    study.save_stimuli(named, front, design.conditions, made / "stimuli")
    return made


def payload(page: str) -> Any:
    """Return the payload of a page."""
    (text,) = re.findall(r'<script type="application/json" id="payload">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def positions(stimulus: Any) -> np.ndarray:
    packed = stimulus["track"]["positions"]
    return np.stack([np.cumsum(np.cumsum(column)) for column in packed["columns"]], axis=1) * float(packed["scale"])


def test_a_ride_is_the_executed_trajectory_and_the_view_stays_at_its_start(
    front: hpop.Front, design: study.Design, folder: Path
) -> None:
    for condition in design.conditions:
        stimulus = payload((folder / condition.stimulus).read_text())
        assert stimulus["name"] == condition.id
        assert stimulus["still"] == (condition.row is None)
        assert stimulus["track"]["duration"] == pytest.approx(condition.duration)
        seen = positions(stimulus)
        if condition.row is None:
            assert seen.shape == (2, 3)
            assert np.allclose(seen, [0.5, 2.0, seen[0, 2]])
        else:
            run = front.trajectories[condition.row].execution()
            there = run.at(np.minimum(np.arange(len(seen)) / 20.0, run.duration))
            assert np.allclose(seen[:, :2], np.stack([there.x, there.y], axis=1), atol=1e-4)


def test_a_stimulus_names_nothing_but_its_letter_and_what_is_read_in_it(
    front: hpop.Front, design: study.Design, folder: Path
) -> None:
    for condition in design.conditions:
        page = (folder / condition.stimulus).read_text()
        assert f"<title>{condition.id}</title>" in page
        stimulus = payload(page)
        del stimulus["licence"], stimulus["words"]
        text = json.dumps(stimulus)
        for told in ("Ada", "knee", "least", "row ", *front.names, *map(str, condition.costs.values())):
            assert f'"{told}' not in text, told
        assert text.count("exit") == 1
        assert stimulus["track"]["rates"] is None
        assert stimulus["track"]["costs"] == []


def test_the_page_holds_what_is_public_the_rides_and_their_ways(
    front: hpop.Front, design: study.Design, folder: Path
) -> None:
    public = design.public("p02")
    page = study.session_page(public, folder)
    given = payload(page)
    assert given["form"] == public
    assert set(given["rides"]) == set(design.letters)
    for condition in design.conditions:
        way = np.array(given["plan"]["ways"][condition.id])
        if condition.row is not None:
            states = front.trajectories[condition.row].states
            corners = {(x, y) for x, y in np.round(np.stack([states.x, states.y], axis=1), 2).tolist()}
            assert {tuple(point) for point in np.round(way, 1).tolist()} <= {
                (round(x, 1), round(y, 1)) for x, y in corners
            }
        else:
            assert np.ptp(way, axis=0).max() == 0.0
    assert "connect-src 'none'" in page
    assert "connect-src 'self'" in study.session_page(public, folder, served=True)
    assert len(page) < 400_000


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        (lambda text: text.replace("hpop-stimulus", "hpop-stimulant"), "not a stimulus of this version"),
        (lambda text: text.replace('"name":"A"', '"name":"B"', 1), "shows condition"),
        (lambda text: text.replace("sha256-", "sha256-x"), "not a stimulus that hpop wrote"),
        (lambda text: text.replace('id="bundle">', 'id="bundle">AAAA'), "different versions"),
        (lambda _: "<p>A</p>", "not a stimulus that hpop wrote"),
        (lambda text: text.replace('{"schema"', '{"schema":1,"schema"'), "not a stimulus that hpop wrote"),
        (None, "cannot be read"),
    ],
    ids=["schema", "letter", "policy", "bundle", "no page", "twice", "missing"],
)
def test_what_is_no_stimulus_is_refused(
    spoilt: Any, said: str, design: study.Design, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "stimuli").mkdir()
    for file in (folder / "stimuli").iterdir():
        text = file.read_text()
        if file.stem == "A":
            if spoilt is None:
                continue
            text = spoilt(text)
        (tmp_path / "stimuli" / file.name).write_text(text)
    with pytest.raises(StudyError, match=said):
        rides_of(design.public("p01"), tmp_path)


def test_words_of_another_language_are_a_file_of_the_study(tmp_path: Path) -> None:
    english = words("en")
    (tmp_path / "words").mkdir()
    file = tmp_path / "words" / "de.json"
    file.write_text(json.dumps({**english, "stop": "Halt"}))
    assert words("de", tmp_path)["stop"] == "Halt"
    for wrong, said in (
        ({**english, "hello": "?"}, "hello"),
        ({key: text for key, text in english.items() if key != "stop"}, "lacks the texts stop"),
        ({**english, "step": "Schritt {step}"}, "step must have the placeholders"),
        ({**english, "step": "Schritt {step"}, "step must have the placeholders"),
        ({**english, "stop": 1}, "object of texts"),
    ):
        file.write_text(json.dumps(wrong))
        with pytest.raises(StudyError, match=said):
            words("de", tmp_path)
    few = {key: text for key, text in english.items() if key not in ("stop", "agree")}
    file.write_text(json.dumps({**few, "hello": "?", "step": "Schritt"}))
    with pytest.raises(
        StudyError,
        match="lacks the texts agree, stop; has 'hello', which no page uses; step must have the placeholders",
    ):
        words("de", tmp_path)
    with pytest.raises(StudyError, match="no texts in 'fr'"):
        words("fr", tmp_path)
    with pytest.raises(StudyError, match="language must be a code"):
        words("../en", tmp_path)


def test_the_stimulus_of_a_baseline_is_its_trajectory_which_must_be_given(front: hpop.Front, tmp_path: Path) -> None:
    beside = study.Baseline("common planner", front.trajectories[4], {})
    made = study.Design.of(front, [0], participants=2, consent=CONSENT, baselines=[beside])
    (letter,) = (one.id for one in made.conditions if one.row is None)
    problem = hpop.Problem.from_description(front.problem or {})
    shown = [made.condition(letter)]
    with pytest.raises(StudyError, match=f"stimulus {letter} is a baseline, not a row of the front"):
        study.save_stimuli(problem, front, shown, tmp_path)
    path = study.save_stimuli(problem, front, shown, tmp_path, baselines={letter: beside.trajectory})[letter]
    assert payload(path.read_text())["track"]["duration"] == pytest.approx(beside.trajectory.execution().duration)


def test_the_stop_rule_is_said_in_the_language_of_the_page_unless_the_study_has_its_own(
    design: study.Design, tmp_path: Path
) -> None:
    assert words("en")["stop_rule"] == study.Protocol().stop_rule
    public = {**design.public("p01"), "language": "de", "places": []}
    (tmp_path / "words").mkdir()
    texts = {**words("en"), "stop_rule": "Sie dürfen jederzeit aufhören."}
    (tmp_path / "words" / "de.json").write_text(json.dumps(texts))
    assert payload(session_page(public, tmp_path))["form"]["protocol"]["stop_rule"] == "Sie dürfen jederzeit aufhören."
    own = {**public, "protocol": {**public["protocol"], "stop_rule": "Say stop."}}
    assert payload(session_page(own, tmp_path))["form"]["protocol"]["stop_rule"] == "Say stop."


@pytest.mark.proof  # frames are drawn at full size
def test_of_videos_progress_names_which_of_how_many_it_draws(front: hpop.Front, tmp_path: Path) -> None:
    pytest.importorskip("av")
    videos = study.Design.of(front, [0, 1], participants=2, consent=CONSENT, forms=("comfort",), kind="video")
    told: list[str] = []

    def interrupt(progress: Progress) -> None:
        told.append(f"{progress.stage} {progress.detail}")
        raise KeyboardInterrupt

    problem = hpop.Problem.from_description(front.problem or {})
    with pytest.raises(KeyboardInterrupt):
        study.save_stimuli(problem, front, videos.conditions, tmp_path / "s", progress=interrupt)
    assert len(told) == 1
    assert re.fullmatch(rf"drawing video {videos.conditions[0].id}, 1 of 2: frame 1 of [0-9,]+", told[0])
    assert list(tmp_path.rglob("*.mp4*")) == []


PAGE = Path(__file__).parents[2] / "docs" / "study.md"


def test_the_python_of_the_page_runs(front: hpop.Front, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hpop.study.report.DPI", 30)
    names: dict[str, object] = {"hpop": hpop, "front": front}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(compile(block, str(PAGE), "exec"), names)
        if "study.prepare(" in block:
            design = Design.load("study")
            answered(design, Path("study"), ["p07", "p08", "p09"], lambda who, *_: float(who == "p07"))
    assert Design.load("study").withdrawn == {"p07"}
