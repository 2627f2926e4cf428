// The page inside another one, such as a notebook, which receives messages about the selection.
import type { Callbacks } from "./page";

const SOON = 50; // ms between messages: a brush changes the selection sixty times a second

/** Callbacks that send the selected, focused and pinned rows to the surrounding page. */
export function telling(): Callbacks {
  let chosen: Record<string, unknown> = {};
  let timer: number | null = null;
  const tell = (name: string, value: unknown): void => {
    chosen[name] = value;
    timer ??= window.setTimeout(() => {
      timer = null;
      window.parent.postMessage({ chosen }, "*"); // row numbers only: the surrounding page has the front
      chosen = {};
    }, SOON);
  };
  return {
    selected: (rows) => { tell("selected", rows); },
    hovered: (row) => { tell("hovered", row); },
    pinned: (rows) => { tell("pinned", rows.filter((row) => row !== null)); },
  };
}
