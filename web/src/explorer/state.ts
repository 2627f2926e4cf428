// State of the page: bounds, kept rows, pins, hovered rows, wishes, order of axes and rows.
//
// There is one state for the whole page. Views read it and store no copies; they change it by its methods, and learn
// of the change when the page asks them to draw, once an animation frame.
import type { Column, Model } from "./payload";
import { History } from "./history";
import { NO_FILTER, select, type Bound, type Filter } from "./selection";
import { PINS } from "./theme";
import { ranked } from "./wishes";

/** data: other rows. filter: other rows selected. axes: order, scale. sort: order of rows. overlay: hover, pins, time. */
export type Change = "data" | "filter" | "axes" | "sort" | "overlay";

/** Sort key of rows: a column, the row number, the nearness to the wishes, or the order of a tour's stops. */
export type SortKey = number | "row" | "wishes" | "stops";

/** Choices that a link holds. */
export interface Chosen {
  readonly filter: Filter;
  readonly pins: readonly (number | null)[];
  readonly wishes: ReadonlyMap<number, number>;
  readonly order: readonly number[];
  readonly flipped: ReadonlySet<number>;
  readonly logs: ReadonlySet<number>;
  readonly hidden: ReadonlySet<number>;
  readonly sort: { readonly key: SortKey; readonly down: boolean };
}

export class State {
  /** (n,) 1 where a row is selected. */
  selected = new Uint8Array(0);
  /** Number of selected rows. */
  count = 0;
  /** Rows under the mouse or chosen by keyboard, the first at the focus; several if paths overlap. */
  hovered: readonly number[] = [];
  /** Rows of pins A, B, C; null for a free pin. */
  pins: (number | null)[] = new Array<number | null>(PINS).fill(null);
  /** Cursor along time, s from the start, common to map and trace. */
  time: number | null = null;
  /** Wished values by column, in its unit. */
  wishes = new Map<number, number>();
  /** Columns in the order of their axes, hidden ones included. */
  order: number[] = [];
  hidden = new Set<number>();
  flipped = new Set<number>();
  logs = new Set<number>();
  sort: { readonly key: SortKey; readonly down: boolean } = { key: "row", down: false };
  readonly history = new History<Filter>(NO_FILTER);
  /** The row that was last at the focus, from which the keyboard continues. */
  last: number | null = null;

  private readonly listeners: ((change: Change) => void)[] = [];
  private sortedRows: Int32Array | null = null;
  private ranking: Int32Array | null = null;

  constructor(public model: Model) {
    this.take(model);
  }

  listen(listener: (change: Change) => void): void {
    this.listeners.push(listener);
  }

  changed(change: Change): void {
    if (change !== "overlay") this.sortedRows = null;
    for (const listener of this.listeners) listener(change);
  }

  // -- rows ---------------------------------------------------------------------------------------------------------

  get filter(): Filter {
    return this.history.now;
  }

  /** Whether there are bounds or excluded rows. */
  get isFiltered(): boolean {
    return this.filter.kept !== null || this.filter.bounds.size > 0 || this.filter.order !== null;
  }

  /** Whether the selected rows can be kept or excluded: bounds or an order of stops select some rows but not all. */
  get isChosen(): boolean {
    return (this.filter.bounds.size > 0 || this.filter.order !== null) && this.count > 0 && this.count < this.model.n;
  }

  /** The row at the focus, or null. */
  get focus(): number | null {
    return this.hovered[0] ?? null;
  }

  /** Sets the hovered rows; none when the mouse has left. */
  hover(rows: readonly number[]): void {
    if (rows.length === this.hovered.length && rows.every((row, i) => row === this.hovered[i])) return;
    this.hovered = rows;
    this.last = rows[0] ?? this.last;
    this.changed("overlay");
  }

  /** Moves the time cursor, s; null removes it. */
  at(time: number | null): void {
    if (time === this.time) return;
    this.time = time;
    this.changed("overlay");
  }

  /** Pins a row with the first free letter, or the last one; removes the pin of a pinned row. */
  pin(row: number): void {
    const place = this.pins.indexOf(row);
    if (place >= 0) this.pins[place] = null;
    else {
      const free = this.pins.indexOf(null);
      this.pins[free >= 0 ? free : PINS - 1] = row;
    }
    this.changed("overlay");
  }

  /** Pins the clicked row; a first tap only hovers, since a finger cannot hover otherwise. */
  click(rows: readonly number[], pointer: string): void {
    const row = rows[0];
    if (pointer === "touch" && (row === undefined || row !== this.focus)) this.hover(rows);
    else if (row !== undefined) this.pin(row);
  }

  /** Pins a row as A, B or C, wherever it was pinned before. */
  pinAt(place: number, row: number): void {
    this.pins = this.pins.map((one, i) => (i === place ? row : one === row ? null : one));
    this.changed("overlay");
  }

  get pinned(): { pin: number; row: number }[] {
    return this.pins.flatMap((row, pin) => (row === null ? [] : [{ row, pin }]));
  }

  unpin(place: number): void {
    this.pins[place] = null;
    this.changed("overlay");
  }

  /** Sets or removes the bound of a column; `done` is false during a drag, which is one step of the history. */
  bound(column: number, bound: Bound | null, done = true): void {
    const bounds = new Map(this.filter.bounds);
    if (bound === null) bounds.delete(column);
    else bounds.set(column, bound);
    this.filterBy({ ...this.filter, bounds }, done);
  }

  /** Selects the rows that visit the stops of a tour in one order; null for any order. */
  inOrder(order: string | null): void {
    if (order !== this.filter.order) this.filterBy({ ...this.filter, order }, true);
  }

  /** Order in which a row visits the stops of the tour, such as "2 1 3"; "" without a tour. */
  orderOf(row: number): string {
    const { tour } = this.model;
    return tour === null ? "" : tour.orders[tour.order[row]!]!;
  }

  /** Keeps only the selected rows, or only the others, and removes all bounds. */
  keep(which: "selected" | "others"): void {
    const kept = Uint8Array.from(this.selected);
    if (which === "others") for (let row = 0; row < kept.length; row++) kept[row] = this.wasKept(row) && !kept[row] ? 1 : 0;
    this.filterBy({ ...NO_FILTER, kept }, true);
  }

  /** Selects all rows again. */
  clear(): void {
    if (this.isFiltered) this.filterBy(NO_FILTER, true);
  }

  back(): void {
    if (this.history.back()) this.filtered();
  }

  forward(): void {
    if (this.history.forward()) this.filtered();
  }

  // -- axes, order --------------------------------------------------------------------------------------------------

  column(index: number): Column {
    return this.model.columns[index]!;
  }

  /** Columns that have an axis, in their order. */
  get shown(): readonly number[] {
    return this.order.filter((index) => !this.hidden.has(index));
  }

  /** Whether a column has a logarithmic scale; only one whose values are all positive can. */
  isLog(index: number): boolean {
    return this.logs.has(index) && this.column(index).low > 0;
  }

  flip(index: number): void {
    toggle(this.flipped, index);
    this.changed("axes");
  }

  log(index: number): void {
    if (this.column(index).low <= 0) return;
    toggle(this.logs, index);
    this.changed("axes");
  }

  /** Shows an axis or drops it, and its bound with it. */
  show(index: number, shown: boolean): void {
    if (shown) this.hidden.delete(index);
    else this.hidden.add(index);
    if (!shown && this.filter.bounds.has(index)) this.bound(index, null);
    this.changed("axes");
  }

  /** Moves an axis to a position among those shown. */
  move(index: number, place: number): void {
    const shown = this.shown.filter((other) => other !== index);
    const before = shown[place];
    const order = this.order.filter((other) => other !== index);
    order.splice(before === undefined ? order.length : order.indexOf(before), 0, index);
    if (order.every((one, i) => one === this.order[i])) return;
    this.order = order;
    this.changed("axes");
  }

  sortBy(key: SortKey, down: boolean): void {
    this.sort = { key, down };
    this.changed("sort");
  }

  /** Sets or removes the wished value of a column. */
  wish(index: number, value: number | null): void {
    if (value === null) this.wishes.delete(index);
    else this.wishes.set(index, value);
    this.ranking = null;
    if (this.wishes.size > 0) this.sort = { key: "wishes", down: false };
    else if (this.sort.key === "wishes") this.sort = { key: "row", down: false };
    this.changed("sort");
  }

  /** All rows, the nearest to the wishes first; null without wishes. */
  get nearest(): Int32Array | null {
    if (this.wishes.size === 0 || this.model.n === 0) return null;
    this.ranking ??= ranked(this.model, this.wishes);
    return this.ranking;
  }

  /** The selected row that is nearest to the wishes, or null. */
  get wished(): number | null {
    return this.nearest?.find((row) => this.selected[row] === 1) ?? null;
  }

  /** The selected rows in the order of the table. */
  get sorted(): Int32Array {
    this.sortedRows ??= this.sortedNow();
    return this.sortedRows;
  }

  /** Restores all choices of a link at once. */
  restore(chosen: Chosen): void {
    const { order } = chosen;
    this.pins = Array.from({ length: PINS }, (_, pin) => chosen.pins[pin] ?? null);
    this.wishes = new Map(chosen.wishes);
    this.flipped = new Set(chosen.flipped);
    this.logs = new Set(chosen.logs);
    this.hidden = new Set(chosen.hidden);
    this.sort = chosen.sort;
    this.order = [...new Set([...order, ...this.firstOrder])];
    this.ranking = null;
    this.history.restart(chosen.filter);
    this.filtered();
    this.changed("overlay");
  }

  /** The initial order of axes. */
  get firstOrder(): readonly number[] {
    return grouped(this.model);
  }

  // -- data ---------------------------------------------------------------------------------------------------------

  /** Replaces the data and keeps all choices that still apply: columns by name, pins by costs. */
  replace(model: Model): void {
    const old = this.model;
    const at = new Map(model.columns.map((column, index) => [column.name, index]));
    const moved = (index: number): number => at.get(old.columns[index]!.name) ?? -1;
    const bounds = new Map([...this.filter.bounds].map(([i, bound]) => [moved(i), bound] as const).filter(([i]) => i >= 0));
    const pins = this.pins.map((row) => (row === null ? null : same(old, row, model)));
    const several = (set: Set<number>): Set<number> => new Set([...set].map(moved).filter((i) => i >= 0));
    const [hidden, flipped, logs] = [several(this.hidden), several(this.flipped), several(this.logs)];
    const order = this.order.map(moved).filter((i) => i >= 0);
    const wishes = new Map([...this.wishes].map(([i, value]) => [moved(i), value] as const).filter(([i]) => i >= 0));
    const sort = typeof this.sort.key === "number" ? { ...this.sort, key: moved(this.sort.key) } : this.sort;
    const order_ = this.filter.order !== null && model.tour?.orders.includes(this.filter.order) === true ? this.filter.order : null;
    this.history.restart({ bounds, kept: null, order: order_ }); // columns and rows have other numbers now
    this.take(model);
    this.order = [...order, ...this.order.filter((i) => !order.includes(i))];
    Object.assign(this, { hidden, flipped, logs, pins, wishes });
    this.sort = sort.key === -1 || (sort.key === "stops" && model.tour === null) || (sort.key === "wishes" && wishes.size === 0) ? { key: "row", down: false } : sort;
    this.filtered("data");
  }

  private take(model: Model): void {
    this.model = model;
    this.order = grouped(model);
    this.selected = new Uint8Array(model.n);
    this.count = select(model, this.filter, this.selected);
    this.hovered = [];
    this.last = null;
    this.time = null;
    this.ranking = null;
    this.sortedRows = null;
  }

  private wasKept(row: number): boolean {
    return this.filter.kept === null || this.filter.kept[row] === 1;
  }

  private filterBy(filter: Filter, done: boolean): void {
    this.history.put(filter, done);
    this.filtered();
  }

  private filtered(change: Change = "filter"): void {
    for (const index of this.filter.bounds.keys()) this.hidden.delete(index); // a bound on a hidden axis would be confusing
    this.count = select(this.model, this.filter, this.selected);
    this.changed(change);
  }

  private sortedNow(): Int32Array {
    const { key, down } = this.sort;
    const ranking = key === "wishes" ? this.nearest : null;
    const rows = new Int32Array(this.count);
    let next = 0;
    for (let i = 0; i < this.model.n; i++) {
      const row = ranking?.[i] ?? i;
      if (this.selected[row] === 1) rows[next++] = row;
    }
    if (typeof key === "number") {
      const { values } = this.column(key);
      rows.sort((a, b) => values[a]! - values[b]! || a - b);
    } else if (key === "stops" && this.model.tour !== null) {
      const { order } = this.model.tour;
      rows.sort((a, b) => order[a]! - order[b]! || a - b);
    }
    return down ? rows.reverse() : rows;
  }
}

/** Columns by group, performance first, reported values last; within a group in the front's order. */
function grouped({ columns }: Model): number[] {
  const rank = (index: number): number => (columns[index]!.reported ? 9 : ["P", "C", "R", "O", ""].indexOf(columns[index]!.group));
  return columns.map((_, index) => index).sort((a, b) => rank(a) - rank(b) || a - b);
}

function toggle(set: Set<number>, index: number): void {
  if (!set.delete(index)) set.add(index);
}

/** The row of another front that has the same criteria with the same costs, or null. */
function same(old: Model, row: number, model: Model): number | null {
  const pairs: [Float64Array, number][] = [];
  for (const column of model.columns.slice(0, model.criteria)) {
    const former = old.columns.find((one) => one.name === column.name);
    if (former === undefined) return null;
    pairs.push([column.values, former.values[row]!]);
  }
  for (let i = 0; i < model.n; i++) if (pairs.every(([values, value]) => values[i] === value)) return i;
  return null;
}
