// The selected rows as a table: sorted by any column; only the rows in sight are in the document.
import { button, headOf, make, panel } from "./dom";
import { KNEE } from "./guide";
import { count, text, unit } from "./numbers";
import type { Mark } from "./payload";
import type { SortKey, State } from "./state";
import { PIN_COLOURS, PIN_NAMES } from "./theme";
import type { View } from "./view";

/** Pixels; the style sheet has the same. */
const ROW = 24;
/** Sign before the number of a row with a name. */
const NAMED = "\u25c6";
const SPARE = 1; // rows in the document beyond those in sight

interface Head {
  readonly key: SortKey;
  readonly cell: HTMLElement;
}

/** The table also follows the keyboard: `reveal` scrolls to the row at the focus. */
export interface TableView extends View {
  reveal(): void;
  /** The table with all rows, for printing. */
  printed(): HTMLElement;
  /** Number of whole rows in sight. */
  readonly page: number;
}

export function tableView(state: State): TableView {
  const head = make("div", "thead", [], { role: "row" });
  const body = make("div", "tbody", [], { role: "rowgroup" });
  const grid = make("div", "grid", [head, body], { role: "grid", tabindex: "0", "aria-label": "selected trajectories" });
  const element = panel("table", "Table", grid);
  const counted = make("span", "hint");
  const chips = make("div", "chips");
  headOf(element).append(counted);
  grid.before(chips);
  let heads: Head[] = [];
  let pool: HTMLElement[] = [];
  let columns: readonly number[] = [];
  let named = new Map<number, string>();
  let sortedBy = "";

  function renew(): void {
    columns = []; // the head is built again: other data may have a tour
    heads = [];
    named = new Map(state.model.marks.map((mark) => [mark.row, mark.names.join(", ")]));
    pool = [];
    body.replaceChildren();
    chips.replaceChildren(...state.model.marks.map(chipOf));
  }

  /** A button for a named row: it pins the row, and highlights it while hovered. */
  function chipOf({ names, row }: Mark): HTMLElement {
    const chip = button(`${NAMED} ${names.join(", ")}`, `row ${row}: pin or unpin it${names.includes("knee") ? `. knee: ${KNEE}` : ""}`, () => { state.pin(row); });
    chip.dataset.row = String(row);
    chip.addEventListener("pointerenter", () => { state.hover([row]); });
    chip.addEventListener("pointerleave", () => { state.hover([]); });
    return chip;
  }

  function headCell(key: SortKey, words: string, title: string): Head {
    const press = make("button", "th", words, { type: "button", title });
    const cell = make("div", "th-cell", [press], { role: "columnheader" });
    press.addEventListener("click", () => {
      state.sortBy(key, state.sort.key === key && !state.sort.down);
    });
    return { key, cell };
  }

  function buildHead(): void {
    const { tour } = state.model;
    const room = tour === null ? 0 : Math.max(7 * Math.max(...tour.orders.map((order) => order.length), 5) + 16, 50);
    const wished = state.wishes.size > 0 ? [headCell("wishes", "near", "sort by nearness to the wishes")] : [];
    heads = [
      headCell("row", "row", "sort by the number of the row in the front"),
      ...wished,
      ...(tour ? [headCell("stops", "stops", "stops of the tour in the order of visits; the map shows their numbers")] : []),
      ...columns.map((index) => {
        const column = state.column(index);
        const title = `sort by ${column.label}. ${column.about}`;
        return headCell(index, column.name.replace(/_/g, "_\u200b") + (unit(column) && ` (${unit(column)})`), title);
      }),
    ];
    const widths = columns.map((index) => Math.min(Math.max(longest(state.column(index).name) * 7 + 16, 62), 130));
    head.replaceChildren(...heads.map((one) => one.cell));
    grid.style.setProperty("--columns", `54px ${wished.length ? "46px " : ""}${room ? `${room}px ` : ""}${widths.map((width) => `minmax(${width}px, 1fr)`).join(" ")}`);
    grid.style.setProperty("--least", `${54 + 46 * wished.length + room + widths.reduce((sum, width) => sum + width, 0)}px`);
    pool = [];
    body.replaceChildren();
  }

  function newRow(): HTMLElement {
    const row = make("div", "tr", Array.from({ length: heads.length }, () => make("span", "td", "", { role: "gridcell" })), { role: "row" });
    row.addEventListener("pointermove", (event) => {
      // Ignore rows that the keyboard scrolls beneath a resting mouse.
      const moved = event.movementX !== 0 || event.movementY !== 0;
      if (moved && event.pointerType !== "touch") state.hover([Number(row.dataset.row)]);
    });
    row.addEventListener("click", (event) => {
      state.click([Number(row.dataset.row)], (event).pointerType);
    });
    return row;
  }

  /** Fills the rows that are in sight. */
  function fill(): void {
    const rows = state.sorted;
    const first = Math.max(Math.floor(grid.scrollTop / ROW) - SPARE, 0);
    const many = Math.min(Math.ceil(grid.clientHeight / ROW) + 2 * SPARE, rows.length - first);
    while (pool.length < many) {
      const row = newRow();
      pool.push(row);
      body.append(row);
    }
    pool.forEach((element, i) => {
      element.hidden = i >= many;
      if (element.hidden) return;
      const place = first + i;
      const row = rows[place]!;
      element.style.transform = `translateY(${place * ROW}px)`;
      element.setAttribute("aria-rowindex", String(place + 2));
      element.id = `hpop-row-${row}`;
      element.dataset.row = String(row);
      heads.forEach(({ key }, c) => {
        const shown = said(key, row);
        const cell = element.children[c]!;
        if (cell.textContent !== shown) cell.textContent = shown;
      });
      element.title = named.get(row) ?? "";
    });
    drawOverlay();
  }

  let ranks = new Map<number, number>();
  let ranksOf: Int32Array | null = null;
  /** How near a row is to the wishes: 1 is the nearest of all. */
  function rank(row: number): number {
    if (state.nearest !== ranksOf) {
      ranksOf = state.nearest;
      ranks = new Map(Array.from(ranksOf ?? [], (one, i) => [one, i + 1]));
    }
    return ranks.get(row) ?? 0;
  }

  function drawBase(): void {
    const shown = state.shown;
    const wished = heads.some((one) => one.key === "wishes") !== state.wishes.size > 0;
    if (String(shown) !== String(columns) || heads.length === 0 || wished) {
      columns = shown;
      buildHead();
    }
    const { key: by, down } = state.sort;
    if (`${by} ${down}` !== sortedBy) grid.scrollTop = 0;
    sortedBy = `${by} ${down}`;
    for (const { key, cell } of heads) {
      const sorted = by === key ? (down ? "descending" : "ascending") : "none";
      cell.setAttribute("aria-sort", sorted);
    }
    body.style.height = `${state.count * ROW}px`;
    grid.setAttribute("aria-rowcount", String(state.count + 1));
    counted.textContent = state.model.n === 0 ? "no rows" : `${count(state.count)} ${state.count === 1 ? "row" : "rows"}; click one to pin it`;
    fill();
  }

  function drawOverlay(): void {
    const { focus } = state;
    for (const element of pool) {
      if (element.hidden) continue;
      const row = Number(element.dataset.row);
      const pin = state.pins.indexOf(row);
      element.classList.toggle("hovered", state.hovered.includes(row));
      element.setAttribute("aria-selected", String(pin >= 0));
      element.style.setProperty("--pin", pin < 0 ? "transparent" : PIN_COLOURS[pin]!);
      element.dataset.pin = pin < 0 ? "" : PIN_NAMES[pin]!;
    }
    for (const chip of chips.children as Iterable<Element> as Iterable<HTMLElement>) {
      chip.setAttribute("aria-pressed", String(state.pins.includes(Number(chip.dataset.row))));
    }
    if (focus === null) grid.removeAttribute("aria-activedescendant");
    else grid.setAttribute("aria-activedescendant", `hpop-row-${focus}`);
  }

  function reveal(): void {
    const place = state.focus === null ? -1 : state.sorted.indexOf(state.focus);
    if (place < 0) return;
    const [top, room] = [place * ROW, grid.clientHeight - head.offsetHeight];
    if (top < grid.scrollTop) grid.scrollTop = top;
    else if (top + ROW > grid.scrollTop + room) grid.scrollTop = top + ROW - room;
    fill();
  }

  /** Text of a cell. */
  function said(key: SortKey, row: number): string {
    if (key === "row") return named.has(row) ? `${NAMED} ${row}` : String(row);
    if (key === "stops") return state.orderOf(row);
    return key === "wishes" ? String(rank(row)) : text(state.column(key), state.column(key).values[row]!);
  }

  function printed(): HTMLElement {
    const names = heads.map(({ cell }) => make("th", "", cell.textContent, { scope: "col" }));
    const rows = Array.from(state.sorted, (row) => {
      const first = make("th", "", said("row", row), { scope: "row" });
      if (named.has(row)) first.append(` ${named.get(row)!}`);
      return make("tr", "", [first, ...heads.slice(1).map(({ key }) => make("td", "", said(key, row)))]);
    });
    return make("table", "printed", [make("thead", "", [make("tr", "", names)]), make("tbody", "", rows)]);
  }

  grid.addEventListener("scroll", fill, { passive: true });
  grid.addEventListener("pointerleave", (event) => {
    if (event.pointerType !== "touch") state.hover([]); // ignore touch: a finger leaves whenever it is lifted
  });
  renew();
  return {
    element,
    renew,
    resize: () => undefined,
    drawBase,
    drawOverlay,
    reveal,
    printed,
    get page() {
      return Math.max(Math.floor((grid.clientHeight - ROW) / ROW) - 1, 1);
    },
  };
}

/** Length of the longest part of a name between line breaks. */
function longest(name: string): number {
  return Math.max(...name.split(/[_ ]/).map((part) => part.length)) + (name.includes("_") ? 1 : 0);
}
