// The selected rows: those of the kept rows that are within all bounds.
import { evenRound, ROUNDING } from "./numbers";
import type { Model } from "./payload";

/** Both ends belong to it; an end may be infinite. */
export interface Bound {
  readonly low: number;
  readonly high: number;
}

/** State in the history: bounds by column, and rows kept (1) or excluded (0); null if all are kept. */
export interface Filter {
  readonly bounds: ReadonlyMap<number, Bound>;
  readonly kept: Uint8Array | null;
  /** Order of visits of a tour, such as "2 1 3"; null for any order. */
  readonly order: string | null;
}

export const NO_FILTER: Filter = { bounds: new Map(), kept: null, order: null };

// As in hpop/frontier/choices.py: a bound as a count of quanta is off by its rounding.
const ALIKE = 8 * Number.EPSILON;

/** Limits of a bound, in whole quanta if there is a quantum, as `front.where` compares values. */
function limits(quantum: number, { low, high }: Bound): [number, number] {
  const [least, most] = quantum === 0 ? [low, high] : [low / quantum, high / quantum];
  const slack = (end: number): number => (quantum === 0 ? ROUNDING * Math.abs(end) : ALIKE * Math.max(1, Math.abs(end)));
  return [least - slack(least), most + slack(most)];
}

/** Writes 1 into `into` for each row that is selected, 0 for others, and returns how many are. */
export function select(model: Model, filter: Filter, into: Uint8Array): number {
  if (filter.kept === null) into.fill(1);
  else into.set(filter.kept);
  if (filter.order !== null && model.tour !== null) {
    const wanted = model.tour.orders.indexOf(filter.order);
    for (let row = 0; row < model.n; row++) if (model.tour.order[row] !== wanted) into[row] = 0;
  }
  for (const [index, bound] of filter.bounds) {
    const { values, quantum } = model.columns[index]!;
    const [least, most] = limits(quantum, bound);
    for (let row = 0; row < values.length; row++) {
      const value = quantum === 0 ? values[row]! : evenRound(values[row]! / quantum);
      if (value < least || value > most) into[row] = 0;
    }
  }
  let count = 0;
  for (const one of into) count += one;
  return count;
}
