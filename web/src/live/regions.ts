// Why the robot does not go elsewhere, and doors: a region of the map is asked about, closed and opened by its name.
import { button, element } from "../shared/dom";
import type { Message, NamedRegion, Why } from "./messages";

export class Regions {
  readonly root = element("section");
  /** Names of the regions that are closed. */
  private closed: ReadonlySet<string>;
  why: Why | null = null;
  /** The answer, which lies over the view. */
  readonly overlay = element("div");
  private readonly answer = element("p");
  private readonly select = element("select");
  private readonly door: HTMLButtonElement;

  constructor(
    private readonly regions: readonly NamedRegion[],
    closed: readonly string[],
    private readonly may: boolean,
    send: (message: Message) => void,
    cleared: () => void,
  ) {
    this.root.id = "regions";
    this.closed = new Set(closed);
    this.answer.setAttribute("role", "status");
    this.answer.id = "why";
    this.overlay.id = "because";
    this.overlay.hidden = true;
    const done = button("×", "Hide the answer", () => {
      this.clear();
      cleared();
    });
    done.setAttribute("aria-label", "Hide the answer");
    this.overlay.append(this.answer, done);
    this.select.setAttribute("aria-label", "Places of the map");
    const places = regions.flatMap(({ name, solid }) => (solid ? (/wall/iu.test(name) ? [] : [`left of ${name}`, `right of ${name}`]) : [name]));
    this.select.append(...[...new Set(places)].map((name) => element("option", "", name)));
    this.select.addEventListener("change", () => { this.showDoor(); });
    this.door = button("", "", () => {
      const name = this.select.value;
      send({ type: this.closed.has(name) ? "open" : "close", name });
    });
    const row = element("div", "row");
    row.append(this.select, button("Why not here?", "Ask what the best way through this region costs", () => {
      if (this.select.value !== "") send({ type: "why", region: this.select.value });
    }), this.door);
    row.hidden = places.length === 0;
    const help = "Choose “Why not here?” above and click on the map; or ask about a place by its name.";
    this.root.append(element("h2", "", "Why this way?"), ...(may ? [element("p", "quiet", help), row] : []));
    this.showDoor();
  }

  /** Corners of the closed regions, for the map. */
  get shut(): NamedRegion["ring"][] {
    return this.regions.filter(({ name }) => this.closed.has(name)).map(({ ring }) => ring);
  }

  /** The server closed and opened regions: these are closed now. */
  setClosed(names: readonly string[]): void {
    this.closed = new Set(names);
    this.showDoor();
  }

  answered(why: Why): void {
    this.why = why.line.length > 1 ? why : null;
    this.answer.textContent = `${why.sentence}${why.exact ? "" : " (As far as was searched: a better way may exist.)"}`;
    this.overlay.hidden = false;
  }

  clear(): void {
    this.why = null;
    this.answer.textContent = "";
    this.overlay.hidden = true;
  }

  private showDoor(): void {
    const name = this.select.value;
    this.door.hidden = !this.may || !this.regions.some((region) => region.name === name && !region.solid);
    this.door.textContent = this.closed.has(name) ? "Open it" : "Close it";
    this.door.title = this.closed.has(name) ? `The robot may drive through ${name} again` : `The robot must not drive through ${name}, as if a door was shut`;
  }
}
