"""A participant's session in a real browser: what is clicked is what is on the disk, and nothing is lost unsaid."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from hpop import study
from tests.browser.sessions import BEGIN, Participant, served, small_study, too_small

Enter = Callable[..., Participant]
RATED = {"Comfort of the ride": 7}
CHOSEN = {
    "Which of the two was more comfortable?": "No difference",
    "Which of the two would you choose for your next visit?": "Ride {}",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, study.Design]:
    folder = tmp_path_factory.mktemp("study")
    return folder, small_study(folder, "fms", "comfort")


@pytest.fixture
def design(made: tuple[Path, study.Design]) -> study.Design:
    return made[1]


@pytest.fixture
def folder(made: tuple[Path, study.Design]) -> Path:
    for file in (made[0] / "answers").glob("*.json"):
        file.unlink()
    return made[0]


@pytest.fixture
def enter(browser: Browser) -> Iterator[Enter]:
    """Lets a participant in, who must see no error."""
    entered: list[Participant] = []

    def one(address: str, **how: Any) -> Participant:
        entered.append(Participant(browser, address, **how))
        return entered[-1]

    yield one
    for participant in entered:
        participant.close()
        assert participant.complaints == []


def events(folder: Path, participant: str = "p01") -> list[dict[str, Any]]:
    """Return the events stored on disk."""
    stored: dict[str, Any] = json.loads((folder / "answers" / f"{participant}.json").read_text())
    return list(stored["events"])


def saved(participant: Participant) -> None:
    """Wait until the page says that everything is saved."""
    expect(participant.page.locator("header .saved")).to_have_text("Saved")


def reload(participant: Participant) -> None:
    """Reload the page once everything is saved, and wait until it is saved again."""
    saved(participant)
    participant.page.reload()
    participant.ready()
    saved(participant)


def test_answers_on_the_disk_are_what_was_clicked(enter: Enter, folder: Path, design: study.Design) -> None:
    with served(folder) as server:
        someone = enter(f"{server.address()}p01")
        someone.agree()
        someone.answer({"Sickness": 2})
        someone.press("Continue")
        expected: dict[tuple[int, str], float] = {(0, "fms"): 2}
        for place, letter in enumerate(design.participant("p01").order, 1):
            condition = design.condition(letter)
            someone.begin_ride()
            if condition.row is None:
                check_arrows_look_around(someone)
                someone.watch(condition.duration)  # goes on by itself: it was drawn smoothly
            else:
                someone.sit_out(condition.duration)
            someone.answer({"Sickness": place})
            someone.answer({"Sickness": 3 * place})  # a second thought
            someone.press("Continue")
            someone.answer({"Comfort of the ride": 10 - place})
            someone.press("Continue")
            expected |= {(place, "fms"): 3 * place, (place, "comfort"): 10 - place}
            if place < 3:
                someone.rest()
        ((left, right),) = design.pairs("p01")
        someone.answer({question: choice.format(right) for question, choice in CHOSEN.items()})
        someone.press("Continue")
        someone.page.locator("textarea").fill("It was fine.\nThanks!")
        someone.press("Continue")
        assert someone.heading() == "Thank you"
        expect(someone.page.locator("main")).to_contain_text("All your answers are saved.")
        hosts = {url.split("/")[2] for url in someone.asked if url.startswith("http")}
        assert hosts == {server.address().split("/")[2]}

    answers = study.Answers.load(folder)
    assert {(row.place, row.form): row.value for row in answers.table} == expected
    rows = {letter: design.condition(letter).row for letter in (left, right)}
    (preferred,) = answers.choices(question="prefer")
    assert (preferred.first_row, preferred.second_row, preferred.chosen_row) == (rows[left], rows[right], rows[right])
    (comfortable,) = answers.choices(question="comfort")
    assert comfortable.chosen_row is None
    (session,) = answers.sessions
    assert [remark.text for remark in session.remarks] == ["It was fine.\nThanks!"]
    assert session.ended
    jerky = {letter for letter, _ in session.jerky}
    assert jerky == {condition.id for condition in design.conditions if condition.row is not None}
    assert [event.kind for event in session.events][:2] == ["consent", "start"]
    times = [event.t for event in session.events]
    assert times == sorted(set(times))
    assert all(event.at.endswith("Z") and event.at.startswith(f"{BEGIN:%Y-%m-%dT%H}") for event in session.events)


@pytest.mark.proof
def test_a_reload_goes_on_where_it_was_with_the_answers_so_far(enter: Enter, folder: Path) -> None:
    with served(folder) as server:
        someone = enter(f"{server.address()}p01")
        someone.agree()
        someone.answer({"Sickness": 4})
        reload(someone)
        assert events(folder)[-1]["kind"] == "resume"
        assert [event["value"] for event in events(folder) if event["kind"] == "answer"] == [4]
        expect(someone.page.locator("iframe")).to_be_visible()  # that form is answered: the ride is next
        someone.begin_ride()
        reload(someone)
        someone.begin_ride()  # from its beginning
        someone.sit_out(60)
        someone.answer({"Sickness": 5})
        saved(someone)
        someone.press("Continue")
        reload(someone)
        assert someone.heading() == "How comfortable was this ride?"
        someone.answer(RATED)
        someone.press("Continue")
        someone.let_pass(15)
        expect(someone.page.locator("main")).to_contain_text("You can continue in 0:05.")
        reload(someone)
        expect(someone.page.locator("main")).to_contain_text("You can continue in 0:05.")
        assert someone.page.get_by_role("button", name="Continue", exact=True).is_disabled()
    begun = [event for event in events(folder) if event["kind"] == "stimulus"]
    assert [event["value"] for event in begun] == ["begin", "begin", "end"]


@pytest.mark.proof
def test_who_stops_is_asked_how_they_feel_and_no_more(enter: Enter, folder: Path, design: study.Design) -> None:
    with served(folder) as server:
        someone = enter(f"{server.address()}p01")
        someone.agree()
        someone.answer({"Sickness": 0})
        someone.press("Continue")
        someone.begin_ride()
        someone.press("Stop")
        assert someone.page.locator("iframe").count() == 0  # nothing moves any more
        someone.press("Go on")
        someone.begin_ride()
        someone.press("Stop")
        someone.press("Stop the session")
        assert "The session is stopped" in someone.page.locator("main").inner_text()
        someone.answer({"Sickness": 12})
        someone.press("Continue")
        assert someone.heading() == "The session is stopped"
        expect(someone.page.locator("main")).to_contain_text("All your answers are saved.")
        assert someone.page.locator("#stop").is_hidden()
        reload(someone)
        assert someone.heading() == "The session is stopped"
    answers = study.Answers.load(folder)
    assert answers.sessions[0].stopped
    first = design.participant("p01").order[0]
    assert [(row.place, row.condition, row.value) for row in answers.table] == [(0, None, 0), (1, first, 12)]
    kinds = [(event["kind"], event.get("value")) for event in events(folder) if event["kind"] in ("stimulus", "stop")]
    assert kinds == [("stimulus", "begin"), ("stimulus", "broken")] * 2 + [("stop", None)]


@pytest.mark.proof
def test_what_does_not_arrive_is_said_and_sent_again(enter: Enter, folder: Path) -> None:
    with served(folder) as server:
        port = server.server_address[1]
        someone = enter(f"{server.address()}p01")
        someone.agree()
        saved(someone)
    someone.answer({"Sickness": 3})
    expect(someone.page.locator(".banner")).to_contain_text("1 not saved yet")
    someone.press("Continue")
    someone.begin_ride()
    with served(folder, port):
        someone.let_pass(2)
        expect(someone.page.locator(".banner")).to_be_empty()
        saved(someone)
    assert [event["kind"] for event in events(folder)] == ["consent", "start", "answer", "stimulus"]
    someone.complaints.clear()  # of connections that were refused


@pytest.mark.proof
def test_of_two_windows_the_earlier_says_that_it_records_no_more(enter: Enter, folder: Path) -> None:
    with served(folder) as server:
        earlier, later = (enter(f"{server.address()}p01") for _ in range(2))
        later.agree()
        earlier.agree()
        expect(earlier.page.locator(".banner")).to_contain_text("opened in another window")
        assert earlier.page.get_by_role("button", name="Continue", exact=True).count() == 0
        saved(later)
        earlier.complaints.clear()  # of the reply that refused
    assert [event["kind"] for event in events(folder)] == ["consent", "start"]


@pytest.mark.proof
def test_opened_as_a_file_it_says_what_a_reload_loses_and_hands_all_over_at_the_end(
    enter: Enter, folder: Path, tmp_path: Path, design: study.Design
) -> None:
    (tmp_path / "p02.html").write_text(study.session_page(design.public("p02"), folder))
    someone = enter((tmp_path / "p02.html").as_uri())
    expect(someone.page.locator(".banner")).to_contain_text("all of them are lost")
    someone.agree()
    someone.answer({"Sickness": 1})
    someone.press("Stop")
    someone.press("Stop the session")
    with someone.page.expect_download() as download:
        someone.press("Save the answers")
    expect(someone.page.locator(".banner")).to_be_empty()  # nothing would be lost any more
    assert download.value.suggested_filename == "p02.json"
    (folder / "answers").mkdir(exist_ok=True)
    download.value.save_as(folder / "answers" / "p02.json")
    answers = study.Answers.load(folder)
    assert [(row.participant, row.place, row.value) for row in answers.table] == [("p02", 0, 1)]
    assert answers.sessions[0].stopped
    someone.page.reload()
    someone.ready()
    assert someone.heading() == "Before we begin"
    assert [url for url in someone.asked if not url.startswith(("file:", "data:", "blob:"))] == []


EVERY_FORM = pytest.param(("mssq", "ssq", "comfort", "naturalness"), 2, 3, marks=pytest.mark.proof)


@pytest.mark.proof
@pytest.mark.parametrize(("forms", "before", "after"), [(("fms", "comfort"), 1, 2), EVERY_FORM])
def test_on_a_phone_nothing_is_wider_than_the_screen_and_the_keyboard_is_enough(
    enter: Enter, tmp_path: Path, forms: tuple[str, ...], before: int, after: int
) -> None:
    """Forms, ride and rest, without a pointer."""
    design = small_study(tmp_path, *forms)
    page = tmp_path / "p01.html"
    page.write_text(study.session_page(design.public("p01"), tmp_path))
    someone = enter(page.as_uri(), size=(390, 844))
    keys = someone.page.keyboard
    someone.page.locator("#agree").focus()
    keys.press("Space")
    keys.press("Tab")
    keys.press("Enter")
    for _ in range(before):
        check_phone(someone)
        answer_by_keys(someone)
    check_phone(someone)
    someone.ride()
    someone.page.locator("#stop").focus()
    keys.press("Enter")
    assert someone.page.evaluate("document.querySelector('dialog').contains(document.activeElement)")
    keys.press("Escape")
    someone.ride()
    someone.page.wait_for_function("document.activeElement.tagName === 'IFRAME'")
    keys.press("Tab")
    keys.press("Enter")
    expect(someone.page.frame_locator("iframe").locator("#card")).to_be_hidden()
    check_phone(someone)
    for part in (60.0, 1.0):
        someone.let_pass(part)
    someone.page.wait_for_function("document.activeElement.textContent === 'Continue'")
    keys.press("Enter")
    for _ in range(after):
        check_phone(someone)
        answer_by_keys(someone)
    assert someone.heading() == "Rest"
    check_phone(someone)


def check_arrows_look_around(someone: Participant) -> None:
    """In a view in which nothing else moves: to the left, and back."""
    keys, view = someone.page.keyboard, someone.page.frame_locator("iframe").locator("canvas")
    pictures = []
    for key in (None, "ArrowLeft", "ArrowRight"):
        for _ in range(10 if key else 0):
            keys.press(str(key))
        someone.page.clock.run_for(1000 if key is None else 50)  # until it has faded in
        pictures.append(view.screenshot())
    ahead, left, again = pictures
    assert ahead == again != left


@pytest.mark.proof
def test_videos_are_seen_elsewhere_and_their_names_are_asked_about(enter: Enter, tmp_path: Path) -> None:
    """Served, on a phone, seen in another player: begin, end, stop in the middle of the second."""
    design = small_study(tmp_path, "comfort", kind="video")
    first, second = design.participant("p01").order
    with served(tmp_path) as server:
        someone = enter(f"{server.address()}p01", size=(390, 844))
        someone.agree()
        assert someone.heading() == f"Video {first}"
        check_phone(someone)
        someone.press("Start")
        ended = someone.page.get_by_role("button", name="The video has ended")
        expect(ended).to_be_disabled()  # it cannot have
        someone.let_pass(design.condition(first).duration)
        ended.click()
        someone.answer(RATED)
        someone.press("Continue")
        someone.rest()
        someone.press("Start")
        someone.press("Stop")
        someone.press("Stop the session")
        assert "The session is stopped" in someone.page.locator("main").inner_text()
        someone.answer({"Comfort of the ride": 2})
        someone.press("Continue")
        expect(someone.page.locator("main")).to_contain_text("All your answers are saved.")
    told = [(event["condition"], event["value"]) for event in events(tmp_path) if event["kind"] == "stimulus"]
    assert told == [(first, "begin"), (first, "end"), (second, "begin"), (second, "broken")]
    assert [(row.condition, row.value) for row in study.Answers.load(tmp_path).table] == [(first, 7), (second, 2)]


@pytest.mark.proof
def test_a_page_of_who_has_withdrawn_offers_nothing(enter: Enter, tmp_path: Path) -> None:
    """An open page forgets what it holds as soon as it sends anything; opened again it is no page."""
    small_study(tmp_path, "comfort", kind="video")
    with served(tmp_path) as server:
        someone = enter(f"{server.address()}p01")
        someone.agree()
        expect(someone.page.locator("header .saved")).to_have_text("Saved")
        study.withdraw(tmp_path, "p01")
        someone.press("Start")
        expect(someone.page.locator(".banner")).to_contain_text("This session is closed.")
        assert someone.page.get_by_role("button").all() == []
        assert someone.page.locator("main").inner_text() == ""
        someone.page.reload()  # without being asked whether what is unsaved may be lost
        assert "this session is closed" in someone.page.locator("body").inner_text()
    someone.complaints.clear()  # a refusal is one, for a browser
    assert not (tmp_path / "answers" / "p01.json").exists()


@pytest.mark.proof
def test_eleven_numbers_stand_in_one_row_on_a_phone(enter: Enter, tmp_path: Path) -> None:
    small_study(tmp_path, "comfort", kind="video")
    with served(tmp_path) as server:
        someone = enter(f"{server.address()}p01", size=(390, 844))
        someone.agree()
        someone.press("Start")
        someone.let_pass(60)
        someone.press("The video has ended")
        boxes = [one.bounding_box() for one in someone.page.locator(".numbered .choices label").all()]
        assert len(boxes) == 11
        assert len({box["y"] for box in boxes if box}) == 1
        assert all(box and box["height"] >= 44 and box["width"] >= 24 for box in boxes)  # WCAG 2.2, 2.5.8
        assert someone.overflow() <= 0


def check_phone(someone: Participant) -> None:
    """No part is wider than the screen, the stop button is in view, and a heading is where reading goes on."""
    assert someone.overflow() <= 0
    wide = someone.page.locator("main *, header *").evaluate_all(
        "all => all.filter((e) => e.getBoundingClientRect().right > innerWidth + 1).map((e) => e.outerHTML)"
    )
    assert wide == []
    box = someone.page.locator("#stop").bounding_box()
    assert box is not None
    assert 0 <= box["x"] <= box["x"] + box["width"] <= 390
    assert 0 <= box["y"] <= 60
    assert too_small(someone.page) == []


def answer_by_keys(someone: Participant) -> None:
    """From the heading on: Tab to each question, Space chooses, Enter on the button goes on."""
    keys = someone.page.keyboard
    assert someone.page.evaluate("document.activeElement.tagName") == "H1"
    first = someone.page.get_by_role("group").first
    someone.page.locator("#continue").press("Enter")
    expect(first).to_contain_text("(not answered yet)")
    assert first.evaluate("group => group.contains(document.activeElement)")
    expect(someone.page.locator("#without")).to_be_visible()
    keys.press("Space")
    expect(first).not_to_contain_text("(not answered yet)")
    expect(someone.page.locator(".said")).to_be_empty()  # how many lacked is no longer true
    expect(someone.page.locator("#without")).to_be_hidden()
    someone.page.locator("h1").first.focus()
    for _ in range(someone.page.locator("fieldset").count()):
        keys.press("Tab")
        keys.press("Space")
    assert someone.page.locator("fieldset:has(:checked)").count() == someone.page.locator("fieldset").count()
    keys.press("Tab")
    assert someone.page.evaluate("document.activeElement.id") == "continue"
    keys.press("Enter")
