// Wishes: a slider and a number for each column; rows are ranked by their distance to all wished values.
import { button, headOf, make, panel } from "./dom";
import { count, decimals, parsed, text, unit } from "./numbers";
import { isEqual } from "./scale";
import type { State } from "./state";
import { GROUP_COLOURS } from "./theme";
import type { View } from "./view";

const STEPS = 1000; // steps of a slider

interface Row {
  readonly index: number;
  readonly element: HTMLElement;
  readonly slider: HTMLInputElement;
  readonly number: HTMLInputElement;
  readonly clear: HTMLButtonElement;
}

export function wishPanel(state: State): View {
  const list = make("div", "wish-list");
  const result = make("p", "wish-result", "", { "aria-live": "polite" });
  const element = panel("wishes", "Wishes", result, list);
  const all = button("clear", "no wishes", () => {
    for (const index of [...state.wishes.keys()]) state.wish(index, null);
  });
  headOf(element).append(all);
  let rows: Row[] = [];

  function rowOf(index: number): Row {
    const column = state.column(index);
    const name = make("span", "wish-name", column.name + (unit(column) && ` (${unit(column)})`), { title: column.label });
    name.style.borderColor = GROUP_COLOURS[column.group];
    const slider = make("input", "", "", { type: "range", min: "0", max: String(STEPS), "aria-label": `wish for ${column.name}` });
    const number = make("input", "", "", { type: "text", inputmode: "decimal", autocomplete: "off", spellcheck: "false", "aria-label": `wished ${column.name}` });
    const clear = button("\u00d7", `no wish for ${column.name}`, () => { state.wish(index, null); });
    const { low, high, quantum, counts } = column;
    slider.disabled = isEqual(column);
    slider.addEventListener("input", () => {
      const value = low + (Number(slider.value) / STEPS) * (high - low);
      state.wish(index, counts ? Math.round(value / quantum) * quantum : Number(value.toFixed(decimals(column))));
    });
    number.addEventListener("change", () => {
      const value = number.value.trim() === "" ? null : parsed(number.value);
      const wrong = value === null && number.value.trim() !== "";
      number.setAttribute("aria-invalid", String(wrong));
      if (!wrong) state.wish(index, value);
    });
    number.addEventListener("keydown", (event) => {
      if (event.key === "Enter") number.blur();
    });
    return { index, element: make("div", "wish", [name, slider, number, clear]), slider, number, clear };
  }

  function renew(): void {
    rows = state.order.map(rowOf);
    list.replaceChildren(...rows.map((row) => row.element));
  }

  function drawBase(): void {
    for (const { index, element: line, slider, number, clear } of rows) {
      const column = state.column(index);
      const wish = state.wishes.get(index);
      line.classList.toggle("set", wish !== undefined);
      clear.hidden = wish === undefined;
      const place = wish === undefined || isEqual(column) ? 0 : (wish - column.low) / (column.high - column.low);
      if (document.activeElement !== slider) slider.value = String(Math.round(place * STEPS));
      slider.setAttribute("aria-valuetext", wish === undefined ? "no wish" : text(column, wish));
      if (document.activeElement !== number || !number.matches(":focus-visible")) number.value = wish === undefined ? "" : text(column, wish);
      number.placeholder = "any";
    }
    all.hidden = state.wishes.size === 0;
    result.replaceChildren(...told());
  }

  function told(): (Node | string)[] {
    if (state.model.n === 0) return ["No row to rank."];
    const first = state.nearest?.[0];
    if (first === undefined) return ["Set a wish for one or several costs, to see the nearest row."];
    const { wished } = state;
    const link = (row: number): HTMLElement => {
      const pin = button(`row ${count(row)}`, "pin it", () => { state.pin(row); }, "link wished");
      pin.addEventListener("pointerenter", () => { state.hover([row]); });
      pin.addEventListener("pointerleave", () => { state.hover([]); });
      return pin;
    };
    if (wished === first) return ["Nearest: ", link(first)];
    if (wished === null) return ["Nearest: ", link(first), ", which your bounds leave out, as all others."];
    return ["Nearest within the bounds: ", link(wished), "; of all: ", link(first)];
  }

  renew();
  return { element, renew, resize: () => undefined, drawBase, drawOverlay: () => undefined };
}
