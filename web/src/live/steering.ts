// Steering: a push by the arrow keys, the pad on the page, a game controller or the stick of a headset's controller. A push is a
// direction in the robot's frame, rad: ahead is 0, left is positive.
import { button, element } from "../shared/dom";

/** ms between pushes while a key or stick is held, and at least between any two. */
const AGAIN = 500;
const LEAST = 150;
/** Share of a stick's way that counts, and rad that make another push. */
const DEAD = 0.5;
const OTHER = 0.35;
const KEYS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowUp: [1, 0],
  ArrowDown: [-1, 0],
  ArrowLeft: [0, 1],
  ArrowRight: [0, -1],
};

export class Steering {
  readonly root = element("div");
  /** Where the pad is held, rad, or null. */
  private pad: number | null = null;
  private readonly held = new Set<string>();
  private last: { at: number; direction: number } | null = null;
  /** Sticks of a headset's controllers: right and down positive. */
  sticks: () => readonly (readonly [number, number])[] = () => [];

  constructor(private readonly push: (direction: number) => void) {
    this.root.id = "pad";
    this.root.setAttribute("role", "group");
    this.root.setAttribute("aria-label", "Steer: push the robot in a direction");
    const names = [["▲", "ahead", 0], ["◀", "left", Math.PI / 2], ["▶", "right", -Math.PI / 2], ["▼", "back", Math.PI]] as const;
    for (const [sign, name, direction] of names) {
      const made = button(sign, `Push ${name} (arrow key)`, () => undefined);
      made.setAttribute("aria-label", `Push ${name}`);
      made.className = name;
      // A pointer's press is read by the pad; a key's or a screen reader's has no place.
      made.addEventListener("click", (event) => { if (event.detail === 0) this.give(direction, performance.now()); });
      this.root.append(made);
    }
    const follow = (event: PointerEvent): void => {
      const box = this.root.getBoundingClientRect();
      const [x, y] = [event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2];
      if (Math.hypot(x, y) > 0.12 * box.width) this.pad = Math.atan2(-x, -y);
    };
    this.root.addEventListener("pointerdown", (event) => {
      this.root.setPointerCapture(event.pointerId);
      follow(event);
    });
    this.root.addEventListener("pointermove", (event) => { if (event.buttons > 0) follow(event); });
    for (const end of ["pointerup", "pointercancel"] as const) {
      this.root.addEventListener(end, () => {
        if (this.pad !== null && this.last?.direction !== this.pad) this.give(this.pad, performance.now());
        this.pad = null;
      });
    }
    window.addEventListener("keyup", ({ key }) => { this.held.delete(key); });
    window.addEventListener("blur", () => { this.held.clear(); });
  }

  /** Takes a key that is pressed; returns whether it steers. */
  key(key: string): boolean {
    if (!(key in KEYS)) return false;
    this.held.add(key);
    return true;
  }

  /** Reads keys and sticks, and pushes. */
  poll(now: number): void {
    const direction = this.direction();
    if (direction === null) {
      this.last = null;
      return;
    }
    const since = this.last === null ? Infinity : now - this.last.at;
    const changed = this.last === null || Math.abs(Math.atan2(Math.sin(direction - this.last.direction), Math.cos(direction - this.last.direction))) > OTHER;
    if (since >= AGAIN || (changed && since >= LEAST)) this.give(direction, now);
  }

  private give(direction: number, now: number): void {
    this.last = { at: now, direction };
    this.push(direction);
  }

  private direction(): number | null {
    if (this.pad !== null) return this.pad;
    let [ahead, left] = [0, 0];
    for (const key of this.held) {
      ahead += KEYS[key]![0];
      left += KEYS[key]![1];
    }
    const pads = [...navigator.getGamepads()].filter((pad) => pad !== null);
    for (const [x, y] of [...pads.map((pad): [number, number] => [pad.axes[0] ?? 0, pad.axes[1] ?? 0]), ...this.sticks()]) {
      if (Math.hypot(x, y) > DEAD) [ahead, left] = [ahead - y, left - x];
    }
    return ahead === 0 && left === 0 ? null : Math.atan2(left, ahead);
  }
}
