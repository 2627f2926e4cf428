// The robot and the people between two messages: drawn a little late, so that they move evenly.
import type { Vector } from "../ride/model";
import type { State } from "./messages";

/** ms by which the picture is behind: a little more than the time between two messages. */
const BEHIND = 70;
const KEPT = 8;

export class Motion {
  private readonly states: { seen: number; state: State }[] = [];

  add(state: State): void {
    this.states.push({ seen: performance.now(), state });
    if (this.states.length > KEPT) this.states.shift();
  }

  clear(): void {
    this.states.length = 0;
  }

  get latest(): State | null {
    return this.states.at(-1)?.state ?? null;
  }

  /** The robot's pose x, y, yaw, and the people's, at a time of the page; null before the first message. */
  at(now: number): { pose: Vector; people: Vector[] } | null {
    const late = now - BEHIND;
    const after = this.states.findIndex(({ seen }) => seen >= late);
    const b = this.states.at(after < 0 ? -1 : after);
    if (b === undefined) return null;
    const a = this.states[after - 1] ?? b;
    const share = b.seen > a.seen && after > 0 ? Math.min(Math.max((late - a.seen) / (b.seen - a.seen), 0), 1) : 1;
    const mixed = (from: number, to: number): number => from + share * (to - from);
    const { x, y, theta } = a.state;
    return {
      pose: [mixed(x, b.state.x), mixed(y, b.state.y), theta + share * turned(b.state.theta - theta)],
      people: b.state.people.map((person, i): Vector => {
        const [px = 0, py = 0, vx = 0, vy = 0] = person;
        const before = a.state.people.length === b.state.people.length ? a.state.people[i]! : person;
        const yaw = Math.hypot(vx, vy) > 0.02 ? Math.atan2(vy, vx) : (this.yaws[i] ?? 0);
        this.yaws[i] = yaw;
        return [mixed(before[0] ?? px, px), mixed(before[1] ?? py, py), yaw];
      }),
    };
  }

  private readonly yaws: number[] = [];
}

/** The angle between -pi and pi. */
export function turned(angle: number): number {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}
