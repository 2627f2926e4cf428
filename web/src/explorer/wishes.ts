// The rows in the order of their distance to wished values, computed as by `front.nearest` of hpop.
import { evenRound, ROUNDING } from "./numbers";
import type { Column, Model } from "./payload";

// As in hpop/frontier/choosing.py: scaled values that differ by less are tied.
const TIE = 1e-12;

/** Rows, the nearest first: the first row is that of `front.nearest(wishes)`. */
export function ranked(model: Model, wishes: ReadonlyMap<number, number>): Int32Array {
  const distance = new Float64Array(model.n);
  for (const [index, wish] of wishes) {
    const [values, wished] = inSteps(model.columns[index]!, wish);
    addGaps(distance, values, wished);
  }
  for (let row = 0; row < model.n; row++) distance[row] = Math.sqrt(distance[row]!);
  const rest = new Float64Array(model.n);
  for (let index = 0; index < model.criteria; index++) {
    if (!wishes.has(index)) addShares(rest, inSteps(model.columns[index]!, 0)[0]);
  }
  const first = least(distance, rest);
  const rows = Int32Array.from({ length: model.n }, (_, row) => row);
  const before = (a: number, b: number): number => distance[a]! - distance[b]! || rest[a]! - rest[b]! || a - b;
  return rows.sort((a, b) => (a === first ? -1 : b === first ? 1 : before(a, b)));
}

/** Values and a wish in quanta; unchanged for reported values. */
function inSteps(column: Column, wish: number): [Float64Array, number] {
  if (column.quantum === 0) return [column.values, wish];
  return [column.values.map((value) => evenRound(value / column.quantum)), wish / column.quantum];
}

/** Least and greatest value, or null if all values are equal. */
function range(values: Float64Array): [number, number] | null {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return high - low > ROUNDING * Math.max(Math.abs(low), Math.abs(high)) ? [low, high] : null;
}

function addGaps(sums: Float64Array, values: Float64Array, wish: number): void {
  const ends = range(values);
  if (ends === null) return;
  for (let row = 0; row < sums.length; row++) {
    const gap = (values[row]! - wish) / (ends[1] - ends[0]);
    sums[row]! += gap * gap;
  }
}

function addShares(sums: Float64Array, values: Float64Array): void {
  const ends = range(values);
  if (ends === null) return;
  for (let row = 0; row < sums.length; row++) sums[row]! += (values[row]! - ends[0]) / (ends[1] - ends[0]);
}

/** First row with the least first key, ties settled by the second. */
function least(...keys: readonly Float64Array[]): number {
  let rows = Array.from(keys[0]!.keys());
  for (const key of keys) {
    let lowest = Infinity;
    for (const row of rows) lowest = Math.min(lowest, key[row]!);
    rows = rows.filter((row) => key[row]! <= lowest + TIE * Math.max(1, Math.abs(lowest)));
  }
  return rows[0]!;
}
