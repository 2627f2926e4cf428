// The user's selection as Python code and as shell commands that select the same rows.
import { count, told } from "./numbers";
import type { State } from "./state";
import { PIN_NAMES } from "./theme";

/** Python code for the pinned rows, the selected part of the front, and the row nearest to the wishes. */
export function asPython(state: State): string {
  const { model, filter } = state;
  const listed = filter.kept !== null || filter.order !== null; // these selections have no condition in Python
  const numpy = !listed ? [] : ["import numpy as np", ""];
  const lines = [...numpy, "import hpop", "", `front = hpop.Front.load(${quoted(model.saved ?? "front.json")})`];
  const { pinned } = state;
  for (const { pin, row } of pinned) lines.push(`${PIN_NAMES[pin]!.toLowerCase()} = front[${row}]  # ${summary(state, row)}`);
  const conditions = conditionsOf(state);
  if (filter.order !== null) lines.push(`# stops visited in the order ${filter.order}`);
  if (listed) {
    lines.push(`chosen = front[np.isin(np.arange(len(front)), [${chosenRows(state).join(", ")}])]`);
  } else if (conditions.length > 0) {
    const both = [0, 1].map((i) => conditions.flatMap(({ name, tests }) => (tests[i] === undefined ? [] : [`${quoted(name)}: ${quoted(tests[i])}`])));
    const wheres = both.filter((some) => some.length > 0).map((some) => `.where({${some.join(", ")}})`);
    lines.push(`chosen = front${wheres.join("")}  # ${count(state.count)} of ${count(model.n)}`);
  }
  if (state.wishes.size > 0) {
    const wishes = [...state.wishes].map(([index, value]) => `${quoted(state.column(index).name)}: ${number(value)}`);
    const [nearest, wished] = [state.nearest?.[0] ?? null, state.wished];
    lines.push(`nearest = front.nearest({${wishes.join(", ")}})  # row ${nearest ?? "none"}`);
    if (wished !== null && wished !== nearest) lines.push(`nearest_chosen = front[${wished}]  # of those chosen`);
  }
  return lines.join("\n") + "\n";
}

/** Shell commands that pick the pinned rows, or the row nearest to the wishes within the bounds. */
export function asCommands(state: State): string {
  const folder = (state.model.saved ?? "out/front.json").replace(/[^/\\]*$/, "").replace(/[/\\]$/, "") || ".";
  const lines = state.pinned.map(({ row }) => `hpop pick ${shell(folder)} --row ${row}`);
  const most = [...state.filter.bounds].flatMap(([index, { high }]) =>
    Number.isFinite(high) ? [`--at-most ${shell(`${state.column(index).name}=${number(high)}`)}`] : [],
  );
  const wishes = [...state.wishes].map(([index, value]) => `--wish ${shell(`${state.column(index).name}=${number(value)}`)}`);
  if (most.length + wishes.length > 0) lines.push(["hpop pick", shell(folder), ...most, ...wishes].join(" "));
  const beyond = state.filter.kept !== null || state.filter.order !== null || [...state.filter.bounds.values()].some(({ low }) => Number.isFinite(low));
  if (beyond) lines.push("# bounds from below, an order of stops, and rows left out are for Python alone");
  return lines.length > 0 ? lines.join("\n") + "\n" : `hpop pick ${shell(folder)} --knee\n`;
}

function conditionsOf(state: State): { name: string; tests: string[] }[] {
  return [...state.filter.bounds].map(([index, { low, high }]) => ({
    name: state.column(index).name,
    tests: [...(Number.isFinite(low) ? [`>=${number(low)}`] : []), ...(Number.isFinite(high) ? [`<=${number(high)}`] : [])],
  }));
}

function chosenRows(state: State): number[] {
  return Array.from(state.selected.keys()).filter((row) => state.selected[row] === 1);
}

function summary(state: State, row: number): string {
  const { model } = state;
  const names = model.marks.find((mark) => mark.row === row)?.names ?? [];
  const costs = model.columns.slice(0, model.criteria).map((column) => told(column, column.values[row]!));
  return [...names, ...costs].join(", ").replace(/\s+/g, " ");
}

function number(value: number): string {
  return String(value);
}

function quoted(text: string): string {
  return JSON.stringify(text);
}

function shell(text: string): string {
  return /^[\w./=+:-]+$/.test(text) ? text : `'${text.replace(/'/g, `'\\''`)}'`;
}
