// Keys for moving through the sorted table, pinning, keeping, excluding and undoing; ignored while text is typed.
import type { Actions } from "./header";
import type { State } from "./state";
import { PIN_NAMES } from "./theme";
import type { TableView } from "./table";

export function keyboard(state: State, table: TableView, actions: Actions): (event: KeyboardEvent) => void {
  const go = (steps: number): void => {
    const rows = state.sorted;
    if (rows.length === 0) return;
    const from = state.last === null ? -1 : rows.indexOf(state.last);
    const to = from < 0 ? (steps < 0 ? rows.length - 1 : 0) : from + steps;
    state.hover([rows[Math.min(Math.max(to, 0), rows.length - 1)]!]);
    table.reveal();
  };
  const pinned = (place: number): void => {
    if (state.last !== null) state.pinAt(place, state.last);
  };
  const keys: Readonly<Record<string, () => void>> = {
    ArrowDown: () => { go(1); },
    ArrowUp: () => { go(-1); },
    PageDown: () => { go(table.page); },
    PageUp: () => { go(-table.page); },
    Home: () => { go(-state.count); },
    End: () => { go(state.count); },
    p: () => { if (state.last !== null) state.pin(state.last); },
    k: () => { if (state.isChosen) state.keep("selected"); },
    x: () => { if (state.isChosen) state.keep("others"); },
    0: () => { state.clear(); },
    y: actions.copy,
    "?": actions.help,
    Escape: () => { state.hover([]); },
  };
  return (event) => {
    const target = event.target as HTMLElement;
    const typed = target.closest("input:not([type=range]), select, textarea, dialog") !== null;
    if (typed || event.ctrlKey || event.metaKey) return;
    if (event.altKey) {
      if (event.key === "ArrowLeft") state.back();
      else if (event.key === "ArrowRight") state.forward();
      else return;
      event.preventDefault();
      return;
    }
    if (target.matches("input") && /^(Arrow|Page|Home|End)/.test(event.key)) return; // keys that a slider uses itself
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const place = PIN_NAMES.findIndex((name) => name.toLowerCase() === key);
    const act = place >= 0 ? () => { pinned(place); } : key === "Enter" ? enter(target) : keys[key];
    if (act === undefined) return;
    event.preventDefault();
    act();
  };

  /** Enter presses a focused control; elsewhere it pins the row at the focus. */
  function enter(target: HTMLElement): (() => void) | undefined {
    return target.closest("button, summary, a") === null ? keys.p : undefined;
  }
}
