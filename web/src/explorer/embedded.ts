// The page within another one, such as a notebook: what is chosen is told to it.
import type { Callbacks } from "./page";

const SOON = 50; // ms in which changes are told together: a brush changes the selection sixty times a second

/** Tells the page around this one which rows are selected, at the focus and pinned. */
export function telling(): Callbacks {
  let chosen: Record<string, unknown> = {};
  let timer: number | null = null;
  const tell = (name: string, value: unknown): void => {
    chosen[name] = value;
    timer ??= window.setTimeout(() => {
      timer = null;
      window.parent.postMessage({ chosen }, "*"); // numbers of rows; who shows the page has them all
      chosen = {};
    }, SOON);
  };
  return {
    selected: (rows) => { tell("selected", rows); },
    hovered: (row) => { tell("hovered", row); },
    pinned: (rows) => { tell("pinned", rows.filter((row) => row !== null)); },
  };
}
