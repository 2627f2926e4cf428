// Comparison of pins A, B and C and the row under the mouse: values, and differences from the first pin.
import { button, headOf, make, panel } from "./dom";
import { count, signed, text, unit } from "./numbers";
import type { State } from "./state";
import { GROUP_COLOURS, PIN_COLOURS, PIN_DASHES, PIN_NAMES } from "./theme";
import type { View } from "./view";

export function pinsPanel(state: State): View {
  const table = make("table", "card");
  const help = make("p", "hint");
  const element = panel("pins", "Compare", help, make("div", "card-scroll", [table]));
  headOf(element).append(make("span", "hint", "pins A, B, C; \u0394 is the difference from the first"));

  function drawOverlay(): void {
    const { pins, focus, model } = state;
    const placed = state.pinned;
    const looked = focus !== null && !pins.includes(focus) ? focus : null;
    const { wished } = state;
    const wish = wished !== null && !pins.includes(wished) && wished !== looked ? wished : null;
    const rows = [...placed.map(({ row }) => row), ...[wish, looked].filter((row) => row !== null)];
    help.hidden = rows.length > 0;
    help.textContent = model.n === 0 ? "There is nothing to compare." : "Click a line, a point, a path or a row of the table to pin it here; up to three.";
    table.hidden = rows.length === 0;
    if (rows.length === 0) return;
    const heads = placed.map(({ row, pin }) => pinHead(row, pin));
    if (wish !== null) heads.push(make("th", "wished", [make("span", "", "nearest"), make("span", "", `row ${count(wish)}`), nameOf(wish)], { scope: "col" }));
    if (looked !== null) heads.push(make("th", "looked", [make("span", "", looked === wished ? "nearest" : "here"), make("span", "", `row ${count(looked)}`), nameOf(looked)], { scope: "col" }));
    const lines = state.order.map((index) => {
      const column = state.column(index);
      const name = make("th", "", column.name + (unit(column) && ` (${unit(column)})`), { scope: "row", title: column.label });
      name.style.borderLeftColor = GROUP_COLOURS[column.group];
      const cells = rows.map((row, i) => {
        const value = column.values[row]!;
        const cell = make("td", "", text(column, value), { title: String(value) });
        const first = placed[0];
        if (first === undefined || i === 0) return cell;
        const difference = value - column.values[first.row]!;
        const way = Math.abs(difference) <= column.quantum / 2 || difference === 0 ? "same" : difference < 0 ? "less" : "more";
        cell.append(make("span", `delta ${way}`, way === "same" ? "=" : signed(column, difference)));
        return cell;
      });
      return make("tr", column.reported ? "reported" : "", [name, ...cells]);
    });
    table.replaceChildren(
      make("thead", "", [make("tr", "", [make("td"), ...heads])]),
      make("tbody", "", lines),
    );
  }

  function pinHead(row: number, pin: number): HTMLElement {
    const letter = PIN_NAMES[pin]!;
    const chip = make("span", "chip", letter);
    chip.style.background = PIN_COLOURS[pin]!;
    const dash = make("span", "dash");
    dash.style.borderTop = `3px ${["solid", "dashed", "dotted"][PIN_DASHES.indexOf(PIN_DASHES[pin]!)]!} ${PIN_COLOURS[pin]!}`;
    const off = button("\u00d7", `unpin ${letter}`, () => { state.unpin(pin); });
    return make("th", "", [make("span", "pin-line", [chip, dash, off]), make("span", "", `row ${count(row)}`), nameOf(row)], { scope: "col" });
  }

  function nameOf(row: number): HTMLElement {
    const name = state.model.marks.find((mark) => mark.row === row)?.names.join(", ") ?? "";
    return make("span", "row-name", name, { title: name });
  }

  return { element, renew: () => undefined, resize: () => undefined, drawBase: () => undefined, drawOverlay };
}
