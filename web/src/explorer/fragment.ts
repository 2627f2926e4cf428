// The fragment of the address holds the user's choices, #b=turns:0-6&pin=70,157, so that a link restores them.
//
//   b      bounds, NAME:LOW-HIGH, an open end is *        order  names of the axes
//   pin    rows of A, B, C; empty for no pin              flip, log, hide  names
//   wish   NAME:VALUE                                     sort   NAME, :row, :wishes or :stops; -NAME for the greatest first
//   rows   kept rows, as 0-12,17; absent if all are kept
//   stops  order of visits of a tour, as 2-1-3
// Names are percent-encoded, so that none holds a comma, a colon or an ampersand.
import type { Bound } from "./selection";
import type { SortKey, State } from "./state";

const NUMBER = String.raw`[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?`;
const VALUE = new RegExp(`^${NUMBER}$`, "i");
const BOUND = new RegExp(`^(\\*|${NUMBER})-(\\*|${NUMBER})$`, "i");

const encoded = (name: string): string => encodeURIComponent(name).replace(/[-~!'()*.]/g, (c) => `%${c.charCodeAt(0).toString(16)}`);

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text; // a truncated link: its names will not be found
  }
}

/** The user's choices as text; empty if there are none. */
export function fragmentOf(state: State): string {
  const name = (index: number): string => encoded(state.column(index).name);
  const names = (indices: Iterable<number>): string => [...indices].map(name).join(",");
  const end = (value: number): string => (Number.isFinite(value) ? String(value) : "*");
  const key = typeof state.sort.key === "number" ? name(state.sort.key) : `:${state.sort.key}`;
  const parts: [string, string][] = [
    ["b", [...state.filter.bounds].map(([index, { low, high }]) => `${name(index)}:${end(low)}-${end(high)}`).join(",")],
    ["rows", state.filter.kept === null ? "" : runs(state.filter.kept)],
    ["stops", (state.filter.order ?? "").replace(/ /g, "-")],
    ["pin", state.pins.map((row) => row ?? "").join(",").replace(/,+$/, "")],
    ["wish", [...state.wishes].map(([index, value]) => `${name(index)}:${value}`).join(",")],
    ["order", String(state.order) === String(state.firstOrder) ? "" : names(state.order)],
    ["flip", names(state.flipped)],
    ["log", names(state.logs)],
    ["hide", names(state.hidden)],
    ["sort", key === (state.wishes.size > 0 ? ":wishes" : ":row") && !state.sort.down ? "" : (state.sort.down ? "-" : "") + key],
  ];
  return parts.flatMap(([part, text]) => (text === "" ? [] : [`${part}=${text}`])).join("&");
}

/** Restores the choices in a fragment; names that the front does not have are skipped. */
export function restore(state: State, fragment: string): void {
  const parts = new Map(fragment.replace(/^#/, "").split("&").map((part) => {
    const [key, ...rest] = part.split("=");
    return [key!, rest.join("=")];
  }));
  const at = new Map(state.model.columns.map((column, index) => [column.name, index]));
  const index = (name: string): number => at.get(decoded(name)) ?? -1;
  const list = (part: string): string[] => (parts.get(part) ?? "").split(",").filter((text) => text !== "");
  const indices = (part: string): number[] => list(part).map(index).filter((one) => one >= 0);
  const valued = (part: string): [number, string][] =>
    list(part).map((text): [number, string] => [index(text.split(":")[0]!), text.split(":")[1] ?? ""]).filter(([one]) => one >= 0);

  const bounds = new Map<number, Bound>();
  for (const [column, text] of valued("b")) {
    const found = BOUND.exec(text);
    if (found === null) continue;
    const low = found[1] === "*" ? -Infinity : Number(found[1]);
    const high = found[2] === "*" ? Infinity : Number(found[2]);
    bounds.set(column, { low: Math.min(low, high), high: Math.max(low, high) });
  }
  const pins = (parts.get("pin") ?? "").split(",").map((text) => (/^\d+$/.test(text) && Number(text) < state.model.n ? Number(text) : null))
    .map((row, place, all) => (all.indexOf(row) < place ? null : row)); // a row has one pin
  const wishes = new Map(valued("wish").map(([column, text]) => [column, VALUE.test(text) ? Number(text) : NaN] as const).filter(([, value]) => Number.isFinite(value)));
  const [, minus, key] = /^(-?)(.*)$/.exec(parts.get("sort") ?? ":wishes")!;
  const sort: SortKey = key === ":wishes" && wishes.size > 0 ? "wishes" : key === ":stops" && state.model.tour !== null ? "stops" : index(key!) >= 0 ? index(key!) : "row";
  const order = state.model.tour?.orders.find((one) => one.replace(/ /g, "-") === parts.get("stops")) ?? null;
  state.restore({
    filter: { bounds, kept: keptOf(parts.get("rows"), state.model.n), order },
    pins,
    wishes,
    order: indices("order"),
    flipped: new Set(indices("flip")),
    logs: new Set(indices("log")),
    hidden: new Set(indices("hide")),
    sort: { key: sort, down: minus === "-" },
  });
}

/** Row numbers as text, such as 0-12,17. */
function runs(kept: Uint8Array): string {
  const texts: string[] = [];
  for (let row = 0; row < kept.length; row++) {
    if (kept[row] === 0) continue;
    const first = row;
    while (kept[row + 1] === 1) row++;
    texts.push(first === row ? String(first) : `${first}-${row}`);
  }
  return texts.join(",") || "none";
}

function keptOf(text: string | undefined, n: number): Uint8Array | null {
  if (text === undefined) return null;
  const kept = new Uint8Array(n);
  for (const run of text.split(",")) {
    const found = /^(\d+)(?:-(\d+))?$/.exec(run);
    if (found !== null) kept.fill(1, Number(found[1]), Number(found[2] ?? found[1]) + 1);
  }
  return kept;
}
