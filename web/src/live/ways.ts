// The ways to the destination: a card for each that stands out, and a slider for each criterion to pick among all.
import { colourOfTrack, dashesOfTrack } from "../ride/colours";
import { button, element } from "../shared/dom";
import type { Card, LiveCriterion, Option, Options } from "./messages";

const NAMES: Readonly<Record<string, string>> = {
  knee: "Best balance",
  gentlest: "Gentlest",
  quickest: "Quickest",
  "for you": "For you",
  "most different": "Most different",
};
const WISHES: readonly (readonly [string, string])[] = [["fewer turns", "Fewer turns"], ["hurry", "Hurry"]];

export interface WaysUser {
  take(option: number, asked: number): void;
  wish(wish: string): void;
  /** The way that the sliders picked has changed. */
  picked(): void;
}

interface Slider {
  readonly name: string;
  readonly unit: string;
  readonly row: HTMLElement;
  readonly input: HTMLInputElement;
  readonly output: HTMLOutputElement;
  values: number[];
}

export class Ways {
  readonly cardsRoot = element("section");
  readonly slidersRoot = element("section");
  options: Options = { asked: 0, cards: [], all: [], present: null, certificate: "" };
  /** The way that the sliders picked, if one moved them. */
  pick: Option | null = null;
  /** Card on which the pointer or the focus is. */
  looked: Card | null = null;
  private driven: number | null = null;
  private readonly count = element("p", "answer");
  private readonly list = element("ol");
  private readonly cards: HTMLButtonElement[] = [];
  private readonly wishes = element("div", "row");
  private sliders: Slider[] = [];
  private readonly rows = element("div");
  private readonly takePick: HTMLButtonElement;

  constructor(
    private readonly criteria: readonly LiveCriterion[],
    private readonly may: boolean,
    private readonly user: WaysUser,
  ) {
    this.cardsRoot.id = "ways";
    this.count.setAttribute("role", "status");
    this.count.textContent = may ? "First choose where to go." : "Ways appear here when the driver chooses where to go.";
    for (const [wish, label] of WISHES) {
      this.wishes.append(button(label, `Take a way with this wish: ${wish}`, () => { user.wish(wish); }));
    }
    this.wishes.hidden = true;
    this.cardsRoot.append(element("h2", "", "Ways to get there"), this.count, this.list, this.wishes);
    this.takePick = button("Take this way", "Drive the way that the sliders picked", () => {
      if (this.pick !== null) user.take(this.pick.option, this.options.asked);
    });
    this.slidersRoot.id = "sliders";
    this.slidersRoot.append(
      element("h2", "", "Pick among all ways"),
      element("p", "quiet", "Move a slider to the left for less; the way that it picks is drawn wide."),
      this.rows,
      this.takePick,
    );
    this.slidersRoot.hidden = true;
  }

  show(options: Options): void {
    const before = this.pick;
    this.options = options;
    this.pick = null;
    this.looked = null;
    const { cards, all } = options;
    this.count.title = options.certificate;
    while (this.cards.length < cards.length) this.addCard(this.cards.length);
    this.cards.forEach((made, i) => {
      made.parentElement!.hidden = i >= cards.length;
      if (i < cards.length) this.fillCard(made, cards[i]!, i);
    });
    this.slidersRoot.hidden = !this.may || all.length < 2;
    this.addSliders();
    for (const slider of this.sliders) {
      slider.values = [...new Set(all.map(({ costs }) => costs[slider.name] ?? 0))].sort((a, b) => a - b);
      slider.input.max = String(Math.max(slider.values.length - 1, 0));
      slider.row.hidden = slider.values.length < 2;
    }
    if (before !== null) this.pick = this.nearest(before.costs, all) ?? null;
    this.showDriven(options.present);
  }

  /** The robot drives a way, or none. */
  showDriven(option: number | null): void {
    this.driven = option;
    const { all, cards } = this.options;
    const count = all.length === 1 ? "One way." : `${all.length} ways.`;
    const white = option !== null && !cards.some((card) => card.option === option) ? "; the white line is driven now" : "";
    const advice = option === null ? "Choose one: click, or press its number." : `You may change at any time${white}.`;
    const told = all.length === 0 ? "No way is free at the moment." : `${count} ${this.may ? advice : ""}`.trim();
    if (this.count.textContent !== told) this.count.textContent = told;
    this.wishes.hidden = !this.may || option === null || all.length < 2;
    this.cards.forEach((made, i) => { made.setAttribute("aria-pressed", String(option !== null && this.options.cards[i]?.option === option)); });
    this.showPick();
  }

  isDriven({ option }: Option): boolean {
    return option === this.driven;
  }

  clear(words: string): void {
    this.show({ asked: 0, cards: [], all: [], present: null, certificate: "" });
    this.count.textContent = words;
  }

  /** Brings the cards into view, on a small screen. */
  reveal(): void {
    this.cardsRoot.scrollIntoView({ block: "nearest" });
  }

  takeCard(i: number): boolean {
    const card = this.options.cards[i];
    if (card !== undefined) this.user.take(card.option, this.options.asked);
    return card !== undefined;
  }

  private addCard(i: number): void {
    const made = button("", "", () => { this.takeCard(i); });
    made.className = "card";
    made.disabled = !this.may;
    const look = (on: boolean) => (): void => {
      this.looked = on ? (this.options.cards[i] ?? null) : null;
      this.user.picked();
    };
    for (const kind of ["pointerenter", "focus"]) made.addEventListener(kind, look(true));
    for (const kind of ["pointerleave", "blur"]) made.addEventListener(kind, look(false));
    const item = element("li");
    item.append(made);
    this.list.append(item);
    this.cards.push(made);
  }

  private fillCard(made: HTMLButtonElement, card: Card, i: number): void {
    const number = element("span", "number", String(i + 1));
    number.style.background = colourOfTrack(i);
    const stroke = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    stroke.setAttribute("class", "stroke");
    stroke.setAttribute("viewBox", "0 0 34 6");
    stroke.setAttribute("aria-hidden", "true");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    for (const [name, value] of Object.entries({ x1: 0, y1: 3, x2: 34, y2: 3, stroke: colourOfTrack(i), "stroke-width": 3, "stroke-dasharray": dashesOfTrack(i).join(" ") })) {
      line.setAttribute(name, String(value));
    }
    stroke.append(line);
    const values = Object.entries(card.costs).map(([name, value]) => {
      const { label, unit } = this.criterion(name);
      return `${label} ${quantity(value, unit)}`;
    });
    const head = element("span", "card-head");
    head.append(number, element("strong", "", NAMES[card.name] ?? card.name), stroke);
    made.replaceChildren(head, element("span", "card-words", card.words), element("span", "card-costs", values.join(" · ")));
    made.title = `Drive this way (${i + 1})`;
  }

  private criterion(name: string): LiveCriterion {
    return this.criteria.find((one) => one.name === name) ?? { name, label: name.replaceAll("_", " "), unit: "" };
  }

  /** Makes a slider for each cost of the ways, unless they are there. */
  private addSliders(): void {
    const names = Object.keys(this.options.all[0]?.costs ?? {});
    if (names.length === 0 || names.join() === this.sliders.map(({ name }) => name).join()) return;
    this.sliders = names.map((name) => this.slider(this.criterion(name)));
    this.rows.replaceChildren(...this.sliders.map(({ row }) => row));
  }

  private slider({ name, label, unit }: LiveCriterion): Slider {
    const row = element("div", "slider");
    const [input, output] = [element("input"), element("output")];
    input.type = "range";
    input.min = "0";
    input.step = "1";
    input.setAttribute("aria-label", label);
    row.append(element("span", "", label), output, input);
    const made: Slider = { name, unit, row, input, output, values: [] };
    input.addEventListener("input", () => { this.move(made); });
    return made;
  }

  private move(slider: Slider): void {
    const wished = slider.values[Number(slider.input.value)];
    if (wished === undefined) return;
    const like = this.options.all.filter(({ costs }) => (costs[slider.name] ?? 0) === wished);
    this.pick = this.nearest(this.present?.costs ?? {}, like) ?? null;
    this.showPick();
    this.user.picked();
  }

  /** The way to which the sliders are set: the pick, what is driven, or the first card. */
  private get present(): Option | undefined {
    return this.pick ?? this.options.all.find((option) => this.isDriven(option)) ?? this.options.cards[0] ?? this.options.all[0];
  }

  /** The way among some whose costs, each as a share of its range, are nearest to wished ones. */
  private nearest(wished: Readonly<Record<string, number>>, among: readonly Option[]): Option | undefined {
    const distance = ({ costs }: Option): number =>
      this.sliders.reduce((sum, { name, values }) => {
        const range = (values.at(-1) ?? 0) - (values[0] ?? 0);
        const gap = range > 0 ? ((costs[name] ?? 0) - (wished[name] ?? 0)) / range : 0;
        return sum + gap * gap;
      }, 0);
    const distances = among.map(distance);
    return among[distances.indexOf(Math.min(...distances))];
  }

  private showPick(): void {
    const { present } = this;
    for (const { name, unit, input, output, values } of this.sliders) {
      const value = present?.costs[name];
      if (value === undefined) continue;
      input.value = String(Math.max(values.indexOf(value), 0));
      output.textContent = quantity(value, unit);
      input.setAttribute("aria-valuetext", quantity(value, unit));
    }
    this.takePick.disabled = this.pick === null || this.isDriven(this.pick);
  }
}

/** A value with its unit, to about three figures. */
export function quantity(value: number, unit: string): string {
  const size = Math.abs(value);
  const text = Number.isInteger(value) ? String(value) : value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : 2);
  return unit === "" || unit === "1" ? text : `${text} ${unit}`;
}
