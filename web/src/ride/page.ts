// The page: view, map, criteria and controls, and what keys and buttons do.
import { type Checks, checks } from "./check";
import { Clock, SPEEDS } from "./clock";
import { colourOfTrack } from "./colours";
import { button, element } from "../shared/dom";
import { GazeButtons } from "./gaze";
import { Headset } from "./headset";
import { helpDialog } from "./help";
import { Log } from "./log";
import { Looking } from "./looking";
import type { Ride } from "./model";
import { Plan } from "./plan";
import { RatesPanel } from "./rates";
import { Stage } from "./stage";
import { Track } from "./track";

/** Darkness of the margins at full speed. */
const VIGNETTE = 0.9;
const FULL_PACE = 0.8;
/** Longest time step of a frame, s, for a page that was hidden. */
const LONGEST = 0.25;
/** Time before and after a visit, s, at which its stop is named too: a visit without dwell would flash. */
const PASSING = 0.5;

export class Page {
  readonly clock: Clock;
  readonly log = new Log();
  private readonly root = element("div");
  private readonly seen = element("p");
  private readonly message = element("div");
  private readonly play = button("▶ Play", "Play or stop (Space)", () => {
    this.toggle();
  });
  private readonly scrub = element("input");
  private readonly time = element("output");
  private readonly frame = element("div");
  private readonly chips: HTMLButtonElement[];
  private readonly speed = element("select");
  private readonly together: HTMLButtonElement;
  private readonly phone: HTMLButtonElement;
  private readonly blindness: HTMLButtonElement;
  private readonly dialog: HTMLDialogElement;
  private readonly stage: Stage;
  private readonly looking: Looking;
  private readonly headset: Headset;
  private readonly gaze: GazeButtons;
  private readonly plan: Plan;
  private readonly rates: RatesPanel | null;
  private vignette = false;
  private blind: boolean;
  private last = 0;
  private moved = true;

  constructor(private readonly ride: Ride) {
    const tracks = ride.tracks.map((data) => new Track(data));
    this.clock = new Clock(tracks);
    this.blind = ride.blind;
    this.root.id = "ride";
    this.seen.id = "seen";
    this.message.id = "message";
    this.frame.id = "frame";
    this.play.id = "play";
    this.time.id = "time";
    const view = element("main");
    view.id = "view";
    const canvas = element("canvas");
    canvas.setAttribute("aria-label", "What the robot's camera sees; drag to look around");
    view.append(element("h1", "unseen", document.title), canvas, this.frame, this.seen, this.message);

    const side = element("aside");
    side.id = "side";
    const map = element("canvas");
    map.id = "plan";
    map.setAttribute("aria-label", "Map: the paths, and the camera with its view direction");
    side.append(map);
    this.plan = new Plan(map, ride, this.clock);
    this.rates = this.addRates(side, tracks);

    this.chips = tracks.map((track, i) => {
      const chip = button(track.name, `Ride along ${track.name} (${i + 1})`, () => {
        this.switchTo(i);
      });
      chip.style.setProperty("--mine", colourOfTrack(i));
      return chip;
    });
    this.together = button("at equal time", "Switch at equal time or at equal progress (T)", () => {
      this.toggleTogether();
    });
    this.together.id = "together";
    this.phone = button("Follow phone", "Look around by turning the phone; an iPhone asks for permission", () => {
      void this.looking.togglePhone().then((on) => {
        this.phone.setAttribute("aria-pressed", String(on));
        this.log.add("follow phone", on);
      });
    });
    this.blindness = button("Blind", "Hide numbers and names, to choose by the view alone (N)", () => {
      this.setBlind(!this.blind);
    });

    this.stage = new Stage(canvas, ride);
    this.looking = new Looking(this.stage.head, canvas, () => {
      this.stage.stale = true;
    });
    this.gaze = new GazeButtons([
      { label: () => (this.clock.playing ? "Stop" : "Play"), press: () => { this.toggle(); } },
      { label: () => `To ${tracks[(this.clock.current + 1) % tracks.length]!.name}`, press: () => { this.next(); } },
      { label: () => "Again", press: () => { this.again(); } },
      { label: () => "Leave", press: () => { this.headset.leave(); } },
    ]);
    this.headset = new Headset(this.stage, this.gaze, (on) => { this.wornOrNot(on); }, () => { this.toggle(); });
    this.dialog = helpDialog(
      [
        {
          label: "Dark margins while the view moves (vignette)",
          title: "May reduce sickness for some people; it changes the view",
          get: () => this.vignette,
          set: (on) => {
            this.vignette = on;
            this.option("vignette", on);
          },
        },
        {
          label: "Keep the view level when the camera tilts or rolls",
          title: "May reduce sickness for some people; it changes the view",
          get: () => this.stage.level,
          set: (on) => {
            this.stage.level = on;
            this.option("level view", on);
          },
        },
      ],
      ride.blind ? [] : ride.notes,
      ride.licence,
      () => { this.log.save(); },
    );
    this.root.append(view, side, this.bar(), this.dialog);
    document.body.append(this.root);
    this.listen();
    this.setBlind(this.blind);
    this.fit();
    this.showState();
    this.log.add("ride", this.clock.track.name);
    this.stage.renderer.setAnimationLoop((now) => { this.step(now); });
    if (location.hash === "#check") (globalThis as { hpopRide?: Checks }).hpopRide = checks(this.clock, this.stage);
  }

  private addRates(side: HTMLElement, tracks: readonly Track[]): RatesPanel | null {
    if (this.ride.blind || this.ride.criteria.length === 0) return null;
    const panel = element("section");
    panel.id = "rates";
    panel.tabIndex = 0; // it may scroll
    panel.setAttribute("aria-label", "Criteria along the path");
    panel.append(
      element("h2", "", "How criteria arise along the path"),
      element("p", "", "Rates of the executed motion; the cursor is the present. Below each, the cost of the whole plan."),
    );
    side.append(panel);
    return new RatesPanel(panel, this.ride.criteria, tracks, this.clock, (t) => { this.seek(t); });
  }

  private bar(): HTMLElement {
    const bar = element("footer");
    bar.id = "bar";
    const chips = element("div");
    chips.id = "tracks";
    chips.append(...this.chips);
    this.scrub.id = "scrub";
    this.scrub.type = "range";
    this.scrub.min = "0";
    this.scrub.max = "1000";
    this.scrub.step = "any";
    this.scrub.setAttribute("aria-label", "Position along the ride");
    this.scrub.addEventListener("input", () => {
      this.seek((Number(this.scrub.value) / 1000) * this.clock.track.duration);
    });
    this.speed.id = "speed";
    this.speed.setAttribute("aria-label", "Speed");
    this.speed.title = "Speed (up, down)";
    for (const speed of SPEEDS) {
      const option = element("option", "", `${speed}×`);
      option.value = String(speed);
      option.selected = speed === 1;
      this.speed.append(option);
    }
    this.speed.addEventListener("change", () => { this.setSpeed(Number(this.speed.value)); });
    const full = button("View alone", "The view alone, or with map and criteria (F)", () => { this.toggleFull(); });
    const help = button("Help", "Keys and options (?)", () => { this.dialog.showModal(); });
    const headset = button("Headset", "Enter the headset (V); Esc leaves it at once", () => { void this.headset.enter(); });
    headset.id = "headset";
    headset.hidden = true;
    void this.headset.isThere().then((is) => { headset.hidden = !is; });
    this.phone.hidden = !("DeviceOrientationEvent" in window && navigator.maxTouchPoints > 0);
    bar.append(this.play, chips);
    if (this.clock.tracks.length > 1) bar.append(this.together);
    bar.append(this.scrub, this.time, this.speed, this.phone, full);
    if (!this.ride.blind) bar.append(this.blindness);
    bar.append(headset, help);
    return bar;
  }

  private listen(): void {
    window.addEventListener("resize", () => { this.fit(); });
    new ResizeObserver(() => { this.fit(); }).observe(this.stage.canvas);
    window.addEventListener("keydown", (event) => { this.key(event); });
    document.addEventListener("visibilitychange", () => {
      if (document.hidden && !this.headset.isOn) this.stop();
    });
  }

  private key(event: KeyboardEvent): void {
    if (event.key === "Escape" && this.headset.isOn) {
      this.headset.leave();
      return;
    }
    if (this.dialog.open || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target instanceof HTMLSelectElement) return;
    const number = Number(event.key);
    const jump = event.shiftKey ? 5 : 1;
    const actions: Record<string, () => void> = {
      " ": () => { this.toggle(); },
      ArrowLeft: () => { this.seek(this.clock.t - jump); },
      ArrowRight: () => { this.seek(this.clock.t + jump); },
      ArrowUp: () => { this.faster(1); },
      ArrowDown: () => { this.faster(-1); },
      Home: () => { this.seek(0); },
      End: () => { this.seek(this.clock.track.duration); },
      x: () => { this.next(); },
      t: () => { this.toggleTogether(); },
      r: () => { this.looking.recentre(); },
      f: () => { this.toggleFull(); },
      n: () => { if (!this.ride.blind) this.setBlind(!this.blind); },
      v: () => { void this.headset.enter(); },
      "?": () => { this.dialog.showModal(); },
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (number >= 1 && number <= this.clock.tracks.length) this.switchTo(number - 1);
    else if (action !== undefined) action();
    else return;
    event.preventDefault();
  }

  // Actions

  private toggle(): void {
    if (this.clock.playing) {
      this.stop();
      return;
    }
    if (this.clock.atEnd) this.clock.seek(0);
    if (this.clock.t === 0) this.stage.fade("view", "black");
    else this.stage.light();
    this.clock.playing = true;
    this.log.add("play", round(this.clock.t));
    this.showState();
  }

  private stop(): void {
    if (!this.clock.playing) return;
    this.clock.playing = false;
    this.log.add("stop", round(this.clock.t));
    this.showState();
  }

  private again(): void {
    this.clock.seek(0);
    this.clock.playing = false;
    this.toggle();
  }

  private next(): void {
    this.switchTo((this.clock.current + 1) % this.clock.tracks.length);
  }

  private switchTo(i: number): void {
    this.clock.switchTo(i);
    this.stage.light();
    this.log.add("ride", this.clock.track.name);
    this.showState();
  }

  private seek(t: number): void {
    this.clock.seek(t);
    this.stage.light();
    this.log.add("seek", round(this.clock.t));
    this.showState();
  }

  private setSpeed(speed: number): void {
    this.clock.speed = speed;
    this.speed.value = String(speed);
    this.log.add("speed", speed);
  }

  private faster(steps: number): void {
    const at = SPEEDS.findIndex((speed) => speed === this.clock.speed) + steps;
    this.setSpeed(SPEEDS[Math.min(Math.max(at, 0), SPEEDS.length - 1)]!);
  }

  private toggleTogether(): void {
    this.clock.together = this.clock.together === "time" ? "progress" : "time";
    this.log.add("together", this.clock.together);
    this.showState();
  }

  private toggleFull(): void {
    this.root.classList.toggle("full");
    this.fit();
  }

  private setBlind(blind: boolean): void {
    this.blind = blind;
    this.root.classList.toggle("blind", blind);
    this.blindness.setAttribute("aria-pressed", String(blind));
    this.log.add("blind", blind);
    this.fit();
    this.showState();
  }

  private option(what: string, on: boolean): void {
    this.log.add(`option ${what}`, on);
    this.moved = true;
    this.showState();
  }

  private wornOrNot(on: boolean): void {
    this.log.add("headset", on);
    if (!on) {
      this.looking.apply();
      this.fit();
    }
  }

  private fit(): void {
    const framed = this.stage.resize();
    this.frame.hidden = framed === null;
    if (framed !== null) {
      this.frame.style.width = `${100 * framed[0]}%`;
      this.frame.style.height = `${100 * framed[1]}%`;
    }
    this.moved = true;
  }

  // Display

  private showState(): void {
    const { clock } = this;
    this.play.textContent = clock.playing ? "❚❚ Stop" : clock.atEnd ? "↺ Again" : "▶ Play";
    this.chips.forEach((chip, i) => { chip.setAttribute("aria-pressed", String(i === clock.current)); });
    this.together.textContent = clock.together === "time" ? "at equal time" : "at equal progress";
    this.tell();
    this.moved = true;
  }

  /** Writes which trajectory is ridden, and the stop of a tour at which it is. */
  private tell(): void {
    const { track, t } = this.clock;
    const visit = this.blind ? undefined : (track.data.visits ?? []).find(({ begin, end }) => begin - PASSING <= t && t <= end + PASSING);
    const stop = visit === undefined ? "" : ` \u00b7 stop ${visit.number}: ${visit.name}`;
    const told = this.blind ? "" : `${track.label}${stop}`;
    if (this.seen.textContent === `${track.name}${told && `  ${told}`}`) return;
    this.seen.replaceChildren(track.name);
    if (told !== "") this.seen.append(element("i", "", `  ${told}`));
  }

  private step(now: number): void {
    const seconds = Math.min(Math.max((now - this.last) / 1000, 0), LONGEST);
    this.last = now;
    if (this.clock.playing || this.moved) {
      if (this.clock.advance(seconds)) {
        this.stage.fade("black");
        this.log.add("end", this.clock.track.name);
        this.showState();
      }
      this.refresh();
    }
    if (this.headset.isOn) this.gaze.look(this.stage.head, seconds);
    this.message.textContent = this.stage.isDark ? "The end of the ride" : "";
    this.stage.draw(seconds);
    document.documentElement.dataset["ready"] = "yes";
  }

  /** Updates everything to the current time. */
  private refresh(): void {
    const { clock } = this;
    const { track } = clock;
    this.moved = false;
    this.stage.narrow = this.vignette && clock.playing ? VIGNETTE * Math.min(track.pace(clock.t) / FULL_PACE, 1) : 0;
    this.stage.place(track, clock.t);
    this.scrub.value = String((1000 * clock.t) / Math.max(track.duration, 1e-9));
    this.time.textContent = this.blind ? "" : `${clock.t.toFixed(1)} / ${track.duration.toFixed(1)} s`;
    this.tell();
    this.plan.draw();
    if (!this.blind) this.rates?.draw();
  }
}

function round(seconds: number): number {
  return Math.round(1000 * seconds) / 1000;
}
