// A stimulus: one ride, seen once, under a letter. It has no controls but its start and no way to seek or to go faster;
// it ends by itself, and tells the page in which it stands when it began, how it ended, how smoothly it was drawn, and
// what the tasks meanwhile have measured. A video is played round the viewer; it can be paused, which is told as well.
import { button, element } from "../shared/dom";
import { Film, type WatchedValue } from "./film";
import { type FrameReport, Frames } from "./frames";
import { GazeButtons } from "./gaze";
import { Headset } from "./headset";
import { Looking } from "./looking";
import type { Stimulus } from "./model";
import { Sign } from "./sign";
import { FADE, Stage } from "./stage";
import { taskPlan, Tasks, type TaskValue } from "./tasks";
import { Track } from "./track";

/** rad that a key turns the head; held down it repeats */
const KEY = 0.05;
/** Turns to the left and up, by the name of the key. */
const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};

/** Messages to the page that embeds a stimulus. */
export type Told =
  | { readonly kind: "ready"; readonly headset: boolean }
  | { readonly kind: "begin"; readonly headset: boolean }
  | { readonly kind: "end"; readonly frames: FrameReport; readonly headset: boolean }
  | { readonly kind: "paused" | "continued" | "skipped" }
  | { readonly kind: "watched"; readonly value: WatchedValue; readonly isEnough: boolean }
  | { readonly kind: "task"; readonly item: string; readonly value: TaskValue; readonly ms: number }
  | { readonly kind: "broken"; readonly frames: FrameReport; readonly headset: boolean; readonly reason: string }
  | { readonly kind: "failed"; readonly reason: string };

/** Sends a message to the embedding page, if there is one. */
export function tell(told: Told): void {
  if (window.parent !== window) window.parent.postMessage({ hpop: "stimulus", ...told }, "*");
}

/** Tells an event of a task; its time by the page's clock, ms, becomes that of UTC. */
function tellTask(item: string, value: TaskValue, at: number): void {
  tell({ kind: "task", item, value, ms: performance.timeOrigin + at });
}

export class StimulusPage {
  private readonly track: Track;
  private readonly stage: Stage;
  private readonly looking: Looking;
  private readonly headset: Headset;
  private readonly gaze: GazeButtons;
  private readonly card = element("div");
  private readonly sign: Sign;
  private readonly plan = taskPlan();
  private readonly tasks: Tasks | null;
  private readonly film: Film | null;
  private readonly controls = element("div", "controls");
  private frames = new Frames(0);
  /** Announcements that are still to come, and until when, s, the present one is shown. */
  private cues: (readonly [number, number, "left" | "right"])[];
  private cued = 0;
  /** ms, when the video stopped, because it was paused or its data were late */
  private halted: number | null = null;
  /** ms, when the ride began; null before and after it */
  private began: number | null = null;
  /** Whether it was in the headset when it began. */
  private worn = false;
  private last = 0;

  constructor(private readonly given: Stimulus) {
    this.track = new Track(given.track);
    const root = element("div", "stimulus");
    const view = element("main");
    view.id = "view";
    const canvas = element("canvas");
    canvas.setAttribute("aria-label", given.name);
    this.card.id = "card";
    this.controls.hidden = true;
    view.append(canvas, this.controls);
    root.append(view);
    document.body.append(root);
    this.stage = new Stage(canvas, given);
    const { shown } = given;
    this.cues = [...(shown?.cues ?? [])];
    this.sign = new Sign(this.stage.head, () => { this.stage.stale = true; });
    this.tasks = this.plan === null ? null : new Tasks(this.plan, tellTask, this.stage.head, (text) => { if (this.worn || text === "") this.sign.show(text); });
    if (this.tasks !== null) view.append(this.tasks.root);
    view.append(this.card);
    this.film = typeof shown?.video === "string" ? this.makeFilm(shown.video) : null;
    this.looking = new Looking(this.stage.head, canvas, () => { this.stage.stale = true; });
    this.gaze = new GazeButtons([{ label: () => given.words["stop"] ?? "", press: () => { this.headset.leave(); } }]);
    this.headset = new Headset(this.stage, this.gaze, (on) => { this.wornOrNot(on); }, () => { this.tasks?.press(performance.now()); });
    window.addEventListener("resize", () => { this.fit(); });
    new ResizeObserver(() => { this.fit(); }).observe(canvas);
    window.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.breakOff("Esc");
      this.lookTo(event);
    });
    document.addEventListener("visibilitychange", () => {
      if (document.hidden && !this.headset.isOn) this.breakOff("the page was hidden");
    });
    this.fit();
    this.blacken();
    this.invite();
    this.stage.renderer.setAnimationLoop((now) => { this.step(now); });
  }

  /** s, from the beginning to the end */
  private get duration(): number {
    return this.track.duration + (this.given.shown?.latency ?? 0);
  }

  private makeFilm(address: string): Film {
    const film = new Film(address, this.plan?.seconds ?? this.track.duration, (what) => { tell({ kind: what }); });
    const { player } = film;
    const words = this.plan?.words ?? {};
    const pause = button(words["video_pause"] ?? "", "", () => {
      if (player.paused) void player.play();
      else player.pause();
    });
    pause.id = "pause";
    this.controls.append(pause);
    this.stage.scenery.root.visible = false;
    this.stage.rig.add(film.sphere);
    const halt = (): void => {
      pause.textContent = words[player.paused ? "video_go_on" : "video_pause"] ?? "";
      if (this.began === null || this.halted !== null || player.ended) return;
      this.halted = performance.now();
      this.tasks?.pause(true);
    };
    player.addEventListener("pause", halt);
    player.addEventListener("waiting", halt);
    player.addEventListener("playing", () => {
      pause.textContent = words["video_pause"] ?? "";
      if (this.began === null || this.halted === null) return;
      const lasted = performance.now() - this.halted;
      this.began += lasted;
      this.halted = null;
      this.tasks?.pause(false, lasted);
    });
    player.addEventListener("ended", () => { this.filmEnded(film); });
    player.addEventListener("error", () => { tell({ kind: "failed", reason: words["video_failed"] ?? "" }); });
    return film;
  }

  /** A video counts as seen if enough of it was played; it is told before the end of the ride. */
  private filmEnded({ watched }: Film): void {
    if (this.began === null) return;
    const isEnough = watched.share >= (this.plan?.watched ?? 1);
    tell({ kind: "watched", value: watched, isEnough });
    if (isEnough) {
      this.stage.fade("black");
      this.end();
    } else this.breakOff("unwatched");
  }

  private invite(): void {
    const { words, name, still } = this.given;
    const seconds = String(Math.round(this.duration));
    const about = (words[still ? "view_about" : "ride_about"] ?? "").replace("{seconds}", seconds);
    const start = button(words["ride_begin"] ?? "", "", () => { this.begin(); });
    start.id = "start";
    const worn = button(words["ride_headset"] ?? "", "", () => {
      void this.headset.enter().then(() => { this.begin(); }, () => undefined);
    });
    worn.hidden = true;
    const row = element("p");
    row.append(start, " ", worn);
    this.card.replaceChildren(element("h1", "", name), element("p", "", about), ...(this.tasks?.about() ?? []), row);
    void this.headset.isThere().then((is) => {
      worn.hidden = !is;
      tell({ kind: "ready", headset: is });
    });
  }

  private begin(): void {
    this.card.hidden = true;
    this.worn = this.headset.isOn;
    this.began = performance.now();
    this.halted = null;
    this.frames = new Frames(this.began);
    this.stage.canvas.style.visibility = "visible";
    this.stage.place(this.track, 0);
    this.stage.fade("view", "black");
    tell({ kind: "begin", headset: this.worn });
    this.tasks?.begin(this.began);
    if (this.film !== null) {
      this.controls.hidden = false;
      const late = 1000 * (this.given.shown?.latency ?? 0);
      window.setTimeout(() => { void this.film?.player.play(); }, late);
    }
  }

  private step(now: number): void {
    const seconds = Math.max(now - this.last, 0) / 1000;
    this.last = now;
    if (this.began !== null) {
      const t = ((this.halted ?? now) - this.began) / 1000;
      const isOver = t >= this.duration && this.film === null;
      if (!isOver || !this.stage.isDark) this.frames.shown(now);
      const late = t - (this.given.shown?.latency ?? 0);
      const seen = Math.min(Math.max(this.film?.player.currentTime ?? late, 0), this.track.duration);
      if (this.film !== null) this.stage.stale = true;
      else if (!this.given.still) this.stage.place(this.track, seen);
      this.show(t, seen, now);
      if (!isOver) this.tasks?.step(now);
      if (isOver && !this.stage.isDark) this.stage.fade("black");
      if (isOver && t >= this.duration + FADE) this.end();
    }
    if (this.headset.isOn) this.gaze.look(this.stage.head, seconds);
    this.stage.draw(seconds);
    document.documentElement.dataset["ready"] = "yes";
  }

  /** Announces turns, and restricts the view while it turns. */
  private show(t: number, seen: number, now: number): void {
    const { shown } = this.given;
    if (typeof shown?.restrictor === "number") {
      this.stage.restrict((shown.restrictor / 180) * Math.PI, this.track.turning(seen));
    }
    const [next] = this.cues;
    if (next !== undefined && t >= next[0]) {
      this.cues.shift();
      this.cued = next[1] + (shown?.latency ?? 0);
      const said = this.plan?.words[`task_${next[2]}`] ?? "";
      this.sign.show(next[2] === "left" ? `\u2b05 ${said}` : `${said} \u27a1`);
      tellTask("cue", { due: next[0], came: Math.round(1000 * t) / 1000, value: next[2] === "left" ? 1 : -1 }, now);
    } else if (this.cued > 0 && t >= this.cued) {
      this.cued = 0;
      this.sign.show("");
    }
  }

  /** Ends the tasks and the video. */
  private leave(): void {
    const { film } = this;
    this.tasks?.end(performance.now());
    this.sign.show("");
    this.controls.hidden = true;
    if (film === null) return;
    if (!film.player.ended) tell({ kind: "watched", value: film.watched, isEnough: false });
    this.began = null;
    film.player.pause();
  }

  private end(): void {
    this.leave();
    this.began = null;
    this.blacken();
    this.headset.leave();
    this.over();
    tell({ kind: "end", frames: this.frames.report, headset: this.worn });
  }

  /** Arrow keys look around as dragging does: the head turns to where they point. */
  private lookTo(event: KeyboardEvent): void {
    const to = ARROWS[event.key];
    if (to === undefined || this.began === null || event.target instanceof HTMLInputElement) return;
    event.preventDefault();
    this.looking.turn(KEY * to[0], KEY * to[1]);
  }

  /** Ends the ride early; it can only be seen again from the beginning. */
  private breakOff(reason: string): void {
    if (this.began === null) {
      if (reason === "Esc") tell({ kind: "broken", frames: this.frames.report, headset: this.worn, reason });
      return;
    }
    this.leave();
    this.began = null;
    this.blacken();
    this.headset.leave();
    this.over();
    tell({ kind: "broken", frames: this.frames.report, headset: this.worn, reason });
  }

  private over(): void {
    this.card.replaceChildren(element("h1", "", this.given.name), element("p", "", this.given.words["ride_over"] ?? ""));
    this.card.hidden = false;
  }

  private blacken(): void {
    this.stage.canvas.style.visibility = "hidden";
  }

  private wornOrNot(on: boolean): void {
    if (on) return;
    this.looking.apply();
    this.fit();
    this.breakOff("the headset was left");
  }

  private fit(): void {
    this.stage.resize();
  }
}
