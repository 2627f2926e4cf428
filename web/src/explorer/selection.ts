// Which rows are selected: those within all bounds, of those that were kept.
import type { Column, Model } from "./payload";

/** Both ends belong to it; an end may be infinite. */
export interface Bound {
  readonly low: number;
  readonly high: number;
}

/** What a history remembers: bounds by column, and the rows kept (1) or excluded (0), all of them if null. */
export interface Filter {
  readonly bounds: ReadonlyMap<number, Bound>;
  readonly kept: Uint8Array | null;
}

export const NO_FILTER: Filter = { bounds: new Map(), kept: null };

// As in hpop/frontier/conditions.py: a bound as a count of quanta is off by its rounding.
const ALIKE = 8 * Number.EPSILON;

/** The least and the greatest value within a bound: costs are compared in whole steps, as `front.where` compares them. */
export function limits({ quantum }: Column, { low, high }: Bound): [number, number] {
  if (quantum === 0) return [low - ALIKE * Math.abs(low), high + ALIKE * Math.abs(high)];
  const [least, most] = [low / quantum, high / quantum];
  return [
    Number.isFinite(low) ? (Math.ceil(least - ALIKE * Math.abs(least)) - 0.5) * quantum : low,
    Number.isFinite(high) ? (Math.floor(most + ALIKE * Math.abs(most)) + 0.5) * quantum : high,
  ];
}

/** Writes 1 into `into` for each row that is selected, 0 for others, and returns how many are. */
export function select(model: Model, filter: Filter, into: Uint8Array): number {
  if (filter.kept === null) into.fill(1);
  else into.set(filter.kept);
  for (const [index, bound] of filter.bounds) {
    const column = model.columns[index]!;
    const [least, most] = limits(column, bound);
    const values = column.values;
    for (let row = 0; row < values.length; row++) {
      const value = values[row]!;
      if (value < least || value > most) into[row] = 0;
    }
  }
  let count = 0;
  for (const one of into) count += one;
  return count;
}
