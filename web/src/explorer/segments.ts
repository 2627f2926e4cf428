// The distinct straight segments of all paths. Paths on a lattice share most of their segments, so that a map draws
// and searches hundreds of segments instead of thousands of paths.
import type { Paths } from "./payload";

/** Lists of numbers in one array: those of i are items[offsets[i]] .. items[offsets[i + 1] - 1]. */
export interface Lists {
  readonly offsets: Uint32Array;
  readonly items: Uint32Array;
}

export interface Segments {
  readonly count: number;
  /** (count,) m: from (x0, y0) to (x1, y1), as first met. */
  readonly x0: Float64Array;
  readonly y0: Float64Array;
  readonly x1: Float64Array;
  readonly y1: Float64Array;
  /** The rows that use each segment, in order, each once. */
  readonly rows: Lists;
}

/** The distinct segments of paths, in either direction; turns in place have none. */
export function segmentsOf({ offsets, point, points, x, y }: Paths): Segments {
  const known = new Map<number, number>();
  const ends: number[] = []; // the ends of each segment, indices in x and y
  const latest: number[] = []; // the last row that used each segment, so that a row is counted once
  const used: number[] = []; // segment and row, pair by pair
  for (let row = 0; row + 1 < offsets.length; row++) {
    for (let at = offsets[row]! + 1; at < offsets[row + 1]!; at++) {
      const [tail, head] = [point[at - 1]!, point[at]!];
      if (tail === head) continue;
      const key = Math.min(tail, head) * points + Math.max(tail, head);
      let segment = known.get(key);
      if (segment === undefined) {
        segment = latest.length;
        known.set(key, segment);
        ends.push(at - 1, at);
        latest.push(-1);
      }
      if (latest[segment] === row) continue;
      latest[segment] = row;
      used.push(segment, row);
    }
  }
  const count = latest.length;
  const of = (values: Float64Array, end: 0 | 1) =>
    Float64Array.from({ length: count }, (_, segment) => values[ends[2 * segment + end]!]!);
  return { count, x0: of(x, 0), y0: of(y, 0), x1: of(x, 1), y1: of(y, 1), rows: listsOf(count, used) };
}

/** Lists of `count` keys, from pairs (key, item) one after the other; the order of pairs is kept. */
export function listsOf(count: number, pairs: readonly number[]): Lists {
  const offsets = new Uint32Array(count + 1);
  for (let at = 0; at < pairs.length; at += 2) offsets[pairs[at]! + 1]! += 1;
  for (let key = 0; key < count; key++) offsets[key + 1]! += offsets[key]!;
  const next = offsets.slice();
  const items = new Uint32Array(pairs.length / 2);
  for (let at = 0; at < pairs.length; at += 2) items[next[pairs[at]!]!++] = pairs[at + 1]!;
  return { offsets, items };
}

/** (count,) Number of selected rows that use each segment. `selected` is (n,), 1 for selected rows. */
export function usersOf({ count, rows }: Segments, selected: Uint8Array): Uint32Array {
  const users = new Uint32Array(count);
  for (let segment = 0; segment < count; segment++) {
    let sum = 0;
    for (let at = rows.offsets[segment]!; at < rows.offsets[segment + 1]!; at++) sum += selected[rows.items[at]!]!;
    users[segment] = sum;
  }
  return users;
}

/** Distance from a point to a segment. */
function distanceTo(x: number, y: number, x0: number, y0: number, x1: number, y1: number): number {
  const dx = x1 - x0;
  const dy = y1 - y0;
  const square = dx * dx + dy * dy;
  const part = square > 0 ? Math.min(Math.max(((x - x0) * dx + (y - y0) * dy) / square, 0), 1) : 0;
  return Math.hypot(x - x0 - part * dx, y - y0 - part * dy);
}

const CELLS = 96; // cells along the longer side

/** Finds segments near a point: a grid of cells, each with the segments that pass it. */
export class SegmentGrid {
  private readonly low: readonly [number, number];
  private readonly cell: number;
  private readonly columns: number;
  private readonly rows: number;
  private readonly lists: Lists;

  constructor(private readonly segments: Segments) {
    const { count, x0, y0, x1, y1 } = segments;
    let [xMin, yMin, xMax, yMax] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let s = 0; s < count; s++) {
      xMin = Math.min(xMin, x0[s]!, x1[s]!);
      yMin = Math.min(yMin, y0[s]!, y1[s]!);
      xMax = Math.max(xMax, x0[s]!, x1[s]!);
      yMax = Math.max(yMax, y0[s]!, y1[s]!);
    }
    this.low = count ? [xMin, yMin] : [0, 0];
    this.cell = (count ? Math.max(xMax - xMin, yMax - yMin) : 0) / CELLS || 1;
    this.columns = count ? Math.floor((xMax - xMin) / this.cell) + 1 : 1;
    this.rows = count ? Math.floor((yMax - yMin) / this.cell) + 1 : 1;
    const pairs: number[] = [];
    for (let s = 0; s < count; s++) this.walk(s, (cell) => pairs.push(cell, s));
    this.lists = listsOf(this.columns * this.rows, pairs);
  }

  /** Segments within `reach` (m) of a point, the nearest first. */
  near(x: number, y: number, reach: number): number[] {
    const { x0, y0, x1, y1 } = this.segments;
    const found = new Map<number, number>();
    const [left, below] = [this.columnOf(x - reach), this.rowOf(y - reach)];
    const [right, above] = [this.columnOf(x + reach), this.rowOf(y + reach)];
    for (let j = below; j <= above; j++) {
      for (let i = left; i <= right; i++) {
        const cell = j * this.columns + i;
        for (let at = this.lists.offsets[cell]!; at < this.lists.offsets[cell + 1]!; at++) {
          const s = this.lists.items[at]!;
          const distance = distanceTo(x, y, x0[s]!, y0[s]!, x1[s]!, y1[s]!);
          if (distance <= reach) found.set(s, distance);
        }
      }
    }
    return [...found].sort(([s, a], [r, b]) => a - b || s - r).map(([segment]) => segment);
  }

  private columnOf(x: number): number {
    return Math.min(Math.max(Math.floor((x - this.low[0]) / this.cell), 0), this.columns - 1);
  }

  private rowOf(y: number): number {
    return Math.min(Math.max(Math.floor((y - this.low[1]) / this.cell), 0), this.rows - 1);
  }

  /** Visits the cells that a segment passes: in each column of cells, those between its heights at both sides. */
  private walk(s: number, visit: (cell: number) => void): void {
    const { x0, y0, x1, y1 } = this.segments;
    const [a, b] = x0[s]! <= x1[s]! ? [0, 1] : [1, 0];
    const xs = [x0[s]!, x1[s]!];
    const ys = [y0[s]!, y1[s]!];
    const slope = xs[b]! > xs[a]! ? (ys[b]! - ys[a]!) / (xs[b]! - xs[a]!) : 0;
    const first = this.columnOf(xs[a]!);
    const last = this.columnOf(xs[b]!);
    for (let i = first; i <= last; i++) {
      const from = i === first ? ys[a]! : ys[a]! + slope * (this.low[0] + i * this.cell - xs[a]!);
      const to = i === last ? ys[b]! : ys[a]! + slope * (this.low[0] + (i + 1) * this.cell - xs[a]!);
      const top = this.rowOf(Math.max(from, to));
      for (let j = this.rowOf(Math.min(from, to)); j <= top; j++) visit(j * this.columns + i);
    }
  }
}
