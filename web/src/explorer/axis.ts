// One axis: its name, which can be dragged to move the axis; bounds as numbers at both ends; the strip for a brush.
import { brushOn, endsOf } from "./brush";
import { button, make } from "./dom";
import { parsed, text } from "./numbers";
import { Scale } from "./scale";
import type { Bound } from "./selection";
import type { State } from "./state";
import { GROUP_COLOURS, GROUP_WORDS } from "./theme";

const STARTED = 5; // pixels that make a drag of a click

export interface AxisPlaces {
  /** Position among the axes at a point of the page. */
  placeAt(clientX: number): number;
  click(event: PointerEvent): void;
}

export class Axis {
  readonly element: HTMLElement;
  /** Middle of the axis, CSS pixels from the left of all axes. */
  x = 0;
  scale: Scale;
  private readonly strip = make("div", "strip");
  private readonly brush = make("div", "brush");
  private readonly top: HTMLInputElement;
  private readonly bottom: HTMLInputElement;
  private readonly logButton: HTMLButtonElement;
  private readonly flipButton: HTMLButtonElement;
  private readonly name: HTMLButtonElement;

  constructor(
    private readonly state: State,
    readonly index: number,
    private readonly places: AxisPlaces,
    /** Pixels above and below the axis in its strip. */
    private readonly pad: number,
  ) {
    const column = state.column(index);
    const colour = GROUP_COLOURS[column.group];
    this.scale = new Scale(column, false, false);
    const words = GROUP_WORDS[column.group];
    const badge = make("span", "badge", column.group, { title: words, "aria-hidden": "true" });
    badge.style.background = colour;
    this.name = make("button", "axis-name", [badge, broken(column.label)], {
      type: "button",
      title: `${column.label}, ${words}. ${column.about}\nDrag to reorder, or press Shift and an arrow key.`,
    });
    this.name.style.borderColor = colour;
    this.flipButton = button("\u21c5", `flip ${column.name}`, () => { state.flip(index); });
    this.logButton = button("log", `logarithmic scale of ${column.name}`, () => { state.log(index); });
    this.logButton.disabled = column.low <= 0 || this.scale.equal;
    const drop = button("\u00d7", `remove the axis of ${column.name}`, () => { state.show(index, false); });
    const tools = make("div", "axis-tools", [this.flipButton, this.logButton, drop]);
    this.top = this.end(1);
    this.bottom = this.end(0);
    this.strip.append(this.brush);
    this.element = make("div", `axis${column.reported ? " reported" : ""}`, [this.name, tools, this.top, this.strip, this.bottom], {
      role: "group",
      "aria-label": column.label,
    });
    brushOn(this.strip, pad, {
      scale: () => this.scale,
      bound: () => this.bound,
      set: (bound, done) => { state.bound(index, bound, done); },
      click: (event) => { places.click(event); },
    });
    this.dragged();
  }

  private get bound(): Bound | null {
    return this.state.filter.bounds.get(this.index) ?? null;
  }

  /** Shows the current position, scale and bounds. */
  show(x: number, width: number): void {
    const { state, index } = this;
    this.x = x;
    this.scale = new Scale(state.column(index), state.isLog(index), state.flipped.has(index));
    this.element.style.width = `${width}px`;
    this.element.style.left = `${x - width / 2}px`;
    this.logButton.setAttribute("aria-pressed", String(state.isLog(index)));
    this.flipButton.setAttribute("aria-pressed", String(state.flipped.has(index)));
    this.showBound();
  }

  private showBound(): void {
    const { bound, scale, pad } = this;
    this.element.classList.toggle("bounded", bound !== null);
    for (const [input, place] of [[this.top, 1], [this.bottom, 0]] as const) {
      const { least, extreme } = this.endOf(place);
      const value = bound === null ? extreme : least ? bound.low : bound.high;
      const open = !Number.isFinite(value) || bound === null;
      if (document.activeElement !== input) input.value = open ? "" : text(scale.column, value);
      input.placeholder = text(scale.column, extreme);
      input.title = open ? "" : String(value);
      input.setAttribute("aria-label", `${least ? "least" : "greatest"} ${scale.column.name}`);
    }
    this.brush.hidden = bound === null;
    if (bound === null) return;
    const [low, high] = endsOf(scale, bound);
    const height = this.strip.clientHeight - 2 * pad;
    const least = Math.max((high - low) * height, 4);
    this.brush.style.top = `${pad + (1 - high) * height - (least > (high - low) * height ? 2 : 0)}px`;
    this.brush.style.height = `${least}px`;
  }

  /** The end of the value range that is at this end of the axis. */
  private endOf(place: 0 | 1): { least: boolean; extreme: number } {
    const { low, high } = this.scale.column;
    const least = (place === 0) !== this.scale.flipped;
    return { least, extreme: least ? low : high };
  }

  /** The input for the bound at an end of the axis; empty if there is no bound. */
  private end(place: 0 | 1): HTMLInputElement {
    const input = make("input", "bound", "", { type: "text", inputmode: "decimal", spellcheck: "false", autocomplete: "off" });
    const take = (): void => {
      const { least } = this.endOf(place);
      const value = input.value.trim() === "" ? (least ? -Infinity : Infinity) : parsed(input.value);
      input.setAttribute("aria-invalid", String(value === null));
      if (value === null) return;
      const { low, high } = this.bound ?? { low: -Infinity, high: Infinity };
      const [a, b] = least ? [value, high] : [low, value];
      this.state.bound(this.index, a === -Infinity && b === Infinity ? null : { low: Math.min(a, b), high: Math.max(a, b) });
    };
    input.addEventListener("change", take);
    input.addEventListener("blur", () => {
      input.setAttribute("aria-invalid", "false");
      this.showBound();
    });
    input.addEventListener("keydown", (event) => {
      if (event.key === "Enter") input.blur();
    });
    return input;
  }

  /** Lets the name be dragged, which moves the axis past others. */
  private dragged(): void {
    const { state, index, name, places } = this;
    let from: number | null = null;
    let started = false;
    const follow = (event: PointerEvent): void => {
      const box = this.element.parentElement!.getBoundingClientRect();
      this.element.style.transform = `translateX(${event.clientX - box.left - this.x}px)`;
    };
    const end = (): void => {
      from = null;
      started = false;
      this.element.style.transform = "";
      this.element.classList.remove("dragged");
    };
    name.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      from = event.clientX;
      name.setPointerCapture(event.pointerId);
    });
    name.addEventListener("pointermove", (event) => {
      if (from === null) return;
      started ||= Math.abs(event.clientX - from) > STARTED;
      if (!started) return;
      this.element.classList.add("dragged");
      state.move(index, places.placeAt(event.clientX));
      follow(event);
    });
    name.addEventListener("pointerup", end);
    name.addEventListener("pointercancel", end);
    name.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!event.shiftKey || step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      state.move(index, Math.max(state.shown.indexOf(index) + step, 0));
      name.focus();
    });
  }
}

/** A name that may be broken after its underscores. */
function broken(label: string): DocumentFragment {
  const fragment = document.createDocumentFragment();
  for (const part of label.split(/(?<=_)/)) fragment.append(part, document.createElement("wbr"));
  return fragment;
}
