// The page of an arm: the view, a slider for each joint, buttons for states, and the verdict on collisions.
import { button, element } from "../shared/dom";
import type { Arm, Joint } from "./model";
import { type Near, Posture, type Verdict } from "./posture";
import { Stage } from "./stage";

const DEGREE = Math.PI / 180;
/** Step of a joint by a key, rad or m: with and without Shift. */
const STEPS = { rad: [1 * DEGREE, 10 * DEGREE], m: [0.005, 0.05] } as const;
const KEYS: readonly (readonly [string, string])[] = [
  ["1 2 3 …", "choose a joint"],
  ["← →", "move it by 1° or 5 mm; with Shift by 10° or 50 mm; Home, End: to its limits"],
  ["S, G", "start; goal, and the next goal"],
  ["C", "look through the arm’s camera, and back"],
  ["O", "see through obstacles, and back"],
  ["U", "degrees or radians"],
  ["drag, wheel", "turn the view, come nearer; with the right button, move it"],
  ["R", "show the whole arm"],
  ["arrows, + −", "the same on the keyboard, when the view has the focus"],
];

/** For tests, under `hpopArm` in a page opened with #check. */
export interface Checks {
  set(values: readonly number[]): void;
  values(): readonly number[];
  judge(): { collisions: string[][]; nearest: number | null; beyond: readonly string[]; tilted: number | null };
  /** Least and greatest x, y and z of each drawn shape in the world, and whether it is red. */
  drawn(): { low: number[]; high: number[]; red: boolean }[];
}

export class Page {
  private readonly root = element("div");
  private readonly posture: Posture;
  private readonly stage: Stage;
  private readonly said = element("p");
  private readonly pairs = element("ul");
  private readonly nearest = element("p");
  private readonly pointed = element("p");
  private readonly text = element("input");
  private readonly rows: { slider: HTMLInputElement; number: HTMLInputElement; unit: HTMLElement; low: HTMLElement; high: HTMLElement }[] = [];
  private readonly states: HTMLButtonElement[];
  private readonly through: HTMLButtonElement;
  private readonly glass: HTMLButtonElement;
  private readonly units: HTMLButtonElement;
  private readonly dialog: HTMLDialogElement;
  private degrees = true;
  private current: number | null = 0;

  constructor(private readonly arm: Arm) {
    document.title = `${arm.title}: arm and collisions`;
    this.posture = new Posture(arm);
    this.root.id = "arm";
    const view = element("main");
    view.id = "view";
    const canvas = element("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("aria-label", "The arm among the obstacles; drag or use the arrow keys to turn the view");
    this.pointed.id = "seen";
    this.pointed.textContent = "Drag to turn; point at a shape for its name";

    const side = element("aside");
    side.id = "side";
    const verdict = element("section");
    verdict.id = "verdict";
    verdict.setAttribute("role", "status");
    this.said.id = "said";
    this.pairs.id = "pairs";
    verdict.append(this.said, this.pairs, this.nearest);
    this.states = arm.states.map(({ name }, i) => button(title(name), `Move the arm to this state${key(name)}`, () => { this.goTo(i); }));
    const states = element("div");
    states.id = "states";
    states.append(...this.states);
    this.through = button("Camera’s view", "Look through the arm’s camera (C)", () => { this.lookThrough(); });
    this.glass = button("See through", "See through obstacles (O)", () => { this.seeThrough(); });
    this.units = button("", "Show joints in degrees or radians (U)", () => { this.toggleUnits(); });
    this.dialog = this.help();
    const tools = element("div");
    tools.id = "tools";
    tools.append(
      this.through,
      this.glass,
      button("Whole arm", "Show the whole arm (R)", () => { this.stage.reset(); }),
      button("Help", "Keys, and what the page shows (?)", () => { this.dialog.showModal(); }),
    );
    view.append(canvas, this.pointed, tools);
    const joints = element("section");
    joints.id = "joints";
    joints.setAttribute("aria-label", "Joints");
    arm.joints.forEach((joint, k) => { joints.append(this.row(joint, k)); });
    const copy = element("label", "values", "These values, to copy into a scenario, rad or m ");
    this.text.readOnly = true;
    this.text.addEventListener("focus", () => { this.text.select(); });
    copy.append(this.text);
    const head = element("header");
    head.append(element("h1", "", arm.title), element("p", "", `${arm.joints.length} joints, ${obstacles(arm)}`));
    const below = element("div");
    below.id = "controls";
    below.tabIndex = 0; // it may scroll
    below.append(head, states, joints, this.units, copy);
    side.append(verdict, below);
    this.root.append(view, side, this.dialog);
    document.body.append(this.root);

    this.stage = new Stage(canvas, arm, this.posture);
    this.listen(canvas);
    this.showUnits();
    this.stage.resize();
    this.stage.reset();
    this.move();
    const step = (): void => {
      this.stage.draw();
      document.documentElement.dataset["ready"] = "yes";
      requestAnimationFrame(step);
    };
    step();
    if (location.hash === "#check") (globalThis as { hpopArm?: Checks }).hpopArm = this.checks();
  }

  // Parts of the page

  private row(joint: Joint, k: number): HTMLElement {
    const row = element("div", "joint");
    const slider = element("input");
    slider.type = "range";
    slider.step = "any";
    slider.id = `joint-${k}`;
    [slider.min, slider.max] = [String(joint.low), String(joint.high)];
    slider.addEventListener("input", () => { this.setJoint(k, Number(slider.value)); });
    slider.addEventListener("keydown", (event) => { this.jointKey(event, k); });
    const number = element("input");
    number.type = "number";
    number.step = "any";
    number.setAttribute("aria-label", `Value of ${joint.name}`);
    number.addEventListener("change", () => {
      const value = Number(number.value) * this.unitOf(joint).size;
      this.setJoint(k, Math.min(Math.max(Number.isFinite(value) ? value : 0, joint.low), joint.high));
    });
    const label = element("label", "", `${k + 1}  ${joint.name}`);
    label.htmlFor = slider.id;
    const [unit, low, high] = [element("span", "unit"), element("span"), element("span")];
    const limits = element("div", "limits");
    limits.append(low, joint.turning ? element("span", "", "turns without limits") : "", high);
    row.append(label, number, unit, slider, limits);
    this.rows.push({ slider, number, unit, low, high });
    return row;
  }

  private help(): HTMLDialogElement {
    const dialog = element("dialog");
    const keys = element("dl");
    for (const [pressed, what] of KEYS) keys.append(element("dt", "", pressed), element("dd", "", what));
    const millimetres = 1000 * this.arm.kept_distance;
    dialog.append(
      element("h2", "", "The arm"),
      element(
        "p",
        "",
        `You see the shapes that hpop tests for collisions: those of the URDF, with meshes as their convex hulls, or as convex pieces. Two bodies collide if they touch or are nearer than ${millimetres} mm. ` +
          "Links joined by a joint, and pairs that the SRDF excludes, are not tested. The floor is no obstacle; add a box to the world if there is one. " +
          "Yellow lines show what the camera in the hand sees, yellow dots what it shall look at; red, green and blue lines are the axes x, y, z of the tool.",
      ),
      keys,
    );
    if (this.arm.notes.length > 0) {
      const list = element("ul");
      list.append(...this.arm.notes.map((note) => element("li", "", note)));
      dialog.append(element("h3", "", "Notes"), list);
    }
    const terms = element("details");
    terms.append(element("summary", "", "The view is drawn by three.js. Its licence is"), element("pre", "", this.arm.licence));
    dialog.append(terms, button("Close", "Back to the arm", () => { dialog.close(); }));
    return dialog;
  }

  private listen(canvas: HTMLCanvasElement): void {
    new ResizeObserver(() => { this.stage.resize(); }).observe(canvas);
    const tell = (event: PointerEvent): void => {
      this.pointed.textContent = this.stage.named([event.offsetX, event.offsetY]) ?? "";
    };
    canvas.addEventListener("pointerdown", tell);
    canvas.addEventListener("pointermove", (event) => { if (event.buttons === 0) tell(event); });
    canvas.addEventListener("keydown", (event) => { this.viewKey(event); });
    window.addEventListener("keydown", (event) => { this.key(event); });
  }

  // Keys

  private key(event: KeyboardEvent): void {
    const typed = event.target instanceof HTMLInputElement && event.target.type !== "range";
    if (this.dialog.open || typed || event.ctrlKey || event.altKey || event.metaKey || event.defaultPrevented) return;
    const number = Number(event.key);
    if (number >= 1 && number <= this.rows.length) this.rows[number - 1]!.slider.focus();
    else {
      const actions: Record<string, () => void> = {
        s: () => { this.next("start"); },
        g: () => { this.next("goal"); },
        c: () => { this.lookThrough(); },
        o: () => { this.seeThrough(); },
        u: () => { this.toggleUnits(); },
        r: () => { this.stage.reset(); },
        "?": () => { this.dialog.showModal(); },
      };
      const action = actions[event.key.toLowerCase()];
      if (action === undefined) return;
      action();
    }
    event.preventDefault();
  }

  private jointKey(event: KeyboardEvent, k: number): void {
    const joint = this.arm.joints[k]!;
    const step = STEPS[joint.sliding ? "m" : "rad"][event.shiftKey ? 1 : 0];
    const value = this.posture.values[k]!;
    const to: Record<string, number> = {
      ArrowRight: value + step, ArrowUp: value + step, ArrowLeft: value - step, ArrowDown: value - step,
      Home: joint.low, End: joint.high,
    };
    const wanted = to[event.key];
    if (wanted === undefined) return;
    this.setJoint(k, Math.min(Math.max(wanted, joint.low), joint.high));
    event.preventDefault();
  }

  private viewKey(event: KeyboardEvent): void {
    const turns: Record<string, [number, number, number]> = {
      ArrowLeft: [-0.15, 0, 1], ArrowRight: [0.15, 0, 1], ArrowUp: [0, 0.15, 1], ArrowDown: [0, -0.15, 1],
      "+": [0, 0, 1.2], "-": [0, 0, 1 / 1.2],
    };
    const turned = turns[event.key];
    if (turned === undefined || event.ctrlKey || event.metaKey) return;
    this.stage.turn(...turned);
    event.preventDefault();
  }

  // Actions

  private setJoint(k: number, value: number): void {
    const values = [...this.posture.values];
    values[k] = value;
    this.posture.set(values);
    this.current = null;
    this.move();
  }

  private goTo(i: number): void {
    this.posture.set(this.arm.states[i]!.values);
    this.current = i;
    this.move();
  }

  /** The next state whose name begins with a word. */
  private next(word: string): void {
    const places = this.arm.states.flatMap(({ name }, i) => (name.startsWith(word) ? [i] : []));
    const after = places.find((i) => i > (this.current ?? -1) || this.current === null) ?? places[0];
    if (after !== undefined) this.goTo(after);
  }

  private lookThrough(): void {
    this.stage.through = !this.stage.through;
    this.stage.stale = true;
    this.through.setAttribute("aria-pressed", String(this.stage.through));
  }

  private seeThrough(): void {
    const on = this.glass.getAttribute("aria-pressed") !== "true";
    this.glass.setAttribute("aria-pressed", String(on));
    this.stage.glass = on;
  }

  private toggleUnits(): void {
    this.degrees = !this.degrees;
    this.showUnits();
    this.showValues();
  }

  // Display

  private unitOf({ sliding }: Joint): { name: string; size: number; digits: number } {
    if (sliding) return { name: "m", size: 1, digits: 4 };
    return this.degrees ? { name: "°", size: DEGREE, digits: 1 } : { name: "rad", size: 1, digits: 4 };
  }

  private showUnits(): void {
    this.units.textContent = `Show ${this.degrees ? "radians" : "degrees"}`;
    this.rows.forEach(({ unit, low, high, number }, k) => {
      const joint = this.arm.joints[k]!;
      const { name, size, digits } = this.unitOf(joint);
      unit.textContent = name;
      const written = (value: number): string => `${(value / size).toFixed(digits)} ${name}`.replace(" °", "°");
      [low.textContent, high.textContent] = [written(joint.low), written(joint.high)];
      number.setAttribute("aria-label", `Value of ${joint.name}, ${name === "°" ? "degrees" : name}`);
    });
  }

  private showValues(): void {
    this.rows.forEach(({ slider, number }, k) => {
      const joint = this.arm.joints[k]!;
      const { name, size, digits } = this.unitOf(joint);
      const value = this.posture.values[k]!;
      slider.value = String(value);
      number.value = (value / size).toFixed(digits);
      slider.setAttribute("aria-valuetext", `${number.value} ${name === "°" ? "degrees" : name}`);
    });
    const work = this.arm.parents.indexOf(0, 1); // its joints are no part of a state
    const own = work < 0 ? this.posture.values : this.posture.values.slice(0, work);
    this.text.value = `[${own.map((value) => String(Number(value.toFixed(6)))).join(", ")}]`;
  }

  private move(): void {
    const verdict = this.posture.judge();
    this.stage.place();
    this.stage.colour(verdict);
    this.showValues();
    this.say(verdict);
    this.states.forEach((state, i) => { state.setAttribute("aria-pressed", String(i === this.current)); });
    this.rows.forEach(({ slider }, k) => { slider.parentElement!.classList.toggle("beyond", verdict.beyond.includes(this.arm.joints[k]!.name)); });
  }

  private say({ collisions, nearest, beyond, tilted }: Verdict): void {
    const faults = [
      ...beyond.map((name) => `joint ${name} is beyond its limits`),
      ...(tilted === null ? [] : [`${this.arm.kept!.text}, but here it has ${(tilted / DEGREE).toFixed(1)} degrees`]),
    ];
    const where = this.current === null ? "" : `${title(this.arm.states[this.current]!.name)}: `;
    const count = collisions.length;
    const blocked = count > 0 || faults.length > 0;
    const found = count === 0 ? (blocked ? "not usable" : "free of collisions") : count === 1 ? "1 collision" : `${count} collisions`;
    this.said.textContent = where + (where === "" ? found[0]!.toUpperCase() + found.slice(1) : found);
    this.said.className = blocked ? "blocked" : "free";
    this.pairs.replaceChildren(...[...collisions.map((near) => this.pairText(near)), ...faults].map((text) => element("li", "", text)));
    this.nearest.textContent = nearest === null ? "" : `Nearest obstacle: ${nearest.other.name}, ${length(nearest.apart)} from ${nearest.one.name}`;
  }

  private pairText({ one, other, apart }: Near): string {
    const touches = apart === 0 ? "touches" : `is nearer than ${1000 * this.arm.kept_distance} mm to`;
    return `${one.name} ${touches} the ${other.link ? "link" : "obstacle"} ${other.name}`;
  }

  private checks(): Checks {
    return {
      set: (values) => {
        this.posture.set(values);
        this.current = null;
        this.move();
      },
      values: () => this.posture.values,
      judge: () => {
        const { collisions, nearest, beyond, tilted } = this.posture.judge();
        return { collisions: collisions.map(({ one, other }) => [one.name, other.name]), nearest: nearest?.apart ?? null, beyond, tilted };
      },
      drawn: () => this.stage.drawn(),
    };
  }
}

function title(name: string): string {
  return name === "start" || name.startsWith("goal") ? name[0]!.toUpperCase() + name.slice(1) : name;
}

function key(name: string): string {
  return name === "start" ? " (S)" : name.startsWith("goal") ? " (G)" : "";
}

function obstacles({ bodies }: Arm): string {
  const names = new Set(bodies.flatMap(({ link, name }) => (link ? [] : [name])));
  return names.size === 0 ? "no obstacles" : names.size === 1 ? "1 obstacle" : `${names.size} obstacles`;
}

function length(metres: number): string {
  return metres < 0.1 ? `${(1000 * metres).toFixed(1)} mm` : `${metres.toFixed(2)} m`;
}
