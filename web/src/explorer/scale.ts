// Scale of an axis: positions of values, and ticks.
import { ROUNDING } from "./numbers";
import type { Column } from "./payload";
import type { Bound } from "./selection";

const NEAR_END = 2; // pixels from the end of an axis within which a brush leaves this end open

export function isEqual({ low, high }: Column): boolean {
  return !(high - low > ROUNDING * Math.max(Math.abs(low), Math.abs(high)));
}

/** Map from values of a column to positions on an axis, 0 at its beginning and 1 at its end, and back. */
export class Scale {
  private readonly from: number;
  private readonly span: number;
  readonly equal: boolean;

  constructor(
    readonly column: Column,
    readonly log: boolean,
    readonly flipped: boolean,
  ) {
    this.equal = isEqual(column);
    this.from = log ? Math.log(column.low) : column.low;
    this.span = (log ? Math.log(column.high) : column.high) - this.from;
  }

  /** Position of a value; the middle if all values are equal. */
  place(value: number): number {
    if (this.equal) return 0.5;
    const place = ((this.log ? Math.log(value) : value) - this.from) / this.span;
    return this.flipped ? 1 - place : place;
  }

  value(place: number): number {
    if (this.equal) return this.column.low;
    const inner = this.from + (this.flipped ? 1 - place : place) * this.span;
    return this.log ? Math.exp(inner) : inner;
  }

  /**
   * What a brush between two places means on an axis of so many pixels; null where it takes in all.
   *
   * Pixels are coarser than values: whole steps that the brush comes near to belong to it, other ends are rounded
   * outwards to a number as short as a pixel allows, and an end at the end of the axis is open.
   */
  bound(a: number, b: number, pixels: number): Bound | null {
    if (this.equal) return null;
    const [first, last] = [Math.max(Math.min(a, b), 0), Math.min(Math.max(a, b), 1)];
    const near = NEAR_END / pixels;
    const [lowEnd, highEnd] = this.flipped ? [last, first] : [first, last];
    const open = (place: number, end: number): boolean => Math.abs(place - (this.flipped ? 1 - end : end)) <= near;
    const low = open(lowEnd, 0) ? -Infinity : this.snapped(lowEnd, -near);
    const high = open(highEnd, 1) ? Infinity : this.snapped(highEnd, near);
    if (low === -Infinity && high === Infinity) return null;
    if (low <= high) return { low, high };
    const { quantum } = this.column; // between two steps: take the nearest
    const middle = Math.round(this.value((first + last) / 2) / quantum) * quantum;
    return { low: middle, high: middle };
  }

  private snapped(place: number, outwards: number): number {
    const { quantum } = this.column;
    const way = this.flipped ? -outwards : outwards;
    const value = this.value(place);
    const beyond = this.value(place + way);
    const round = outwards > 0 ? Math.floor : Math.ceil;
    if (quantum > Math.abs(beyond - value)) return tidy(round(beyond / quantum) * quantum);
    const step = 10 ** Math.floor(Math.log10(Math.abs(beyond - value)));
    return tidy((outwards > 0 ? Math.ceil : Math.floor)(value / step) * step);
  }

  /** At most so many ticks on round numbers. */
  ticks(most: number): number[] {
    const { low, high, counts } = this.column;
    if (this.equal) return []; // equal values: both ends of the axis show the value
    return this.log ? logTicks(low, high, most) : niceTicks(low, high, most, counts);
  }
}

/** Removes rounding errors in the last digits: 0.30000000000000004 is 0.3. */
function tidy(value: number): number {
  return Number(value.toPrecision(12));
}

/** Multiples of 1, 2 or 5 times a power of ten; whole numbers where asked. */
export function niceTicks(low: number, high: number, most: number, whole = false): number[] {
  const rough = (high - low) / Math.max(most, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = Math.max(power * ([1, 2, 5, 10].find((f) => power * f >= rough * (1 - 1e-9)) ?? 10), whole ? 1 : 0);
  const ticks: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) ticks.push(tidy(k * step));
  return ticks;
}

/** Powers of ten, with 2 and 5 times them where there are few. */
function logTicks(low: number, high: number, most: number): number[] {
  const decades = Math.log10(high) - Math.log10(low); // a quotient may overflow
  if (decades < 1) return niceTicks(low, high, most);
  const factors = decades * 3 <= most ? [1, 2, 5] : [1];
  const every = Math.max(1, Math.ceil(decades / most));
  const ticks: number[] = [];
  for (let k = Math.floor(Math.log10(low)); k <= Math.ceil(Math.log10(high)); k++) {
    if (factors.length === 1 && k % every !== 0) continue;
    for (const factor of factors) ticks.push(tidy(factor * 10 ** k));
  }
  return ticks.filter((tick) => tick >= low * (1 - 1e-9) && tick <= high * (1 + 1e-9));
}
