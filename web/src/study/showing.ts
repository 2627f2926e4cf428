// Screens that show: a ride in a frame of its own, a video that is seen elsewhere, a rest, the end.
import type { Told } from "../ride/stimulus";
import { type Context, title } from "./asking";
import { button, element } from "./dom";
import type { Place } from "./model";
import { InPage } from "./recorder";

/** Content of the page during a step. */
export interface Screen {
  readonly root: HTMLElement;
  /** Whether the screen takes all of the page below the bar. */
  readonly isWide?: boolean;
  /** Ends running parts of the screen, when the step ends or is stopped. */
  readonly leave?: () => void;
}

/** A page of a ride, and the script that draws it, which all rides share. */
export interface RidePage {
  readonly text: string;
  readonly bundle: string;
}

const BUNDLE = '<script type="text/plain" id="bundle">';

/** What a ride's page must know of its session: tasks with their times, texts, and how much of a video must be played. */
function tasksElement({ voice, design }: Context, { tasks, seconds }: Place): string {
  const known = { ...tasks, words: voice.words, watched: design.protocol.watched, seconds };
  const text = JSON.stringify(known).replaceAll("<", "\\u003c");
  return `<script type="application/json" id="tasks">${text}</script>`;
}

async function inflated(text: string): Promise<string> {
  const deflated = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).text();
}

/** A ride; the messages of its page are recorded. */
export function ride(context: Context, at: Place, page: RidePage, done: () => void): Screen {
  const { voice, recorder } = context;
  const { place, condition } = at;
  const screen = element("section", "ride");
  const frame = element("iframe");
  frame.title = voice.say(at.kind === "video" ? "video_title" : "ride_title", { name: condition });
  frame.allow = "xr-spatial-tracking *; accelerometer *; gyroscope *";
  const over = element("div", "over");
  over.hidden = true;
  let isRunning = false;
  let isLeft = false;
  /** What was watched of a video, if it was not enough. */
  let lacking: number | null = null;

  const record = (value: string): void => { recorder.add({ kind: "stimulus", place, condition, value }); };
  const again = (said: string, label: string, press: () => void): void => {
    const go = button(label, "", press);
    go.className = "main";
    over.replaceChildren(element("p", "", said), go);
    over.hidden = false;
    go.focus();
  };
  const show = async (): Promise<void> => {
    over.hidden = true;
    const text = (await inflated(page.text)).replace(BUNDLE, (found) => tasksElement(context, at) + found + page.bundle);
    if (!isLeft) frame.srcdoc = text;
  };
  const hear = (event: MessageEvent): void => {
    const told = event.data as (Told & { hpop?: string }) | null;
    if (event.source !== frame.contentWindow || told?.hpop !== "stimulus") return;
    if (told.kind === "task") {
      recorder.add({ kind: "task", place, condition, item: told.item, value: told.value }, told.ms);
    } else if (told.kind === "watched") {
      recorder.add({ kind: "task", place, condition, item: "watched", value: told.value });
      lacking = told.isEnough ? null : told.value.share;
      if (told.isEnough) record("played");
    } else if (told.kind === "paused" || told.kind === "continued" || told.kind === "skipped") {
      if (isRunning) record(told.kind);
    } else if (told.kind === "begin") {
      isRunning = true;
      lacking = null;
      recorder.device.headset = told.headset;
      record("begin");
    } else if (told.kind === "failed") {
      record("failed");
      over.replaceChildren(element("p", "", voice.say("ride_failed", { reason: told.reason })));
      over.hidden = false;
    } else if (told.kind === "end" || told.kind === "broken") {
      if (!isRunning) return;
      isRunning = false;
      const { frames } = told;
      const rate = frames.seconds > 0 ? Math.round(frames.count / frames.seconds) : 0;
      recorder.device.refresh_hz = Math.max(recorder.device.refresh_hz ?? 0, rate);
      const { flagged, ...value } = frames;
      recorder.add({ kind: "frames", place, condition, value });
      record(told.kind);
      if (told.kind === "broken" && told.reason === "unwatched" && lacking !== null) {
        const share = { share: Math.floor(100 * lacking), least: Math.round(100 * context.design.protocol.watched) };
        const said = `${voice.say("video_share", share)} ${voice.say("video_skipped")}`;
        again(said, voice.say("ride_again"), () => { void show(); });
      } else if (told.kind === "broken") again(voice.say("ride_broken"), voice.say("ride_again"), () => { void show(); });
      else if (flagged) again(voice.say("ride_frames"), voice.say("continue"), done);
      else done();
    }
  };
  window.addEventListener("message", hear);
  frame.addEventListener("load", () => { frame.focus(); });
  screen.append(frame, over);
  void show();
  return {
    root: screen,
    isWide: true,
    leave() {
      isLeft = true;
      window.removeEventListener("message", hear);
      frame.remove();
      if (isRunning) record("broken");
      isRunning = false;
    },
  };
}

/**
 * A video. `here` plays it on the page, where it counts as watched once enough of it was played; it is null if the page
 * cannot. If a video is seen in another player, its viewer says when it begins and ends, not before it can have ended.
 */
export function video({ voice, recorder }: Context, at: Place, here: (() => void) | null, done: () => void): Screen {
  const { place, condition } = at;
  const screen = element("section");
  const record = (value: string): void => { recorder.add({ kind: "stimulus", place, condition, value }); };
  const gaps = { name: condition, seconds: Math.round(at.seconds) };
  let isRunning = false;
  let timer = 0;
  const elsewhere = element("div", "elsewhere");
  const row = element("div", "row");
  const begin = button(voice.say("ride_begin"), "", () => {
    isRunning = true;
    record("begin");
    play.hidden = true;
    const ended = button(voice.say("video_ended"), "", () => {
      isRunning = false;
      record("end");
      done();
    });
    ended.className = "main";
    ended.disabled = true;
    timer = window.setTimeout(() => {
      ended.disabled = false;
      ended.focus();
    }, 1000 * at.seconds);
    row.replaceChildren(ended);
  });
  row.append(begin);
  elsewhere.append(element("p", "", voice.say("video_elsewhere")), row);
  const play = element("div", "row");
  screen.append(title(voice.say("video_title", gaps)), element("p", "", voice.say("video_about", gaps)), play, elsewhere);
  if (here === null) begin.className = "main";
  else {
    const go = button(voice.say("video_play"), "", here);
    go.className = "main";
    play.append(go);
  }
  return {
    root: screen,
    leave() {
      clearTimeout(timer);
      if (isRunning) record("broken");
      isRunning = false;
    },
  };
}

/** A real robot, or a session in which the participant drives, on a page or in a headset that the researcher shows. */
export function live({ voice, recorder }: Context, { place, condition, kind }: Place, done: () => void): Screen {
  const screen = element("section");
  const row = element("div", "row");
  let isRunning = false;
  const record = (value: string): void => { recorder.add({ kind: "stimulus", place, condition, value }); };
  const begin = button(voice.say("ride_begin"), "", () => {
    isRunning = true;
    record("begin");
    const ended = button(voice.say(`${kind}_ended`), "", () => {
      isRunning = false;
      record("end");
      done();
    });
    ended.className = "main";
    row.replaceChildren(ended);
    ended.focus();
  });
  begin.className = "main";
  row.append(begin);
  screen.append(title(voice.say(`${kind}_title`, { name: condition })), element("p", "", voice.say(`${kind}_about`)), row);
  return {
    root: screen,
    leave() {
      if (isRunning) record("broken");
      isRunning = false;
    },
  };
}

/** A rest of at least so many seconds; a reload does not begin it anew. */
export function rest({ voice, recorder }: Context, { place, condition }: Place, least: number, done: () => void): Screen {
  const screen = element("section");
  const isThis = (value: string) => recorder.events.find((e) => e.kind === "pause" && e.place === place && e.value === value);
  if (isThis("begin") === undefined) recorder.add({ kind: "pause", place, condition, value: "begin" });
  const until = Date.parse(isThis("begin")!.at) + 1000 * least;
  const left = element("p", "left");
  const ready = element("p", "left");
  ready.setAttribute("role", "status");
  const go = button(voice.say("continue"), "", () => {
    recorder.add({ kind: "pause", place, condition, value: "end" });
    done();
  });
  go.className = "main";
  go.id = "continue";
  go.disabled = true;
  const row = element("div", "row");
  row.append(go);
  screen.append(title(voice.say("rest_title")), element("p", "", voice.say("rest_about")), left, ready, row);
  const tick = (): void => {
    const seconds = Math.ceil((until - Date.now()) / 1000);
    if (seconds > 0) {
      const time = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
      left.textContent = voice.say("rest_left", { time });
      return;
    }
    clearInterval(timer);
    left.textContent = "";
    ready.textContent = voice.say("rest_over");
    go.disabled = false;
  };
  const timer = window.setInterval(tick, 500);
  tick();
  return { root: screen, leave: () => { clearInterval(timer); } };
}

/** The end: says that the answers are saved, or how to save them. */
export function end({ voice, recorder }: Context, isStopped: boolean): Screen {
  const screen = element("section");
  const said = element("p", "ask");
  const row = element("div", "row");
  const save = button(voice.say("save_file"), "", () => { recorder.save(); });
  save.className = "main";
  save.id = "save";
  row.append(save);
  const show = (): void => {
    const gaps = { file: recorder.file };
    if (recorder instanceof InPage) {
      said.textContent = voice.say(recorder.isHandedOver ? "end_saved_file" : "end_file", gaps);
      save.textContent = voice.say(recorder.isHandedOver ? "save_again" : "save_file");
    } else {
      said.textContent = recorder.standing.kind === "saved" ? voice.say("end_saved") : "";
      row.hidden = recorder.standing.kind === "saved";
    }
  };
  show();
  const before = recorder.changed;
  recorder.changed = () => { before(); show(); };
  const heading = voice.say(isStopped ? "stopped_title" : "end_title");
  screen.append(title(heading), element("p", "", voice.say("end_about")), said, row);
  return { root: screen, leave: () => { recorder.changed = before; } };
}

/** Screen for a person who does not take part. */
export function declined({ voice }: Context): Screen {
  const screen = element("section");
  screen.append(title(voice.say("end_title")), element("p", "", voice.say("declined")));
  return { root: screen };
}
