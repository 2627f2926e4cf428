// Distance of two convex bodies as a lower and an upper bound: the algorithm of hpop/models/serial_arm/gjk.py, which says
// where it comes from. The support plane of each step gives the lower bound, which holds whatever the simplex is.
import type { Vector } from "../ride/model";
import type { Body } from "./model";

const STEPS = 128;
/** Share of the size of a simplex: one nearer than that to the origin contains it. */
const TOUCHING = 1e-14;

/** Rows of a pose (3, 4), one after the other. */
export type Flat = Float64Array;
type Corner = [number, number, number];
/** The nearest point, and which corners span it: bit i for corner i. */
type Nearest = [number, number, number, number];

/** A body with its points in one array. */
export class Support {
  private readonly points: Float64Array;
  readonly ball: number;

  constructor(private readonly body: Body) {
    this.points = Float64Array.from(body.points.flat());
    this.ball = body.ball;
  }

  /** The point farthest in a direction; the ball's radius is not added. */
  at(x: number, y: number, z: number): Corner {
    const { points } = this;
    let [best, at] = [-Infinity, 0];
    for (let i = 0; i < points.length; i += 3) {
      const along = points[i]! * x + points[i + 1]! * y + points[i + 2]! * z;
      if (along > best) [best, at] = [along, i];
    }
    const found: Corner = [points[at]!, points[at + 1]!, points[at + 2]!];
    const { disc, plane } = this.body;
    if (disc > 0) {
      const [u, v] = plane.map((axis) => axis[0] * x + axis[1] * y + axis[2] * z) as [number, number];
      const across = Math.hypot(u, v);
      if (across > 0) {
        for (const k of [0, 1, 2] as const) found[k] += (disc * (u * plane[0][k] + v * plane[1][k])) / across;
      }
    }
    return found;
  }
}

const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const less = (a: Vector, b: Vector): Corner => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a: Vector, b: Vector): Corner => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function onSegment(simplex: readonly Corner[], i: number, j: number): Nearest {
  const a = simplex[i]!;
  const d = less(simplex[j]!, a);
  const [square, along] = [dot(d, d), -dot(a, d)];
  if (along <= 0) return [...a, 1 << i];
  if (along >= square) return [...simplex[j]!, 1 << j];
  const share = along / square;
  return [a[0] + share * d[0], a[1] + share * d[1], a[2] + share * d[2], (1 << i) | (1 << j)];
}

function onTriangle(simplex: readonly Corner[], i: number, j: number, k: number): Nearest {
  const [a, b, c] = [simplex[i]!, simplex[j]!, simplex[k]!];
  const [u, v] = [less(b, a), less(c, a)];
  const [ua, va] = [-dot(u, a), -dot(v, a)];
  if (ua <= 0 && va <= 0) return [...a, 1 << i];
  const [ub, vb] = [-dot(u, b), -dot(v, b)];
  if (ub >= 0 && vb <= ub) return [...b, 1 << j];
  if (ua * vb - ub * va <= 0 && ua >= 0 && ub <= 0) return onSegment(simplex, i, j);
  const [uc, vc] = [-dot(u, c), -dot(v, c)];
  if (vc >= 0 && uc <= vc) return [...c, 1 << k];
  if (uc * va - ua * vc <= 0 && va >= 0 && vc <= 0) return onSegment(simplex, i, k);
  if (ub * vc - uc * vb <= 0 && vb >= ub && uc >= vc) return onSegment(simplex, j, k);
  const n = cross(u, v);
  const square = dot(n, n);
  if (square === 0) return onSegment(simplex, j, k);
  const share = dot(n, a) / square;
  return [share * n[0], share * n[1], share * n[2], (1 << i) | (1 << j) | (1 << k)];
}

/** Whether the origin and the opposite corner are on different sides of a face; also true if it is too flat to tell. */
function isBeyond(simplex: readonly Corner[], i: number, j: number, k: number, opposite: number): boolean {
  const a = simplex[i]!;
  const n = cross(less(simplex[j]!, a), less(simplex[k]!, a));
  const d = less(simplex[opposite]!, a);
  const height = dot(n, d);
  return height * height <= 1e-24 * dot(n, n) * dot(d, d) || height * -dot(n, a) < 0;
}

function onSimplex(simplex: readonly Corner[]): Nearest {
  if (simplex.length === 1) return [...simplex[0]!, 1];
  if (simplex.length === 2) return onSegment(simplex, 0, 1);
  if (simplex.length === 3) return onTriangle(simplex, 0, 1, 2);
  let [found, least]: [Nearest, number] = [[0, 0, 0, 15], Infinity];
  for (let opposite = 0; opposite < 4; opposite++) {
    const [i, j, k] = [(opposite + 1) & 3, (opposite + 2) & 3, (opposite + 3) & 3];
    if (!isBeyond(simplex, i, j, k, opposite)) continue;
    const point = onTriangle(simplex, i, j, k);
    const square = point[0] ** 2 + point[1] ** 2 + point[2] ** 2;
    if (square < least) [found, least] = [point, square];
  }
  return found;
}

/**
 * Bounds of the distance of two bodies, m. `pose` is that of the frame of b in the frame of a. The search stops when the
 * lower bound has reached `enough`, or when the bounds differ by at most the share `gap` of the upper one.
 */
export function distance(a: Support, b: Support, pose: Flat, from: Vector, enough: number, gap: number): [number, number] {
  const margin = a.ball + b.ball;
  let [x, y, z] = from;
  if (!(x * x + y * y + z * z > 0)) [x, y, z] = [1, 0, 0];
  let length = Math.hypot(x, y, z);
  let [lower, upper] = [0, Infinity];
  let simplex: Corner[] = [];
  const p = (i: number): number => pose[i]!;
  for (let step = 0; step < STEPS; step++) {
    const [ax, ay, az] = a.at(-x, -y, -z);
    const [bx, by, bz] = b.at(p(0) * x + p(4) * y + p(8) * z, p(1) * x + p(5) * y + p(9) * z, p(2) * x + p(6) * y + p(10) * z);
    const w: Corner = [
      ax - (p(0) * bx + p(1) * by + p(2) * bz + p(3)),
      ay - (p(4) * bx + p(5) * by + p(6) * bz + p(7)),
      az - (p(8) * bx + p(9) * by + p(10) * bz + p(11)),
    ];
    const below = (x * w[0] + y * w[1] + z * w[2]) / length - margin;
    const risen = below > lower;
    lower = Math.max(lower, below);
    if (lower >= enough || (simplex.length > 0 && upper - lower <= gap * upper)) break;
    if (simplex.some((c) => c[0] === w[0] && c[1] === w[1] && c[2] === w[2])) break;
    simplex.push(w);
    const largest = Math.max(...simplex.map((c) => Math.abs(c[0]) + Math.abs(c[1]) + Math.abs(c[2])));
    const nearest = onSimplex(simplex);
    [x, y, z] = nearest;
    simplex = simplex.filter((_, i) => (nearest[3] >> i) & 1);
    length = Math.hypot(x, y, z);
    if (simplex.length === 4 || length <= TOUCHING * largest) {
      upper = 0;
      break;
    }
    if (!(length - margin < upper || risen)) break; // neither bound improves: the numbers allow no more precision
    upper = Math.min(upper, Math.max(0, length - margin));
  }
  return [lower, upper];
}
