// The traced trajectories, and their poses at a time.
import type { Trace } from "./payload";
import type { State } from "./state";
import { PIN_COLOURS, PIN_DASHES, PIN_NAMES, theme } from "./theme";

/** A traced row, and its appearance. */
export interface Traced {
  readonly row: number;
  readonly name: string;
  readonly colour: string;
  readonly dash: readonly number[];
}

/** The pinned rows and the one at the focus; if there are none, the last one at the focus, or the first named row. */
export function tracedRows({ model, pins, focus, last }: State): Traced[] {
  const traced: Traced[] = [];
  pins.forEach((row, i) => {
    if (row !== null) traced.push({ row, name: PIN_NAMES[i]!, colour: PIN_COLOURS[i]!, dash: PIN_DASHES[i]! });
  });
  const row = focus ?? (traced.length > 0 ? null : (last ?? model.marks[0]?.row ?? null));
  if (row !== null && traced.every((one) => one.row !== row)) {
    traced.push({ row, name: "", colour: theme().hover, dash: [] });
  }
  return traced;
}

/** Index (0 .. m - 1) of the piece that contains a time; times outside are in the first or last piece. */
export function pieceAt({ t }: Trace, time: number): number {
  let [low, high] = [0, Math.max(t.length - 2, 0)];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle]! <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Pose of the camera at a time, m, rad, interpolated linearly within a piece. */
export function placeAt(trace: Trace, time: number): { x: number; y: number; yaw: number } {
  const { t, x, y, yaw } = trace;
  const piece = pieceAt(trace, time);
  const next = Math.min(piece + 1, t.length - 1);
  const span = t[next]! - t[piece]!;
  const part = span > 0 ? Math.min(Math.max((time - t[piece]!) / span, 0), 1) : 1;
  const at = (values: Float64Array) => values[piece]! + part * (values[next]! - values[piece]!);
  return { x: at(x), y: at(y), yaw: at(yaw) };
}
