// Where to go: what a click means, landmarks to choose from, stops of a tour, and the server's answer.
import type { Point } from "../ride/model";
import { button, element } from "../shared/dom";
import type { Message, Place } from "./messages";

export type Mode = "go" | "stops" | "why";
export type Stop = { readonly x: number; readonly y: number } | { readonly landmark: string };

const MODES: readonly (readonly [Mode, string, string])[] = [
  ["go", "Go there", "G"],
  ["stops", "Add a stop", "T"],
  ["why", "Why not here?", "Q"],
];
const HINTS: Readonly<Record<Mode, string>> = {
  go: "Click on the map or on the floor of the view.",
  stops: "Click on the places to visit, one after another; then plan the tour.",
  why: "Click where you would rather go; you are told what that costs.",
};

export interface DestinationUser {
  send(message: Message): void;
  changed(): void;
}

export class Destination {
  readonly root = element("section");
  mode: Mode = "go";
  stops: Stop[] = [];
  /** Where the robot goes, or would go. */
  place: Place | null = null;
  private waits = false;
  private readonly modes: HTMLInputElement[] = [];
  private readonly hint = element("p", "quiet");
  private readonly answer = element("p", "answer");
  private readonly landmarks = element("select");
  private readonly list = element("ol", "stops");
  private readonly tour = element("div", "row");
  private readonly plan: HTMLButtonElement;

  constructor(
    private readonly names: ReadonlyMap<string, Point>,
    private readonly user: DestinationUser,
  ) {
    this.root.id = "destination";
    this.answer.setAttribute("role", "status");
    this.answer.id = "place";
    const modes = element("fieldset", "modes");
    modes.append(element("legend", "", "A click means"));
    for (const [mode, label, key] of MODES) modes.append(this.choice(mode, label, key));
    this.plan = button("Plan the tour", "Ask for ways through these stops, in this order", () => { this.planTour(); });
    this.tour.append(this.plan, button("Remove the last", "Remove the last stop", () => {
      this.stops = this.stops.slice(0, -1);
      this.show();
    }));
    const row = element("div", "row");
    const label = element("label", "", "Or a landmark:");
    this.landmarks.id = "landmarks";
    label.htmlFor = this.landmarks.id;
    this.landmarks.append(...[...names.keys()].map((name) => element("option", "", name)));
    row.append(label, this.landmarks, button("Choose", "Choose this landmark as the destination or a stop", () => {
      if (this.landmarks.value !== "") this.choose({ landmark: this.landmarks.value });
    }));
    row.hidden = names.size === 0;
    this.root.append(modes, this.hint, row, this.list, this.tour, this.answer);
    this.show();
  }

  /** The viewer chose a place or a landmark, in the way that the mode says. */
  choose(stop: Stop): void {
    if (this.mode === "why") {
      const at = "landmark" in stop ? this.names.get(stop.landmark) : ([stop.x, stop.y] as const);
      if (at !== undefined) this.user.send({ type: "why", x: at[0], y: at[1] });
    } else if (this.mode === "stops") {
      this.stops = [...this.stops, stop];
      this.answer.textContent = `Stop ${letter(this.stops.length - 1)} added.`;
      this.show();
    } else {
      this.stops = [];
      this.answer.textContent = "Looking for ways …";
      this.waits = true;
      this.user.send({ type: "destination", ...stop });
      this.show();
    }
  }

  setMode(mode: Mode): void {
    this.mode = mode;
    this.show();
  }

  /** Points that are drawn as destinations. */
  get goals(): Point[] {
    const at = this.stops.map((stop) => ("landmark" in stop ? this.names.get(stop.landmark) : ([stop.x, stop.y] as const)));
    const goal = this.place?.goal ?? null;
    return at.length > 0 ? at.filter((point) => point !== undefined) : goal === null ? [] : [goal];
  }

  answered(place: Place): void {
    this.place = place;
    const good = place.status !== "blocked";
    const told = place.words === "" ? place.status : place.words;
    const sentence = `${told.charAt(0).toUpperCase()}${told.slice(1)}.`.replace(/\.\.$/u, ".");
    const near = place.status === "nearest" ? " The robot can go there." : "";
    this.answer.textContent = `${good ? "✓" : "✗"} ${sentence}${near}`;
    this.answer.classList.toggle("bad", !good);
    this.user.changed();
  }

  /** The server does not do what was asked. */
  refused(): void {
    this.waits = false;
    if (this.answer.textContent.endsWith("…")) this.answer.textContent = "";
  }

  /** Ways have come; returns whether they are the first to a new destination. */
  found(): boolean {
    const { waits } = this;
    this.waits = false;
    return waits;
  }

  focus(): void {
    this.landmarks.focus();
  }

  arrived(): void {
    this.place = null;
    this.stops = [];
    this.answer.textContent = "";
    this.show();
  }

  private planTour(): void {
    if (this.stops.length === 0) return;
    this.answer.textContent = "Looking for ways through all stops …";
    this.waits = true;
    this.user.send({ type: "destination", stops: this.stops });
    this.setMode("go");
  }

  private choice(mode: Mode, label: string, key: string): HTMLElement {
    const [row, input] = [element("label"), element("input")];
    input.type = "radio";
    input.name = "mode";
    input.value = mode;
    input.addEventListener("change", () => { if (input.checked) this.setMode(mode); });
    row.title = `${label} (${key})`;
    row.append(input, element("span", "", label));
    this.modes.push(input);
    return row;
  }

  private show(): void {
    for (const input of this.modes) input.checked = input.value === this.mode;
    this.hint.textContent = HINTS[this.mode];
    this.list.replaceChildren(...this.stops.map((stop, i) => element("li", "", `${letter(i)}: ${"landmark" in stop ? stop.landmark : `${stop.x.toFixed(1)} m, ${stop.y.toFixed(1)} m`}`)));
    this.list.hidden = this.tour.hidden = this.stops.length === 0;
    this.plan.textContent = this.stops.length === 1 ? "Go to this stop" : `Plan the tour of ${this.stops.length} stops`;
    this.user.changed();
  }
}

export function letter(i: number): string {
  return String.fromCharCode(65 + (i % 26));
}
