// A stimulus: one ride, seen once, under a letter. It has no controls but its start and no way to seek or to go faster;
// it ends by itself, and tells the page in which it stands when it began, how it ended, and how smoothly it was drawn.
import { button, element } from "../shared/dom";
import { type FrameReport, Frames } from "./frames";
import { GazeButtons } from "./gaze";
import { Headset } from "./headset";
import { Looking } from "./looking";
import type { Stimulus } from "./model";
import { FADE, Stage } from "./stage";
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
  | { readonly kind: "broken"; readonly frames: FrameReport; readonly headset: boolean; readonly reason: string }
  | { readonly kind: "failed"; readonly reason: string };

/** Sends a message to the embedding page, if there is one. */
export function tell(told: Told): void {
  if (window.parent !== window) window.parent.postMessage({ hpop: "stimulus", ...told }, "*");
}

export class StimulusPage {
  private readonly track: Track;
  private readonly stage: Stage;
  private readonly looking: Looking;
  private readonly headset: Headset;
  private readonly gaze: GazeButtons;
  private readonly card = element("div");
  private frames = new Frames(0);
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
    view.append(canvas, this.card);
    root.append(view);
    document.body.append(root);
    this.stage = new Stage(canvas, given);
    this.looking = new Looking(this.stage.head, canvas, () => { this.stage.stale = true; });
    this.gaze = new GazeButtons([{ label: () => given.words["stop"] ?? "", press: () => { this.headset.leave(); } }]);
    this.headset = new Headset(this.stage, this.gaze, (on) => { this.wornOrNot(on); }, () => undefined);
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

  private invite(): void {
    const { words, name, still } = this.given;
    const seconds = String(Math.round(this.track.duration));
    const about = (words[still ? "view_about" : "ride_about"] ?? "").replace("{seconds}", seconds);
    const start = button(words["ride_begin"] ?? "", "", () => { this.begin(); });
    start.id = "start";
    const worn = button(words["ride_headset"] ?? "", "", () => {
      void this.headset.enter().then(() => { this.begin(); }, () => undefined);
    });
    worn.hidden = true;
    const row = element("p");
    row.append(start, " ", worn);
    this.card.replaceChildren(element("h1", "", name), element("p", "", about), row);
    void this.headset.isThere().then((is) => {
      worn.hidden = !is;
      tell({ kind: "ready", headset: is });
    });
  }

  private begin(): void {
    this.card.hidden = true;
    this.worn = this.headset.isOn;
    this.began = performance.now();
    this.frames = new Frames(this.began);
    this.stage.canvas.style.visibility = "visible";
    this.stage.place(this.track, 0);
    this.stage.fade("view", "black");
    tell({ kind: "begin", headset: this.worn });
  }

  private step(now: number): void {
    const seconds = Math.max(now - this.last, 0) / 1000;
    this.last = now;
    if (this.began !== null) {
      const t = (now - this.began) / 1000;
      const isOver = t >= this.track.duration;
      if (!isOver || !this.stage.isDark) this.frames.shown(now);
      if (!this.given.still) this.stage.place(this.track, Math.min(Math.max(t, 0), this.track.duration));
      if (isOver && !this.stage.isDark) this.stage.fade("black");
      if (t >= this.track.duration + FADE) this.end();
    }
    if (this.headset.isOn) this.gaze.look(this.stage.head, seconds);
    this.stage.draw(seconds);
    document.documentElement.dataset["ready"] = "yes";
  }

  private end(): void {
    this.began = null;
    this.blacken();
    this.headset.leave();
    this.over();
    tell({ kind: "end", frames: this.frames.report, headset: this.worn });
  }

  /** Arrow keys look around as dragging does: the head turns to where they point. */
  private lookTo(event: KeyboardEvent): void {
    const to = ARROWS[event.key];
    if (to === undefined || this.began === null) return;
    event.preventDefault();
    this.looking.turn(KEY * to[0], KEY * to[1]);
  }

  /** Ends the ride early; it can only be seen again from the beginning. */
  private breakOff(reason: string): void {
    if (this.began === null) {
      if (reason === "Esc") tell({ kind: "broken", frames: this.frames.report, headset: this.worn, reason });
      return;
    }
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
