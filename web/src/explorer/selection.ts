// Which rows are selected: those within all bounds, of those that were kept.
import type { Column, Model } from "./model";

/** Both ends belong to it. */
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

/** Half a step: values equal in whole steps are equal, as hpop compares them; reported ones are compared as they are. */
export function tolerance(column: Column): number {
  return column.quantum / 2;
}

/** Writes 1 into `into` for each row that is selected, 0 for others, and returns how many are. */
export function select(model: Model, filter: Filter, into: Uint8Array): number {
  if (filter.kept === null) into.fill(1);
  else into.set(filter.kept);
  for (const [index, { low, high }] of filter.bounds) {
    const column = model.columns[index]!;
    const [least, most] = [low - tolerance(column), high + tolerance(column)];
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
