"""Tasks during a ride or a video, in a real browser with a real clock."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from playwright.sync_api import Browser, FrameLocator, Page, expect

import hpop
from hpop import study
from hpop.study import tasks
from hpop.study.documents import words
from hpop.study.page import ride_page
from hpop.view.single_page import NOSCRIPT
from tests.browser.rides import front_of, problem_of
from tests.browser.sessions import served

pytestmark = pytest.mark.proof  # in real time
TASKS = {
    "rating": {"every": 4, "shown": 3},
    "slider": {"rate": 10},
    "head": {},
    "counting": {"least": 0.6, "most": 1.4},
    "reaction": {"least": 2, "most": 3, "wait": 1.5},
}
# An instrument beside the page: samples that reach the loudspeaker, on the sound card's clock, as times of the page.
LISTEN = """
(() => {
  const worklet = `registerProcessor("listener", class extends AudioWorkletProcessor {
    quiet = 1e9;
    process([[channel]]) {
      for (let i = 0; i < 128; i += 1) {
        if (channel !== undefined && Math.abs(channel[i]) > 1e-3) {
          if (this.quiet > 0.05 * sampleRate) this.port.postMessage((currentFrame + i) / sampleRate);
          this.quiet = 0;
        } else this.quiet += 1;
      }
      return true;
    }
  })`;
  const connect = AudioNode.prototype.connect;
  const listeners = new Map();
  const listener = async (context) => {
    await context.audioWorklet.addModule(URL.createObjectURL(new Blob([worklet], { type: "text/javascript" })));
    const node = new AudioWorkletNode(context, "listener");
    node.port.onmessage = ({ data }) => {
      const { contextTime, performanceTime } = context.getOutputTimestamp();
      (top.onsets ??= []).push(performance.timeOrigin + performanceTime + 1000 * (data - contextTime));
    };
    connect.call(node, context.destination);
    setInterval(() => {
      const { contextTime, performanceTime } = context.getOutputTimestamp();
      const clock = [performance.timeOrigin + performanceTime, performanceTime - 1000 * contextTime];
      if (contextTime > 0) (top.clocks ??= []).push(clock);
    }, 20);
    return node;
  };
  const Original = AudioContext;
  window.AudioContext = class extends Original {
    constructor(...how) { super(...how); listeners.set(this, listener(this)); }
  };
  AudioNode.prototype.connect = function (to, ...more) {
    if (to instanceof AudioDestinationNode) {
      void listeners.get(this.context).then((node) => connect.call(this, node));
    }
    return connect.call(this, to, ...more);
  };
})();
"""


@pytest.fixture
def page(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Page]:
    """Return a small page with a real clock; its policy is off where the instrument listens."""
    is_heard = "sounds" in request.node.name
    context = browser.new_context(viewport={"width": 480, "height": 400}, bypass_csp=is_heard)
    made = context.new_page()
    said: list[str] = []
    made.on("pageerror", lambda error: said.append(str(error)))
    made.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    yield made
    context.close()
    assert said == []


def tasked(folder: Path, **how: Any) -> study.Design:
    """Return a design of one way with tasks, in two conditions, with its stimuli."""
    problem = problem_of(hpop.World.from_polygons([shapely.box(4, 6, 5, 7)], extent=shapely.box(0, 0, 10, 8)))
    front = front_of(problem, {"round": [(1, 1), (1, 3), (4, 3)]})
    protocol = study.Protocol(rest_s=0, tasks=TASKS)
    design = study.Design.of(front, [0], participants=2, consent="x", forms=("comfort",), protocol=protocol, **how)
    design.save(folder)
    study.save_stimuli(problem, front, design.conditions, folder / "stimuli")
    return design


def entered(page: Page, address: str) -> FrameLocator:
    """Agree, and return the frame of the ride, which waits to be started."""
    page.goto(address)
    page.locator("#agree").check()
    page.get_by_role("button", name="Begin the session", exact=True).click()
    if page.get_by_role("button", name="Play the video here").count():
        page.get_by_role("button", name="Play the video here").click()
    frame = page.frame_locator("iframe")
    frame.locator("#start").wait_for()
    return frame


def events(folder: Path, item: str) -> list[dict[str, Any]]:
    """Return the recorded events of a task."""
    stored = json.loads((folder / "answers" / "p01.json").read_text())
    return [event for event in stored["events"] if event.get("item") == item]


def test_sounds_keep_their_schedule_to_5_ms_and_samples_theirs(page: Page, tmp_path: Path) -> None:
    """Compare sounds at the loudspeaker, on the page's clock, with the schedule of the design; and what is recorded."""
    design = tasked(tmp_path, factors={"cue": [2, 1]})
    page.add_init_script(LISTEN)
    with served(tmp_path) as server:
        frame = entered(page, f"{server.address()}p01")
        frame.locator("#start").click()
        page.keyboard.press("ArrowLeft")
        frame.get_by_role("button", name="7", exact=True).click()  # the first question
        page.keyboard.press("1")
        expect(page.get_by_text("How many low tones did you hear?").or_(page.locator(".over button"))).to_be_visible()
        if page.locator(".over button").is_visible():
            page.locator(".over button").click()
        page.locator("input").fill("5")
        page.locator("#continue").click()
        expect(page.locator("header .saved")).to_have_text("Saved")
    onsets = np.array(page.evaluate("top.onsets"))
    planned = design.scheduled("p01", 1)["tasks"]
    tones = events(tmp_path, "tone")
    signals = events(tmp_path, "signal")
    ratings = events(tmp_path, "rating")
    for told, name in ((tones, "counting"), (signals, "reaction"), (ratings, "rating")):
        assert [event["value"]["due"] for event in told] == planned[name]["times"]
    utc = np.array([np.datetime64(event["at"][:-1], "ms").astype(float) for event in tones])
    began = np.median(utc - [1000 * event["value"]["came"] for event in tones])
    due = sorted(began + 1000 * t for name in ("counting", "reaction", "rating") for t in planned[name]["times"])
    apart = np.array([t for i, t in enumerate(due) if i == 0 or t - due[i - 1] > 400])  # sounds that do not overlap
    at, offset = np.array(page.evaluate("top.clocks")).T
    is_steady = [
        np.ptp(offset[(at > t - 1100) & (at < t + 200)]) < 3.0 for t in apart
    ]  # a busy machine halts its sound
    errors = np.array([onsets[np.argmin(np.abs(onsets - t))] - t for t in apart[is_steady]])
    print(
        f"{errors.size} of {apart.size} sounds: largest error {np.abs(errors).max():.2f} ms, all {np.round(errors, 1)}"
    )
    assert errors.size >= 4
    assert np.abs(errors).max() <= 5.0
    recorded = [1000 * (e["value"]["came"] - e["value"]["due"]) for e in (*tones, *signals, *ratings)]
    assert np.median(np.abs(recorded)) <= 1.0
    for item, rate in (("head", 30.0), ("slider", 10.0)):
        samples = tasks.samples_of([event["value"] for event in events(tmp_path, item)])
        count = math.floor(design.conditions[0].duration * rate)
        assert count - rate / 2 <= len(samples) <= count + 1  # all but those of the last picture
        assert np.abs(samples[:, 0] - 1000 * np.arange(len(samples)) / rate).max() <= 0.5
    head = tasks.samples_of([event["value"] for event in events(tmp_path, "head")])
    assert head[0, 1] == 0.0
    assert head[-1, 1] == pytest.approx(np.degrees(0.05), abs=0.01)  # a key turns the head to the left
    assert ratings[0]["value"]["value"] == 7
    (counted,) = events(tmp_path, "count")
    assert counted["value"] == {"value": 5}


def filmed(path: Path, seconds: float) -> None:
    """Write a video that is red in its left half and blue in its right one, and lighter in the middle."""
    av = pytest.importorskip("av")
    picture = np.zeros((128, 256, 3), np.uint8)
    picture[:, :128, 0] = picture[:, 128:, 2] = 200
    picture[:, 96:160] = 128
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 256, 128, "yuv420p"
        for _ in range(round(10 * seconds)):
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        file.mux(stream.encode(None))


def film_study(
    folder: Path, seconds: float, *, given: Any = (), forms: tuple[str, ...] = ("comfort",), language: str = "en"
) -> study.Design:
    """Return a design of two videos, of which each lasts some seconds, with tasks."""
    problem = problem_of(hpop.World.from_polygons([], extent=shapely.box(0, 0, 10, 8)))
    front = front_of(problem, {"straight": [(1, 1), (6, 1)]})
    how: Any = {"factors": {"latency": [0, 0.2]}, "protocol": study.Protocol(rest_s=0, tasks=given)}
    design = study.Design.of(
        front, [0], participants=2, consent="x", forms=forms, kind="video", language=language, **how
    )
    design.save(folder)
    (folder / "stimuli").mkdir()
    spoken: Any = {"said": words(language), "language": language}
    for condition in design.conditions:
        text = ride_page(
            problem, front.trajectories[condition.row or 0], condition.id, video=condition.stimulus, **spoken
        )
        (folder / condition.stimulus).with_suffix(".html").write_text(text)
        filmed(folder / condition.stimulus, seconds)
    return design


def colours(page: Page) -> list[list[int]]:
    """Return the colours in the middle, and at both sides, of what the page shows."""
    from io import BytesIO

    from PIL import Image

    seen = np.asarray(Image.open(BytesIO(page.screenshot())).convert("RGB"), dtype=int)
    height, width, _ = seen.shape
    return [seen[height // 2, x].tolist() for x in (width // 2, 4, width - 5)]


def test_a_video_is_shown_around_the_viewer_and_counts_once_its_share_was_played(page: Page, tmp_path: Path) -> None:
    """A participant who pauses and skips must watch again; no answer is accepted before."""
    design = film_study(tmp_path, 8.0, given={"counting": {"least": 0.6, "most": 0.9}})
    with served(tmp_path) as server:
        frame = entered(page, f"{server.address()}p01")
        frame.locator("#start").click()
        page.wait_for_timeout(900)
        middle, *_ = colours(page)
        assert max(middle) - min(middle) < 30
        frame.get_by_role("button", name="Pause").click()
        expect(frame.get_by_role("button", name="Go on")).to_be_visible()
        for _ in range(25):
            page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(300)
        (red, _, blue), *_ = colours(page)  # after 1.25 rad
        assert red > blue + 80  # the left part of the picture is to the left
        frame.get_by_role("button", name="Go on").click()
        page.evaluate(SKIP)
        expect(page.locator(".over")).to_contain_text("95 % is needed")
        page.get_by_role("button", name="See it again from the beginning").click()
        frame.locator("#start").click()
        asked = page.locator("h1", has_text="How many low tones did you hear?")
        jerky = page.locator(".over button", has_text="Continue")  # a slow machine
        expect(asked.or_(jerky)).to_be_visible()
        if jerky.is_visible():
            jerky.click()
        expect(asked).to_be_visible()
        expect(page.locator("header .saved")).to_have_text("Saved")
    tones = events(tmp_path, "tone")
    assert np.median([abs(event["value"]["came"] - event["value"]["due"]) for event in tones]) <= 0.005
    when = [(np.datetime64(e["at"][:-1], "ms").astype(float) / 1000.0, e["value"]["due"]) for e in tones]
    gaps = [(b[0] - a[0]) - (b[1] - a[1]) for a, b in pairwise(when) if b[1] > a[1]]
    assert max(gaps) > 0.3  # the pause delays the tones after it
    (first, *_) = design.participant("p01").order
    (session,) = study.Answers.load(tmp_path).sessions
    told = [event.value for event in session.events if event.kind == "stimulus"]
    assert told == ["begin", "paused", "continued", "skipped", "broken", "begin", "played", "end"]
    skipped, watched = (event.value for event in session.events if event.item == "watched")
    assert skipped["share"] < 0.9
    assert (skipped["pauses"], skipped["skips"]) == (1, 1)
    assert watched["share"] >= 0.95
    assert [(one.condition, one.played) for one in session.videos(design)] == [(first, True)]


# The player is not in the document: it is found where its picture is drawn.
SKIP = "document.querySelector('iframe').contentWindow.films.at(-1).currentTime += 3.0"
KEEP = """
(() => {
  const create = Document.prototype.createElement;
  Document.prototype.createElement = function (name, ...more) {
    const made = create.call(this, name, ...more);
    if (name === "video") (window.films ??= []).push(made);
    return made;
  };
})();
"""


@pytest.fixture(autouse=True)
def _keep_players(page: Page) -> None:
    page.add_init_script(KEEP)


def test_a_video_that_is_shorter_than_its_ride_never_counts_as_watched(page: Page, tmp_path: Path) -> None:
    """Played to its end, 0.6 s of a longer ride are not enough."""
    film_study(tmp_path, 0.6)
    with served(tmp_path) as server:
        frame = entered(page, f"{server.address()}p01")
        frame.locator("#start").click()
        expect(page.locator(".over")).to_contain_text("% of the video was shown; 95 % is needed")
        expect(page.locator("header .saved")).to_have_text("Saved")
    stored = json.loads((tmp_path / "answers" / "p01.json").read_text())
    assert [event["value"] for event in stored["events"] if event["kind"] == "stimulus"] == ["begin", "broken"]


TEXTS = """(document) => [...document.querySelectorAll("body *")].flatMap((e) => [
  ...(e.matches("script, style") ? [] : [...e.childNodes].filter((n) => n.nodeType === 3).map((n) => n.data)),
  ...["aria-label", "title", "alt", "placeholder", "aria-description"].map((name) => e.getAttribute(name) ?? ""),
])"""


def words_of(*texts: str) -> set[str]:
    """Return the words of some texts, in small letters."""
    return {word.lower() for text in texts for word in re.findall(r"[^\W\d_]+", re.sub(r"\{\w+\}", " ", text))}


def german(*forms: str) -> set[str]:
    """Return all words that a German session may show: those of its table of texts and of its forms, and letters."""
    known = words_of(*words("de").values(), NOSCRIPT["de"], "x p A B s")
    for form in map(study.Form.load, forms):
        scales = [scale for scale in (form.scale, *(item.scale for item in form.items)) if scale is not None]
        known |= words_of(form.title["de"], form.ask["de"], *(item.text["de"] for item in form.items))
        known |= words_of(*(label for scale in scales for label in scale.labels.get("de", ())))
        known |= words_of(*(scale.absent.text["de"] for scale in scales if scale.absent))
    return known


def check_german(page: Page, known: set[str], seen: set[str]) -> None:
    """Check the language of the page and of its frames, and that all of its words are German; collect them."""
    for frame in page.frames:
        assert frame.evaluate("document.documentElement.lang") == "de"
        said = words_of(*frame.evaluate(f"({TEXTS})(document)"))
        assert said - known == set()
        seen |= said


def answer_all(page: Page) -> None:
    """Choose the first answer of each question on the page, and go on."""
    for number in page.locator("fieldset input[type=number]").all():
        number.fill(number.get_attribute("min") or "0")
    for group in page.locator("fieldset:has(input[type=radio])").all():
        group.locator("label").first.click()
    page.locator("#continue").click()


def test_a_german_session_with_videos_is_german_from_consent_to_its_end(page: Page, tmp_path: Path) -> None:
    """Every text, label and title on the page and in the player is from the German table or a form in German."""
    forms = ("mssq", "ssq", "comfort", "preference")
    given = {**TASKS, "rating": {"every": 3, "shown": 2.5}}
    design = film_study(tmp_path, 8.0, given=given, forms=forms, language="de")
    known, seen = german(*forms), set[str]()
    kinds: list[str] = []
    with served(tmp_path) as server:
        page.goto(f"{server.address()}p01")
        page.locator("#agree").wait_for()
        check_german(page, known, seen)
        page.get_by_role("button", name="Sitzung beginnen", exact=True).click()  # before agreeing
        check_german(page, known, seen)
        page.locator("#agree").check()
        page.get_by_role("button", name="Sitzung beginnen", exact=True).click()
        page.get_by_role("button", name="Abbrechen", exact=True).click()
        check_german(page, known, seen)
        page.get_by_role("button", name="Weitermachen", exact=True).click()
        end = page.locator("h1", has_text="Vielen Dank")
        film, go_on = page.get_by_role("button", name="Das Video hier abspielen"), page.locator("#continue")
        jerky = page.locator(".over button", has_text="Weiter")
        while True:
            expect(end.or_(film).or_(go_on).or_(jerky).first).to_be_visible()
            check_german(page, known, seen)
            kinds.append(page.locator("h1").inner_text() if page.locator("h1").count() else "")
            if end.is_visible():
                break
            if film.is_visible():
                film.click()
                frame = page.frame_locator("iframe")
                frame.locator("#start").wait_for()
                check_german(page, known, seen)  # the tasks are explained
                frame.locator("#start").click()
                frame.get_by_role("button", name="7", exact=True).wait_for()  # the question during the video
                check_german(page, known, seen)
                frame.get_by_role("button", name="7", exact=True).click()
                frame.get_by_role("button", name="Anhalten").click()
                check_german(page, known, seen)
                frame.get_by_role("button", name="Fortsetzen").click()
            elif jerky.is_visible():
                jerky.click()
            elif page.locator("h1", has_text="Wie viele tiefe Töne").count():
                page.locator("input").fill("5")
                go_on.click()
            else:
                answer_all(page)
        expect(page.locator("main")).to_contain_text("Alle Ihre Antworten sind gespeichert.")
    (session,) = study.Answers.load(tmp_path).sessions
    assert session.ended
    assert session.lacking(design) == []
    assert [one.played for one in session.videos(design)] == [True, True]
    assert next(event.value for event in session.events if event.item == "rating")["value"] == 7
    for said in ("task_counting_about", "video_about", "rest_about", "compare_none", "remarks_about", "stop_about"):
        assert words_of(words("de")[said]) <= seen | words_of("{seconds}")  # these pages were seen
