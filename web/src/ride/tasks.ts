// Tasks during a stimulus: ratings, the direction of the head, counted tones, reactions. hpop/study/protocol.py draws
// their times. An event has the time at which it is due and the time at which it came, s from the beginning.
import { Quaternion, Vector3 } from "three";
import { button, element } from "../shared/dom";
import { type Playing, type Sound, Sounds } from "./sounds";

/** Tasks of one stimulus; the page of the session adds them to the page of the stimulus. */
export interface TaskPlan {
  readonly rating?: { readonly times: readonly number[]; readonly shown: number; readonly high: number };
  readonly slider?: { readonly rate: number; readonly high: number };
  readonly head?: { readonly rate: number };
  readonly counting?: { readonly times: readonly number[] };
  readonly reaction?: { readonly times: readonly number[]; readonly wait: number };
  readonly words: Readonly<Record<string, string>>;
  /** Share of a video that must be shown, and its seconds. */
  readonly watched: number;
  readonly seconds: number;
}

export type TaskValue = Readonly<Record<string, number | readonly (readonly number[])[]>>;

/** Tells an event: its item, its value, and its time by the page's clock, ms. */
export type Tell = (item: string, value: TaskValue, at: number) => void;

/** ms before its time at which a sound is handed over, longer than the slowest picture; AT_LAST while the clocks are unsure */
const AHEAD = 1000;
const AT_LAST = 250;
/** ms between looks at the clocks, besides those of each picture */
const TICK = 20;
/** ms by which a sound may be off before it is moved; less than SETTLED ms before its time, it is not moved any more */
const OFF = 1;
const SETTLED = 30;
/** s of samples in one event */
const BATCH = 5;
/** ms without a further digit after which a typed number counts */
const TYPED = 1500;
/** Rating by one notch of the mouse's wheel, share of the scale. */
const NOTCH = 0.05;

/** The tasks of a session's page, null without. */
export function taskPlan(): TaskPlan | null {
  const text = document.getElementById("tasks")?.textContent;
  return text === undefined ? null : (JSON.parse(text) as TaskPlan);
}

interface Due {
  readonly sound: Sound;
  /** s */
  readonly due: number;
  playing: Playing;
}

/** A signal or a question that waits for an answer; `came` is in ms of the page's clock. */
interface Open {
  readonly due: number;
  readonly came: number;
}

/** Samples at even times, of values between frames. */
class Sampler {
  private samples: number[][] = [];
  private next = 0;
  private flushed = 0;

  constructor(private readonly item: string, private readonly rate: number, private readonly tell: Tell) {}

  /** Samples all times since the last frame; `at` is the value at a time, s. */
  step(t: number, now: number, at: (t: number) => readonly number[]): void {
    for (let due = this.next / this.rate; due <= t; due = this.next / this.rate) {
      this.samples.push([Math.round(1000 * due), ...at(due).map((value) => Math.round(100 * value) / 100)]);
      this.next += 1;
    }
    if (t - this.flushed >= BATCH) this.flush(t, now);
  }

  flush(t: number, now: number): void {
    this.flushed = t;
    while (this.samples.length > 0) this.tell(this.item, { samples: this.samples.splice(0, 500) }, now);
  }
}

export class Tasks {
  readonly root = element("div", "tasks");
  private readonly sounds: Sounds | null;
  private readonly waiting: { readonly sound: Sound; readonly due: number }[];
  private readonly sounding: Due[] = [];
  private readonly question = element("div", "rating");
  private readonly slider = element("input");
  private readonly samplers: { readonly slider: Sampler | null; readonly head: Sampler | null };
  private slid: [number, number][] = [[0, 0]];
  private before: readonly [number, number, number] | null = null;
  /** ms, when the stimulus began, later by the time for which it was paused */
  private began = 0;
  private isRunning = false;
  private signal: Open | null = null;
  private asked: Open | null = null;
  private typed = "";
  private typing = 0;
  private timer = 0;

  constructor(
    private readonly plan: TaskPlan,
    private readonly tell: Tell,
    private readonly head: { readonly quaternion: Quaternion },
    private readonly sign: (text: string) => void,
  ) {
    const { rating, slider, head: look, counting, reaction } = plan;
    const due = (sound: Sound, times: readonly number[] = []) => times.map((t) => ({ sound, due: t }));
    this.waiting = [...due("tone", counting?.times), ...due("signal", reaction?.times), ...due("chime", rating?.times)];
    this.waiting.sort((a, b) => a.due - b.due);
    this.sounds = this.waiting.length > 0 ? new Sounds() : null;
    this.samplers = {
      slider: slider === undefined ? null : new Sampler("slider", slider.rate, tell),
      head: look === undefined ? null : new Sampler("head", look.rate, tell),
    };
    this.question.hidden = true;
    this.root.hidden = true;
    this.root.append(this.question);
    if (rating !== undefined) this.makeQuestion(rating.high);
    if (slider !== undefined) this.makeSlider(slider.high);
    if (reaction !== undefined) {
      const now = button(this.say("now"), "", () => undefined);
      now.className = "now";
      now.addEventListener("pointerdown", (event) => { this.press(event.timeStamp); });
      this.root.append(now);
    }
    window.addEventListener("keydown", (event) => { this.key(event); });
    window.addEventListener("wheel", (event) => { this.wheel(event); }, { passive: true });
  }

  private say(name: string, high = ""): string {
    return (this.plan.words[`task_${name}`] ?? "").replace("{high}", high);
  }

  /** Instructions, with the sounds to be heard beforehand. */
  about(): HTMLElement[] {
    const { rating, slider, head, counting, reaction } = this.plan;
    const said: HTMLElement[] = [];
    const add = (name: string, high?: number): void => { said.push(element("li", "", this.say(name, String(high ?? "")))); };
    if (rating !== undefined) add("rating_about", rating.high);
    if (slider !== undefined) add("slider_about");
    if (counting !== undefined) add("counting_about");
    if (reaction !== undefined) add("reaction_about");
    if (head !== undefined) add("head");
    const list = element("ul");
    list.append(...said);
    const row = element("p");
    const hear = (name: string, sound: Sound): void => {
      row.append(button(this.say(name), "", () => {
        this.sounds?.open();
        this.sounds?.play(sound);
      }), " ");
    };
    if (counting !== undefined) hear("hear_tone", "tone");
    if (reaction !== undefined) hear("hear_signal", "signal");
    return said.length === 0 ? [] : [list, row];
  }

  begin(now: number): void {
    this.began = now;
    this.isRunning = true;
    this.root.hidden = false;
    this.sounds?.open();
    this.look(0, now);
    this.timer = window.setInterval(() => { this.handOver(performance.now()); }, TICK);
  }

  /** Pauses, or goes on after a pause of some ms. */
  pause(on: boolean, lasted = 0): void {
    this.began += lasted;
    this.isRunning = !on;
    this.sounds?.pause(on);
  }

  /** One frame, at a time of the page's clock, ms. */
  step(now: number): void {
    if (!this.isRunning) return;
    const t = (now - this.began) / 1000;
    this.handOver(now);
    this.expire(now);
    this.samplers.slider?.step(t, now, (at) => [this.slid.findLast(([since]) => since <= at)![1]]);
    this.look(t, now);
  }

  /** Hands sounds over, moves those that the sound card would play at another time, and notices those that are heard. */
  private handOver(now: number): void {
    const { sounds } = this;
    if (sounds === null || !this.isRunning) return;
    sounds.measure();
    const at = (due: number): number => this.began + 1000 * due;
    const ahead = sounds.isCompared ? AHEAD : AT_LAST;
    while (this.waiting[0] !== undefined && at(this.waiting[0].due) - now < ahead) {
      const { sound, due } = this.waiting.shift()!;
      this.sounding.push({ sound, due, playing: sounds.play(sound, at(due)) });
    }
    for (const each of this.sounding) {
      if (at(each.due) - now < SETTLED || Math.abs(sounds.heard(each.playing.begin) - at(each.due)) < OFF) continue;
      each.playing.stop();
      each.playing = sounds.play(each.sound, at(each.due));
    }
    while (this.sounding[0] !== undefined && sounds.heard(this.sounding[0].playing.begin) <= now) {
      this.came(this.sounding.shift()!);
    }
  }

  /** A reaction at a time of the page's clock, ms. */
  press(at: number): void {
    if (!this.isRunning || this.plan.reaction === undefined) return;
    const next = this.sounding[0]; // the sound is heard, but no frame has noticed it yet
    if (next?.sound === "signal" && this.sounds!.heard(next.playing.begin) <= at) this.came(this.sounding.shift()!);
    const { signal } = this;
    if (signal === null) {
      this.tell("press", { came: this.seconds(at) }, at);
      return;
    }
    this.signal = null;
    this.tell("signal", { due: signal.due, came: this.seconds(signal.came), seconds: rounded((at - signal.came) / 1000) }, signal.came);
  }

  end(now: number): void {
    if (this.timer === 0) return; // it has not begun
    this.expire(Infinity);
    clearInterval(this.timer);
    this.timer = 0;
    this.isRunning = false;
    this.root.hidden = true;
    const t = (now - this.began) / 1000;
    this.samplers.slider?.flush(t, now);
    this.samplers.head?.flush(t, now);
    this.sounds?.close();
  }

  /** s from the beginning */
  private seconds(at: number): number {
    return rounded((at - this.began) / 1000);
  }

  private came({ sound, due, playing }: Due): void {
    const came = this.sounds!.heard(playing.begin);
    if (sound === "tone") this.tell("tone", { due, came: this.seconds(came) }, came);
    else if (sound === "signal") this.signal = { due, came };
    else {
      this.asked = { due, came };
      this.question.hidden = false;
      this.sign(this.say("rating"));
    }
  }

  /** Ends a signal and a question that were not answered in time. */
  private expire(now: number): void {
    const { signal, asked, plan } = this;
    if (signal !== null && now - signal.came > 1000 * (plan.reaction?.wait ?? 0)) {
      this.signal = null;
      this.tell("signal", { due: signal.due, came: this.seconds(signal.came) }, signal.came);
    }
    if (this.typed !== "" && now - this.typing > TYPED) this.enter(now);
    if (asked !== null && now - asked.came > 1000 * (plan.rating?.shown ?? 0)) this.rated(null, now);
  }

  // Rating when asked

  private makeQuestion(high: number): void {
    const row = element("div", "numbers");
    for (let value = 0; value <= high; value += 1) {
      const one = button(String(value), "", () => { this.rated(value, performance.now()); });
      row.append(one);
    }
    const ends = element("div", "ends");
    ends.append(element("span", "", `0 = ${this.say("low")}`), element("span", "", `${high} = ${this.say("high")}`));
    this.question.append(element("strong", "", this.say("rating")), row, ends);
    this.question.setAttribute("role", "alertdialog");
    this.question.setAttribute("aria-label", this.say("rating"));
  }

  private rated(value: number | null, at: number): void {
    const { asked } = this;
    if (asked === null) return;
    this.asked = null;
    this.typed = "";
    this.question.hidden = true;
    this.sign("");
    const came = { due: asked.due, came: this.seconds(asked.came) };
    this.tell("rating", value === null ? came : { ...came, value, seconds: rounded((at - asked.came) / 1000) }, asked.came);
  }

  private enter(at: number): void {
    const value = Number(this.typed);
    this.typed = "";
    if (value <= (this.plan.rating?.high ?? 0)) this.rated(value, at);
  }

  private key(event: KeyboardEvent): void {
    if (!this.isRunning || event.repeat) return;
    if (event.key === " " && this.plan.reaction !== undefined) {
      event.preventDefault();
      this.press(event.timeStamp);
    } else if (this.asked !== null && /^[0-9]$/.test(event.key)) {
      this.typed += event.key;
      this.typing = event.timeStamp;
      this.sign(`${this.say("rating")} ${this.typed}`);
    } else if (this.typed !== "" && event.key === "Enter") {
      event.preventDefault();
      this.enter(event.timeStamp);
    }
  }

  // The slider

  private makeSlider(high: number): void {
    const { slider } = this;
    slider.type = "range";
    slider.min = "0";
    slider.max = String(high);
    slider.step = "any";
    slider.value = "0";
    slider.addEventListener("input", (event) => { this.slide(event.timeStamp); });
    const label = element("label", "slider");
    const ends = element("div", "ends");
    ends.append(element("span", "", this.say("low")), element("span", "", this.say("high")));
    label.append(element("strong", "", this.say("slider")), slider, ends);
    this.root.append(label);
  }

  private wheel(event: WheelEvent): void {
    if (!this.isRunning || this.plan.slider === undefined) return;
    const { slider, plan } = this;
    slider.value = String(Number(slider.value) - Math.sign(event.deltaY) * NOTCH * plan.slider!.high);
    this.slide(event.timeStamp);
  }

  private slide(at: number): void {
    this.slid.push([Math.max((at - this.began) / 1000, 0), Number(this.slider.value)]);
  }

  // The head

  private readonly ahead = new Vector3();

  /** Degrees to the left and up at even times, between the last frame and this one. */
  private look(t: number, now: number): void {
    const { ahead } = this;
    ahead.set(0, 0, -1).applyQuaternion(this.head.quaternion);
    let yaw = (180 / Math.PI) * Math.atan2(-ahead.x, -ahead.z);
    const pitch = (180 / Math.PI) * Math.asin(Math.min(Math.max(ahead.y, -1), 1));
    const [t0, yaw0, pitch0] = this.before ?? [t, yaw, pitch];
    yaw += 360 * Math.round((yaw0 - yaw) / 360); // the short way round
    this.samplers.head?.step(t, now, (at) => {
      const share = t > t0 ? Math.min(Math.max((at - t0) / (t - t0), 0), 1) : 1;
      return [yaw0 + share * (yaw - yaw0), pitch0 + share * (pitch - pitch0)];
    });
    this.before = [t, yaw, pitch];
  }
}

function rounded(value: number): number {
  return Math.round(10000 * value) / 10000;
}
