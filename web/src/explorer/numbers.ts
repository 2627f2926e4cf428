// Numbers as people read and type them.
import type { Column } from "./payload";

const MOST_DECIMALS = 9;

/** Relative size below which a difference is a rounding error, as in hpop/frontier/choosing.py. */
export const ROUNDING = 64 * Number.EPSILON;

/** Rounds a half to the even neighbour, as NumPy does. */
export function evenRound(x: number): number {
  const near = Math.round(x);
  return Math.abs(near - x) === 0.5 && near % 2 !== 0 ? near - 1 : near;
}

/** Number of decimals that resolves a column to a thousandth of its range. */
export function decimals(column: Column): number {
  if (column.counts) return 0;
  const span = column.high - column.low || Math.abs(column.high);
  if (span === 0) return 0;
  return Math.min(Math.max(3 - Math.floor(Math.log10(span) + 1e-9), 0), MOST_DECIMALS);
}

/** A value as text for a table; all values of a column have the same number of decimals. */
export function text(column: Column, value: number): string {
  return plain(value, decimals(column));
}

/** A number with the wanted decimals, or in scientific notation if that has too many digits. */
export function plain(value: number, wanted: number): string {
  const places = Math.min(wanted, MOST_DECIMALS);
  if (value !== 0 && (Math.abs(value) >= 1e7 || Math.abs(value) < 10 ** -places / 2)) return short(value);
  const written = value.toFixed(places);
  return (Number(written) === 0 ? written.replace("-", "") : written).replace("-", "\u2212");
}

/** To four figures: 1.235e+9, 0.001235. */
export function short(value: number): string {
  return String(Number(value.toPrecision(4))).replace("-", "\u2212");
}

/** A difference, with its sign. */
export function signed(column: Column, difference: number): string {
  const written = text(column, difference);
  return difference > 0 ? `+${written}` : written;
}

/** A count of rows: 3,290. */
export function count(n: number): string {
  return n.toLocaleString("en-US");
}

/** The number in a typed text, or null. */
export function parsed(typed: string): number | null {
  const cleaned = typed.trim().replace(/\u2212/g, "-").replace(/(\d),(?=\d{3}(\D|$))/g, "$1");
  const value = Number(cleaned);
  return cleaned !== "" && Number.isFinite(value) ? value : null;
}

/** The unit to write after a number; empty for shares and counts. */
export function unit(column: Column): string {
  return column.unit === "1" ? "" : column.unit;
}

/** A value with its name and unit: "length 33.37 m". */
export function told(column: Column, value: number): string {
  return `${column.name} ${text(column, value)}${unit(column) && ` ${unit(column)}`}`;
}
