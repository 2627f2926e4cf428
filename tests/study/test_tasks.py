"""Tasks during a stimulus and factors beside the trajectory: options, schedules, records, measures, markers."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop import study
from hpop.errors import StudyError
from hpop.study import tasks
from hpop.study.answers import Ledger
from hpop.study.factors import turns
from hpop.study.markers import Markers
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Landmark
from tests.study.conftest import CONSENT
from tests.study.sessions import events_of, put, session

TASKS: dict[str, Any] = {
    "rating": {"every": 4, "shown": 3},
    "slider": {"rate": 5},
    "head": {},
    "counting": {"least": 1, "most": 2},
    "reaction": {"least": 3, "most": 4, "wait": 1},
}


def planned(front: hpop.Front, given: Any = TASKS, **how: Any) -> study.Design:
    """Return a design of two rows with tasks."""
    protocol = study.Protocol(rest_s=0, tasks=given)
    return study.Design.of(front, [0, 1], participants=2, consent=CONSENT, protocol=protocol, **how)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"ratings": {}}, "each task must be one of rating, slider, .*Did you mean 'rating'"),
        ({"rating": {"evry": 5}}, "each option of tasks.rating must be one of every, .*Did you mean 'every'"),
        ({"slider": {"rate": 0}}, "tasks.slider.rate must be samples per second from 0.1"),
        ({"slider": {"rate": "5"}}, "tasks.slider.rate must be samples per second"),
        (
            {"counting": {"least": 4, "most": 3}},
            "tasks.counting.least must be at most tasks.counting.most, got 4 and 3",
        ),
        ({"reaction": {"least": 1}}, "tasks.reaction.wait must be at most tasks.reaction.least, got 2 and 1"),
        ({"rating": 5}, "tasks.rating must be options by name"),
        (("head", "heads"), "each task must be one of .*Did you mean 'head'"),
        ({"rating": {}}, "tasks.rating needs 70 s .*stimulus A lasts 1[0-9.]+ s: take a smaller every"),
        ({"counting": {"most": 30}}, "tasks.counting needs 31.5 s"),
        ({"reaction": {}}, "tasks.reaction needs 18 s"),
    ],
)
def test_impossible_tasks_are_refused_with_what_to_do(front: hpop.Front, given: Any, said: str) -> None:
    with pytest.raises(StudyError, match=said):
        planned(front, given)


def test_schedules_are_seeded_and_differ_between_participants_and_places(front: hpop.Front, tmp_path: Path) -> None:
    design = planned(front)
    design.save(tmp_path)
    again = study.Design.load(tmp_path)
    assert again.protocol == design.protocol
    made = [again.scheduled(who, place)["tasks"] for who in ("p01", "p02") for place in (1, 2)]
    assert made == [design.scheduled(who, place)["tasks"] for who in ("p01", "p02") for place in (1, 2)]
    assert len({tuple(one["counting"]["times"]) for one in made}) == 4
    for one, (who, place) in zip(made, [(w, p) for w in ("p01", "p02") for p in (1, 2)], strict=True):
        lasts = design.condition(design.participant(who).order[place - 1]).duration
        tones = np.array([1.0, *one["counting"]["times"]])
        assert ((np.diff(tones) >= 1 - 1e-3) & (np.diff(tones) <= 2 + 1e-3)).all()
        assert lasts - 0.5 - 2 <= tones[-1] <= lasts - 0.5
        assert one["reaction"]["times"][-1] <= lasts - 1
        assert one["rating"]["times"] == [4.0 * k for k in range(1, int((lasts - 3) / 4) + 1)]
        assert design.public(who)["places"][place - 1]["tasks"] == one
    assert "counting (least 1, most 2)" in study.preregistration(design)
    other = study.Design.of(front, [0, 1], participants=2, consent=CONSENT, protocol=design.protocol, seed=1)
    assert other.scheduled("p01", 1) != design.scheduled("p01", 1)


def test_a_study_without_tasks_and_factors_has_the_file_that_it_had(front: hpop.Front) -> None:
    described = study.Design.of(front, [0, 1], participants=2, consent=CONSENT).describe()
    assert set(described["protocol"]) == {"rest_s", "stop_rule"}
    assert "factors" not in described["conditions"][0]


def test_each_combination_of_levels_is_a_condition_of_each_row(front: hpop.Front, tmp_path: Path) -> None:
    factors: dict[str, Any] = {"latency": [0, 0.5], "cue": [None, 2], "setting": ["simulation", "live"]}
    design = study.Design.of(
        front, [0, 1, "view"], participants=34, order="williams", consent=CONSENT, factors=factors, comparisons=False
    )
    levels = [(one.row, *one.factors.values()) for one in design.conditions if one.kind != "view"]
    assert len(set(levels)) == len(levels) == 16
    assert {one.factors["setting"]: one.kind for one in design.conditions if one.factors} == {
        "simulation": "ride",
        "live": "robot",
    }
    assert all(bool(one.stimulus) == (one.kind != "robot") for one in design.conditions)
    seen = [person.order.index(letter) for person in design.participants for letter in design.letters]
    assert np.bincount(seen).tolist() == [34] * 17  # each place equally often
    design.save(tmp_path)
    assert study.Design.load(tmp_path).conditions == design.conditions


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"latncy": [0, 1]}, "each factor must be one of cue, latency, .*Did you mean 'latency'"),
        ({"latency": [0, 60]}, "a level of latency must be none, or s by which the view lags, from 0 to 10, got 60"),
        ({"latency": [0, 0]}, "factor latency must have each level once"),
        ({"latency": []}, r"factor latency must have a list of levels, such as \[0, 0.5\] \(s\), got"),
        ({"cue": 2}, r"factor cue must have a list of levels, such as \['none', 2\] \(not announced, .*, got 2"),
        ({"setting": ["simulator"]}, "a level of setting must be one of simulation, .*Did you mean 'simulation'"),
        ({"cue": list(range(1, 10)), "latency": [0, 1]}, "a study shows 2 to 26 stimuli.*got 36"),
    ],
)
def test_impossible_factors_are_refused(front: hpop.Front, factors: Any, said: str) -> None:
    with pytest.raises(StudyError, match=said):
        study.Design.of(front, [0, 1], participants=2, consent=CONSENT, factors=factors)


def test_turns_are_announced_where_they_begin() -> None:
    """A turn in place to the left, after 2 m at 1 m/s, and one to the right, of 90 degrees each."""
    robot = hpop.DifferentialDrive(radius=0.2)
    run = Trajectory.from_poses(robot, [(0, 0, 0), (2, 0, 0), (2, 2, np.pi / 2), (4, 2, 0)])
    found = turns(run)
    assert [side for _, side in found] == ["left", "right"]
    execution = run.execution()
    for t, _ in found:
        before, after = (execution.at(np.array([t + shift])).yaw[0] for shift in (-0.1, 0.6))
        assert abs(after - before) > 0.05
        assert execution.at(np.array([t])).yaw[0] == pytest.approx(before, abs=0.02)


def told(design: study.Design, item: str, value: Any) -> dict[str, Any]:
    """Return a "task" event at the first place of p01."""
    letter = design.participant("p01").order[0]
    return {"kind": "task", "place": 1, "condition": letter, "item": item, "value": value}


def with_tasks(design: study.Design, several: list[tuple[str, Any]]) -> list[dict[str, Any]]:
    """Return a whole session with events of tasks during the first ride."""
    events = events_of(design, "p01")
    begin = next(i for i, one in enumerate(events) if one["kind"] == "stimulus")
    made = [told(design, item, value) for item, value in several]
    events[begin + 1 : begin + 1] = [{"t": events[begin]["t"], "at": events[begin]["at"], **one} for one in made]
    return events


def test_measures_are_those_of_the_last_showing(front: hpop.Front, tmp_path: Path) -> None:
    design = planned(front)
    design.save(tmp_path)
    happened: list[tuple[str, Any]] = [
        ("tone", {"due": 1.0, "came": 1.0}),
        ("tone", {"due": 2.5, "came": 2.502}),
        ("count", {"value": 4}),
        ("signal", {"due": 3.0, "came": 3.0, "seconds": 0.3}),
        ("signal", {"due": 6.5, "came": 6.5, "seconds": 0.5}),
        ("signal", {"due": 9.9, "came": 9.9}),
        ("press", {"came": 5.0}),
        ("rating", {"due": 4, "came": 4, "value": 3, "seconds": 1.2}),
        ("rating", {"due": 8, "came": 8, "value": 9, "seconds": 2.0}),
        ("slider", {"samples": [[0, 0], [200, 4], [400, 8]]}),
        ("head", {"samples": [[0, 170, 0], [500, -170, 0], [1000, 170, 5]]}),
    ]
    events = with_tasks(design, happened)
    first = next(i for i, one in enumerate(events) if one["kind"] == "stimulus")
    broken = [events[first], {**events[first], **told(design, "tone", {"due": 1.0, "came": 1.0})}]
    put(tmp_path, session(design, "p01", [*events[:first], *broken, *events[first:]]))
    answers = study.Answers.load(tmp_path)
    assert {one.measure: one.value for one in tasks.measures(answers.sessions[0])} == {
        "tones": 2,
        "counted": 4,
        "count_error": 2,
        "count_error_size": 2,
        "signals": 3,
        "signals_missed": 1,
        "reaction_median": 0.4,
        "false_presses": 1,
        "ratings_missed": 0,
        "rating_mean": 6,
        "rating_max": 9,
        "rating_last": 9,
        "slider_mean": 4,
        "slider_max": 8,
        "head_speed": 40,
        "head_samples": 3,
    }
    written = {
        path.name: path.read_text().splitlines() for path in answers.save_tables(tmp_path) if path.suffix == ".csv"
    }
    letter = design.participant("p01").order[0]
    assert f"p01,1,{letter},reaction_median,0.4" in written["measures.csv"]
    assert len(written["tasks.csv"]) == 1 + 9
    assert f"p01,1,{letter},head,1.0,170.0,5.0" in [
        line.replace(",170,5", ",170.0,5.0") for line in written["samples.csv"]
    ]
    described = json.loads((tmp_path / "measures.json").read_text())
    assert set(described) == set(written["measures.csv"][0].split(","))
    assert {line.split(",")[3] for line in written["measures.csv"][1:]} <= set(described["measure"]["Levels"])
    study.withdraw(tmp_path, "p01")
    assert not list(tmp_path.glob("samples.csv")) or "p01" not in (tmp_path / "samples.csv").read_text()


@pytest.mark.parametrize(
    ("item", "value", "said"),
    [
        ("tone", {"due": "1"}, "expected numbers"),
        ("head", {"samples": [[0]]}, "expected numbers"),
        ("head", {"samples": [[0, 1]] * 501}, "expected numbers by name"),
        ("tones", {}, "the item of a task must be one of"),
        ("count", 5, "expected numbers by name"),
    ],
)
def test_records_of_tasks_are_checked(front: hpop.Front, item: str, value: Any, said: str, tmp_path: Path) -> None:
    design = planned(front)
    put(tmp_path, session(design, "p01", with_tasks(design, [(item, value)])))
    with pytest.raises(StudyError, match=said):
        study.Answers.load(tmp_path, design)
    without = planned(front, {})
    put(tmp_path, session(without, "p01", with_tasks(without, [("tone", {"due": 1})])))
    with pytest.raises(StudyError, match="the study has no task counting"):
        study.Answers.load(tmp_path, without)


def test_no_answer_about_a_video_is_accepted_before_its_share_was_watched(front: hpop.Front, tmp_path: Path) -> None:
    protocol = study.Protocol(watched=0.8)
    videos = study.Design.of(
        front, [0, 1], participants=2, consent=CONSENT, forms=("comfort",), kind="video", protocol=protocol
    )
    events = events_of(videos, "p01")
    end = next(i for i, one in enumerate(events) if one["kind"] == "stimulus" and one["value"] == "end")
    for share, is_accepted in ((0.79, False), (0.81, True)):
        ledger = Ledger(tmp_path / f"{share}.json", videos, "p01")
        value = {"share": share, "seconds": 9.0, "pauses": 0, "skips": 0, "samples": [[0, 9]]}
        watched = {**events[end - 1], "kind": "task", "item": "watched", "value": value, "t": events[end]["t"] - 0.5}
        played = {**events[end], "value": "played", "t": events[end]["t"] - 0.4}
        for event in [*events[:end], watched, played, events[end]]:
            ledger.add(event, {})
        if is_accepted:
            assert ledger.add(events[end + 1], {})
        else:
            with pytest.raises(StudyError, match="must be watched for 80% of its time"):
                ledger.add(events[end + 1], {})


def test_dwell_is_the_time_in_which_the_head_points_at_a_landmark_that_nothing_hides(tmp_path: Path) -> None:
    """Straight along x past a landmark ahead, one to the left, and one behind a wall."""
    marks = [
        Landmark(9, 1, z=1.2, name="ahead"),
        Landmark(1, 4, z=1.2, name="left"),
        Landmark(1, 6, z=1.2, name="hidden"),
    ]
    world = hpop.World.from_polygons([shapely.box(0, 4.5, 3, 5)], extent=shapely.box(0, 0, 10, 8)).with_content(
        landmarks=marks
    )
    robot = hpop.DifferentialDrive(radius=0.2)
    front = hpop.Problem(world, robot, (1, 1, 0), (4, 1, None), ["length", "turns"]).solve(step=0.5)
    protocol = study.Protocol(tasks={"head": {"rate": 10}})
    design = study.Design.of(
        front, [0], participants=2, consent=CONSENT, protocol=protocol, factors={"latency": [0, 10]}
    )
    design.save(tmp_path)
    letter = design.participant("p01").order[0]
    heads = [[100 * k, 0.0 if k < 4 else 90.0, 0.0] for k in range(10)]
    happened = [("head", {"samples": heads})]
    events = with_tasks(design, happened)
    second = [i for i, one in enumerate(events) if one["kind"] == "stimulus" and one["value"] == "begin"][1]
    other = design.participant("p01").order[1]
    events.insert(second + 1, {**events[second], "kind": "task", "item": "head", "value": {"samples": heads}})
    put(tmp_path, session(design, "p01", events))
    found = tasks.dwell(study.Answers.load(tmp_path), front, within=15)
    seen = {(one.condition, one.landmark): (one.seconds, one.glances) for one in found}
    for shown in (letter, other):
        assert seen[shown, "ahead"] == (0.4, 1)
        assert seen[shown, "left"] == (0.6, 1)
        assert seen[shown, "hidden"] == (0.0, 0)


def test_markers_reach_an_inlet_at_the_time_of_the_event() -> None:
    """An event that was sent 2 s after it happened, by a page whose clock is an hour off."""
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed: pip install 'hpop[lab]'")
    source = f"test-{time.time_ns()}"
    markers = Markers(source)
    (info,) = pylsl.resolve_byprop("source_id", source, timeout=5)
    inlet = pylsl.StreamInlet(info)
    inlet.open_stream(timeout=5)
    at = "2026-11-29T09:00:00.250Z"
    now = 1000.0 * (np.datetime64(at[:-1], "ms").astype(float) / 1000.0 + 2.0)
    value = {"due": 1.0, "samples": [[0, 1]]}
    before = pylsl.local_clock()
    markers.push("p07", {"kind": "task", "item": "tone", "place": 1, "condition": "A", "at": at, "value": value}, now)
    (text,), stamp = inlet.pull_sample(timeout=5)
    assert json.loads(text) == {
        "participant": "p07",
        "kind": "task",
        "at": at,
        "place": 1,
        "condition": "A",
        "item": "tone",
        "value": {"due": 1.0},
    }
    assert stamp + inlet.time_correction(timeout=5) == pytest.approx(before - 2.0, abs=0.05)


def test_a_simulated_study_with_tasks_and_videos_runs_through_analysis_report_and_dictionary(
    front: hpop.Front, tmp_path: Path
) -> None:
    tasks_of_all = {**TASKS, "reaction": {"least": 2, "most": 3, "wait": 2}}
    protocol = study.Protocol(rest_s=0, tasks=tasks_of_all)
    design = study.Design.of(front, [0, 1, 2], participants=6, consent=CONSENT, protocol=protocol, kind="video")
    made = study.simulate(design, {"A": 0.0, "B": 2.0, "C": 5.0}, seed=1)
    design.save(tmp_path)
    for one in made.sessions:
        events = [event.model_dump(exclude_none=True) for event in one.events]
        stored = {"schema": "hpop-answers", "version": 1, "design": design.digest, "participant": one.person.id}
        put(tmp_path, stored | {"device": one.device, "events": events})
    answers = study.Answers.load(tmp_path)  # each event passes the checks of the server
    assert answers.faults == ()
    names = tasks.task_scores(design)
    assert {"rating_max", "slider_mean", "head_speed", "count_error", "reaction_median", "watched", "pauses"} <= {
        *names
    }
    for name in names:
        result = study.analyse(design, answers, score=("tasks", name))
        assert not np.isnan(result.answers.matrix("tasks", name).values).any()
        assert "SIMULATED" in result.text()
    rated = answers.matrix("tasks", "rating_last").values.mean(axis=0)
    assert rated[0] < rated[1] < rated[2]
    page = study.analyse(design, answers, score=("tasks", "pauses")).save(tmp_path / "report")
    assert "Number of pauses of the video" in page.read_text()
    written = {path.name for path in answers.save_tables(tmp_path)}
    assert {"tasks.csv", "samples.csv", "measures.csv", "wide.csv"} <= written
    described = json.loads((tmp_path / "wide.json").read_text())
    assert "tasks_watched_A" in described
    assert {line.split(",")[3] for line in (tmp_path / "samples.csv").read_text().splitlines()[1:]} == {
        "slider",
        "head",
    }


def test_simulated_records_of_tasks_keep_the_schedule_and_leave_the_answers_as_they_were(front: hpop.Front) -> None:
    design, plain = planned(front), planned(front, {})
    felt = dict.fromkeys(design.letters, 1.0)
    made = study.simulate(design, felt, seed=4)
    assert [row.value for row in made.table] == [row.value for row in study.simulate(plain, felt, seed=4).table]
    for one in made.sessions:
        for place, events in tasks.last_showings(one).items():
            due = design.scheduled(one.person.id, place)["tasks"]
            for item, task in (("tone", "counting"), ("signal", "reaction"), ("rating", "rating")):
                assert [event.value["due"] for event in events if event.item == item] == due[task]["times"]
            head = tasks.samples_of([event.value for event in events if event.item == "head"])
            lasts = design.condition(one.person.order[place - 1]).duration
            assert np.diff(head[:, 0]) == pytest.approx(1000 / 30, abs=1)
            assert head[-1, 0] / 1000 == pytest.approx(lasts, abs=0.05)


def test_measures_of_videos_are_scores_of_studies_with_videos(front: hpop.Front) -> None:
    videos = study.Design.of(front, [0, 1], participants=2, consent=CONSENT, forms=("comfort",), kind="video")
    assert tasks.task_scores(videos) == {"watched": "", "pauses": "", "skips": ""}
    assert "tasks.watched" in study.preregistration(videos, score=("comfort", "comfort"))
    rides = study.Design.of(front, [0, 1], participants=2, consent=CONSENT, forms=("comfort",))
    with pytest.raises(StudyError, match="no tasks and no videos"):
        study.analyse(rides, study.simulate(rides, {"A": 0, "B": 0}), score=("tasks", "pauses"))


SLOWER = 0.125
"""s by which a reaction is slower during C than during A and B."""


def reacting(design: study.Design, participant: str, effect: float, noise: float) -> list[dict[str, Any]]:
    """Return a session of a person who reacts at a speed of their own, slower by ``effect`` during C, and miscounts it.

    A normal error of ``noise``, s, belongs to each stimulus. The head turns by 3 degrees in 0.1 s during A, by 6
    during B, and by 9 during C.
    """
    rng = np.random.default_rng([3, int(participant[1:])])
    own, turned = 0.3 + 0.2 * rng.random(), {"A": 3, "B": 6, "C": 9}
    events = []
    for event in events_of(design, participant):
        events.append(event)
        if event["kind"] != "stimulus" or event["value"] != "begin":
            continue
        letter, late = event["condition"], effect if event["condition"] == "C" else 0.0
        took = max(own + late + noise * rng.standard_normal(), 0.1)
        wrong = 0 if letter != "C" or not effect else int(rng.choice([-1, 1]))
        said: list[tuple[str, Any]] = [("tone", {"due": 2.0 + i, "came": 2.0 + i}) for i in range(4)]
        said += [("count", {"value": 4 + wrong})]
        said += [("signal", {"due": t, "came": t, "seconds": took + dt}) for t, dt in ((4, -0.1), (8, 0), (12, 1))]
        said += [("rating", {"due": 4, "came": 4, "value": 5 if late else 2, "seconds": 1})]
        said += [("head", {"samples": [[0, 0, 0], [100, turned[letter], 0]]})]
        where = {"t": event["t"], "at": event["at"], "kind": "task", "place": event["place"], "condition": letter}
        events += [{**where, "item": item, "value": value} for item, value in said]
    return events


def reactions(front: hpop.Front, folder: Path, effect: float, noise: float = 0.0) -> study.Answers:
    """Return the answers of twelve people whose reactions during C are slower by ``effect``, s."""
    protocol = study.Protocol(rest_s=0, tasks={name: option for name, option in TASKS.items() if name != "slider"})
    design = study.Design.of(front, [0, 1, 2], participants=12, consent=CONSENT, protocol=protocol)
    folder.mkdir(exist_ok=True)
    design.save(folder)
    for person in design.participants:
        put(folder, session(design, person.id, reacting(design, person.id, effect, noise)))
    return study.Answers.load(folder)


def test_measures_of_tasks_are_analysed_as_scores_and_their_effect_is_found(front: hpop.Front, tmp_path: Path) -> None:
    answers = reactions(front, tmp_path, SLOWER)
    result = study.analyse(answers.design, answers, score=("tasks", "reaction_median"))
    for row in result.tables["pairs"]:
        late = SLOWER if row["second"].startswith("C") else 0.0
        assert row["shift"] == pytest.approx(late, abs=1e-5)  # measures are rounded to 1e-6 s
        assert (row["adjusted p"] < 0.01) == (late > 0)
    assert result.before is None
    assert "against before" not in result.tables
    assert "Median time from a signal to the reaction" in result.choices["Measure"]
    assert "Questionnaire" not in result.choices
    for name, in_c, otherwise in (("rating_mean", 5, 2), ("count_error_size", 1, 0)):
        values = answers.matrix("tasks", name).values
        assert (values == [otherwise, otherwise, in_c]).all()
        assert study.analyse(answers.design, answers, score=("tasks", name)).tables["test"][0]["p"] < 0.001
    head = answers.matrix("tasks", "head_speed")
    assert (head.values == [30, 60, 90]).all()
    assert [row["place"] for row in result.tables["places"]] == [1, 2, 3]
    signed = study.analyse(answers.design, answers, score=("tasks", "count_error"))
    assert signed.tables["test"][0]["p"] > 0.05  # as many counted too few as too many


def test_without_an_effect_on_reactions_none_is_found_and_a_mixed_model_takes_them(
    front: hpop.Front, tmp_path: Path
) -> None:
    same = reactions(front, tmp_path / "same", 0.0)
    assert study.analyse(same.design, same, score=("tasks", "reaction_median")).tables["test"][0]["p"] > 0.9
    slower = reactions(front, tmp_path / "slower", 0.2, noise=0.1)
    mixed = study.analyse(slower.design, slower, score=("tasks", "reaction_median"), method="mixed")
    assert mixed.tables["test"][0]["p"] < 0.001
    assert [row["adjusted p"] < 0.01 and row["odds ratio"] > 1 for row in mixed.tables["pairs"]] == [False, True, True]
    alike = reactions(front, tmp_path / "alike", 0.0, noise=0.1)
    assert (
        study.analyse(alike.design, alike, score=("tasks", "reaction_median"), method="mixed").tables["test"][0]["p"]
        > 0.05
    )


def test_a_report_a_wide_table_and_a_preregistration_name_a_measure(front: hpop.Front, tmp_path: Path) -> None:
    answers = reactions(front, tmp_path, SLOWER)
    result = study.analyse(answers.design, answers, score=("tasks", "count_error_size"))
    page = result.save(tmp_path / "report").read_text()
    assert "Counted tones minus tones, without its sign: count_error_size" in page
    assert "('tasks', 'count_error_size')" in (tmp_path / "report" / "repeat.py").read_text()
    answers.save_tables(tmp_path)
    header, *rows = (tmp_path / "wide.csv").read_text().splitlines()
    column = header.split(",").index("tasks_count_error_size_C")
    assert {float(row.split(",")[column]) for row in rows} == {1.0}
    assert (
        "without its sign"
        in json.loads((tmp_path / "wide.json").read_text())["tasks_count_error_size_C"]["Description"]
    )
    text = study.preregistration(answers.design, score=("tasks", "reaction_median"))
    assert "**Primary score.** tasks.reaction_median (lower is better)." in text
    assert "tasks.head_speed" in text


@pytest.mark.parametrize(
    ("given", "name", "said"),
    [
        (TASKS, "reaction_mean", "measure must be one of rating_mean, .*Did you mean 'reaction_median'"),
        (TASKS, "tones", "measure must be one of"),
        ({"head": {}}, "reaction_median", "measure must be one of head_speed"),
        ({}, "reaction_median", "the study has no tasks and .*give a score of a form: ssq, "),
        (TASKS, "rating_mean", "no participant has all answers for the measure rating_mean"),
    ],
)
def test_measures_that_the_study_does_not_have_are_refused(front: hpop.Front, given: Any, name: str, said: str) -> None:
    design = planned(front, given)
    with pytest.raises(StudyError, match=said):
        study.analyse(design, study.Answers(design, ()), score=("tasks", name))
