// List of the trajectories under the mouse, where several overlap on the map; Tab goes to the next one.
import type { Model } from "./payload";

const SHOWN = 4; // most entries shown

export interface Picks {
  readonly element: HTMLElement;
  /** All rows under the pointer, the nearest first; the list is hidden if there are none. */
  readonly rows: readonly number[];
  /** Replaces the rows by those at a pixel of the parent; returns whether they differ. */
  take(rows: readonly number[], at: { x: number; y: number }): boolean;
  /** Goes to the next row, or back. */
  step(by: 1 | -1): void;
  /** The rows in cyclic order, beginning with the current one. */
  turned(most: number): number[];
  draw(model: Model): void;
}

/** Creates the list over the map; `act` is called for an entry that is touched. */
export function picksOver(parent: HTMLElement, act: (row: number) => void): Picks {
  const element = document.createElement("ol");
  element.className = "picks";
  element.hidden = true;
  parent.append(element);
  let rows: readonly number[] = [];
  let place = 0;
  let spot = { x: 0, y: 0 };

  const entry = (model: Model, row: number, current: boolean): HTMLElement => {
    const item = document.createElement("li");
    const names = model.marks.filter((mark) => mark.row === row).flatMap((mark) => mark.names);
    item.textContent = [`row ${row}`, ...names].join(", ");
    item.dataset.row = String(row);
    if (current) item.setAttribute("aria-current", "true");
    item.addEventListener("pointerdown", (event) => { event.stopPropagation(); });
    item.addEventListener("click", () => { act(row); });
    return item;
  };

  return {
    element,
    get rows() {
      return rows;
    },
    take(found, at) {
      const same = found.length === rows.length && found.every((row, i) => row === rows[i]);
      spot = at;
      if (same) return false;
      [rows, place] = [found, 0];
      return true;
    },
    step(by) {
      place = (place + by + rows.length) % Math.max(rows.length, 1);
    },
    turned(most) {
      return Array.from({ length: Math.min(rows.length, most) }, (_, i) => rows[(place + i) % rows.length]!);
    },
    draw(model) {
      element.hidden = rows.length < 2;
      if (element.hidden) return;
      const first = Math.min(Math.max(place - 2, 0), Math.max(rows.length - SHOWN, 0));
      const head = document.createElement("li");
      head.className = "quiet";
      head.textContent = `${place + 1} of ${rows.length.toLocaleString("en-US")} here \u2013 Tab: next`;
      element.replaceChildren(
        head,
        ...rows.slice(first, first + SHOWN).map((row, i) => entry(model, row, first + i === place)),
      );
      // Beside the pointer, on the side that has room.
      const [wide, high] = [parent.clientWidth, parent.clientHeight];
      const left = spot.x > wide / 2 ? spot.x - element.offsetWidth - 14 : spot.x + 14;
      const top = spot.y > high / 2 ? spot.y - element.offsetHeight - 8 : spot.y + 8;
      element.style.left = `${Math.max(0, Math.min(left, wide - element.offsetWidth))}px`;
      element.style.top = `${Math.max(0, Math.min(top, high - element.offsetHeight))}px`;
    },
  };
}
