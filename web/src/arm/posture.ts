// Where the bodies of an arm are at values of its joints, and which of them are too near to each other.
import type { Vector } from "../ride/model";
import { type Flat, Support, distance } from "./gjk";
import type { Arm, Body, Mount } from "./model";

/** Precision of the distance that the page states, as a share. */
const GAP = 1e-4;
/** Tolerance of limits, rad or m, as in hpop. */
const LIMIT = 1e-9;

/** Two bodies, and their distance, m. */
export interface Near {
  readonly one: Body;
  readonly other: Body;
  readonly apart: number;
}

export interface Verdict {
  /** Bodies that touch or come too near; each pair of names once. */
  readonly collisions: readonly Near[];
  /** The link and the obstacle with the least distance, if no pair is too near. */
  readonly nearest: Near | null;
  /** Joints beyond their limits. */
  readonly beyond: readonly string[];
  /** Angle, rad, of an axis that must be kept, if it is not. */
  readonly tilted: number | null;
}

function flat(pose: readonly (readonly number[])[]): Flat {
  return Float64Array.from(pose.flat());
}

/** The product of two poses. */
export function times(a: Flat, b: Flat): Flat {
  const made = new Float64Array(12);
  for (const row of [0, 4, 8]) {
    for (let column = 0; column < 4; column++) {
      made[row + column] = a[row]! * b[column]! + a[row + 1]! * b[4 + column]! + a[row + 2]! * b[8 + column]!;
    }
    made[row + 3]! += a[row + 3]!;
  }
  return made;
}

/** The pose of b in the frame of a. */
function relative(a: Flat, b: Flat): Flat {
  const made = new Float64Array(12);
  for (let row = 0; row < 3; row++) {
    const [x, y, z] = [a[row]!, a[4 + row]!, a[8 + row]!];
    for (let column = 0; column < 4; column++) made[4 * row + column] = x * b[column]! + y * b[4 + column]! + z * b[8 + column]!;
    made[4 * row + 3]! -= x * a[3]! + y * a[7]! + z * a[11]!;
  }
  return made;
}

function placed(pose: Flat, [x, y, z]: Vector): [number, number, number] {
  return [0, 4, 8].map((r) => pose[r]! * x + pose[r + 1]! * y + pose[r + 2]! * z + pose[r + 3]!) as [number, number, number];
}

export class Posture {
  readonly values: number[];
  /** Poses of the frames in the world. */
  frames: Flat[] = [];
  private readonly origins: Flat[];
  private readonly supports: Support[];

  constructor(readonly arm: Arm) {
    this.origins = arm.origins.map(flat);
    this.supports = arm.bodies.map((body) => new Support(body));
    this.values = arm.joints.map(() => 0);
    this.set(arm.states[0]?.values ?? this.values);
  }

  /** Moves the joints to values, rad or m. */
  set(values: readonly number[]): void {
    this.frames = [Float64Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)];
    this.arm.joints.forEach((joint, k) => {
      const value = (this.values[k] = values[k] ?? 0);
      const [c, s] = joint.sliding ? [1, 0] : [Math.cos(value), Math.sin(value)];
      const base = times(this.frames[this.arm.parents[k]!]!, this.origins[k]!);
      this.frames.push(times(base, Float64Array.of(c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, joint.sliding ? value : 0)));
    });
  }

  /** Pose of something on the arm in the world. */
  pose({ frame, pose }: Mount): Flat {
    return times(this.frames[frame]!, flat(pose));
  }

  judge(): Verdict {
    const { arm } = this;
    const centres = arm.bodies.map((body) => placed(this.frames[body.frame]!, body.centre));
    const bounds = arm.pairs.map(([a, b], pair) => {
      const [p, q] = [centres[a]!, centres[b]!];
      return { pair, bound: Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]) - arm.bodies[a]!.reach - arm.bodies[b]!.reach };
    });
    bounds.sort((one, other) => one.bound - other.bound);
    const collisions = new Map<string, Near>();
    let nearest: Near | null = null;
    for (const { pair, bound } of bounds) {
      const [a, b] = arm.pairs[pair]!;
      const [one, other] = [arm.bodies[a]!, arm.bodies[b]!];
      const outer = !(one.link && other.link);
      const least = Math.max(arm.kept_distance, outer ? (nearest?.apart ?? Infinity) : 0);
      if (bound >= least) continue;
      const first = this.frames[one.frame]!;
      const [p, q] = [centres[a]!, centres[b]!];
      const d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]] as const;
      const from = [0, 1, 2].map((i) => first[i]! * d[0] + first[4 + i]! * d[1] + first[8 + i]! * d[2]) as unknown as Vector;
      const pose = relative(first, this.frames[other.frame]!);
      const [lower, upper] = distance(this.supports[a]!, this.supports[b]!, pose, from, least, GAP);
      if (lower < arm.kept_distance) {
        const key = JSON.stringify([other.name, one.name]);
        if (upper < (collisions.get(key)?.apart ?? Infinity)) collisions.set(key, { one: other, other: one, apart: upper });
      } else if (outer && upper < (nearest?.apart ?? Infinity)) {
        nearest = { one: other, other: one, apart: upper };
      }
    }
    const beyond = arm.joints.filter(({ turning, low, high }, k) => {
      const value = this.values[k]!;
      return !turning && !(value >= low - LIMIT && value <= high + LIMIT);
    });
    return {
      collisions: [...collisions.values()],
      nearest: collisions.size > 0 ? null : nearest,
      beyond: beyond.map(({ name }) => name),
      tilted: this.tilt(),
    };
  }

  private tilt(): number | null {
    const { kept } = this.arm;
    if (kept === null) return null;
    const pose = this.pose(kept);
    const [axis, zero] = [placed(pose, kept.axis), placed(pose, [0, 0, 0])];
    const along = axis.reduce((sum, value, i) => sum + (value - zero[i]!) * kept.direction[i]!, 0);
    const angle = Math.acos(Math.min(Math.max(along, -1), 1));
    return angle >= kept.angle[0] - LIMIT && angle <= kept.angle[1] + LIMIT ? null : angle;
  }
}
