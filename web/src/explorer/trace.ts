// The trace: rates over time of the pinned trajectories and of the one at the focus, one strip for each criterion.
import { headOf, make, panel } from "./dom";
import { short } from "./numbers";
import type { Trace } from "./payload";
import { niceTicks } from "./scale";
import type { State } from "./state";
import { theme, type Theme } from "./theme";
import { pieceAt, tracedRows, type Traced } from "./traced";
import { clear, fit, layersIn, type View } from "./view";

const LEFT = 44; // CSS pixels for the ticks of a strip
const RIGHT = 12;
const HEAD = 22; // above a strip, for its name
const FOOT = 18; // below a strip, for seconds
const LEAST_WIDTH = 150; // of a strip
const LEAST_HEIGHT = 84; // least height of a strip; strips that would be lower are put side by side
const LINE = 12; // height of a line of values at the cursor
const PIXELS_A_TICK = 52;
const SMALL = "11px system-ui, sans-serif";
const STEPS = 100; // number of keyboard steps from the beginning to the end

interface Strip {
  readonly column: number;
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

export function traceView(state: State): View {
  const plot = make("div", "plot", [], { tabindex: "0", role: "slider", "aria-label": "Time, s", "aria-valuemin": "0" });
  const note = make("p", "hint", "", { "aria-live": "polite" });
  const element = panel("trace", "Along the way", plot);
  headOf(element).append(note);
  const layers = layersIn(plot);
  let strips: Strip[] = [];
  let end = 0; // s, duration of the longest trajectory shown
  let held = false; // whether the cursor stays when the mouse leaves

  const timeAt = (event: PointerEvent): number | null => {
    const x = event.clientX - plot.getBoundingClientRect().left;
    const strip = strips.find((one) => x >= one.x - LEFT && x < one.x + one.width + RIGHT);
    if (strip === undefined || end === 0) return null;
    return Math.min(Math.max((x - strip.x) / strip.width, 0), 1) * end;
  };
  plot.addEventListener("pointermove", (event) => {
    if (!held || event.buttons > 0) state.at(timeAt(event));
  });
  plot.addEventListener("pointerdown", (event) => {
    const time = timeAt(event);
    held = time !== null && !(held && event.pointerType !== "touch" && Math.abs(time - (state.time ?? -1)) < end / 50);
    state.at(time);
  });
  plot.addEventListener("pointerleave", () => {
    if (!held) state.at(null);
  });
  plot.addEventListener("keydown", (event) => {
    const now = state.time ?? 0;
    const to = {
      ArrowLeft: now - end / STEPS,
      ArrowRight: now + end / STEPS,
      PageDown: now - end / 10,
      PageUp: now + end / 10,
      Home: 0,
      End: end,
      Escape: NaN,
    }[event.key];
    if (to === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    held = !Number.isNaN(to);
    state.at(held ? Math.min(Math.max(to, 0), end) : null);
  });

  /** Writes which trajectories are shown, and which have no trace. */
  function tell(shown: readonly (Traced & { trace: Trace })[], others: readonly Traced[]): void {
    const named = ({ row, name }: Traced) => {
      const names = state.model.marks.filter((mark) => mark.row === row).flatMap((mark) => mark.names);
      return [`${name && `${name}: `}row ${row}`, ...names].join(", ");
    };
    const words: (Node | string)[] = shown.map((one) => {
      const key = make("span", "key", named(one));
      key.style.setProperty("--colour", one.colour);
      key.style.setProperty("--dash", one.dash.length === 0 ? "solid" : one.dash[0]! > 4 ? "dashed" : "dotted");
      return key;
    });
    if (others.length > 0) {
      const rows = [...state.model.traces.keys()].sort((a, b) => a - b);
      const stored = rows.length === 0 ? "This file has no traces." : `Rows that have one: ${rows.join(", ")}.`;
      words.push(`No trace is stored of ${others.map(named).join("; ")}. ${stored}`);
    }
    const stops = [...(shown[0]?.trace.visits ?? [])].map(([number, name]) => `${number} ${name}`);
    if (stops.length > 0) words.push(`shaded: at stop ${stops.join(", ")}`);
    if (shown.length + others.length === 0) words.push("Point at a trajectory, or pin one, to see how its costs arise along it.");
    note.replaceChildren(...words);
    note.title = note.textContent;
  }

  function layOut(columns: readonly number[]): Strip[] {
    const { width, height } = layers;
    const most = Math.max(1, Math.min(Math.floor(width / LEAST_WIDTH), columns.length));
    let beside = 1;
    while (beside < most && height / Math.ceil(columns.length / beside) < LEAST_HEIGHT) beside++;
    const down = Math.max(1, Math.ceil(columns.length / beside));
    const [wide, high] = [width / beside, height / down];
    return columns.map((column, i) => ({
      column,
      x: (i % beside) * wide + LEFT,
      y: Math.floor(i / beside) * high + HEAD,
      width: Math.max(wide - LEFT - RIGHT, 10),
      height: Math.max(high - HEAD - FOOT, 4),
    }));
  }

  function drawOverlay(): void {
    const { overlay } = layers;
    const { model, time } = state;
    const traced = tracedRows(state);
    const shown = traced.flatMap((one) => {
      const trace = model.traces.get(one.row);
      return trace === undefined ? [] : [{ ...one, trace }];
    });
    tell(
      shown,
      traced.filter(({ row }) => !model.traces.has(row)),
    );
    const columns = model.columns.flatMap((_, i) => (shown.some(({ trace }) => trace.along[i] != null) ? [i] : []));
    strips = layOut(columns);
    end = Math.max(0, ...shown.map(({ trace }) => trace.t.at(-1) ?? 0));
    clear(overlay);
    for (const strip of strips) drawStrip(overlay, strip, shown, state, end, theme());
    plot.dataset.focus = String(state.focus ?? "");
    plot.dataset.traced = shown.map(({ row }) => row).join(",");
    plot.setAttribute("aria-valuemax", end.toFixed(1));
    plot.setAttribute("aria-valuenow", (time ?? 0).toFixed(1));
    plot.setAttribute("aria-valuetext", time === null ? "no time" : `${time.toFixed(1)} s`);
  }

  return {
    element,
    renew: () => {
      held = false;
    },
    resize: () => {
      fit(layers);
    },
    drawBase: () => undefined,
    drawOverlay,
  };
}

function drawStrip(
  context: CanvasRenderingContext2D,
  { column, x, y, width, height }: Strip,
  shown: readonly (Traced & { trace: Trace })[],
  { model, time }: State,
  end: number,
  colours: Theme,
): void {
  let [low, high] = [0, 0];
  for (const { trace } of shown) {
    for (const rate of trace.along[column]?.rate ?? []) {
      low = Math.min(low, rate);
      high = Math.max(high, rate);
    }
  }
  if (low === high) high = low + 1;
  const px = (t: number) => x + (end > 0 ? t / end : 0) * width;
  const py = (rate: number) => y + (1 - (rate - low) / (high - low)) * height;

  context.save();
  context.font = SMALL;
  context.lineWidth = 1;
  context.strokeStyle = colours.line;
  context.fillStyle = colours.quiet;
  context.textBaseline = "middle";
  context.textAlign = "right";
  context.beginPath();
  for (const tick of niceTicks(low, high, Math.max(Math.floor(height / 28), 1))) {
    context.moveTo(x, py(tick));
    context.lineTo(x + width, py(tick));
    context.fillText(short(tick), x - 5, py(tick));
  }
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const tick of end > 0 ? niceTicks(0, end, Math.floor(width / PIXELS_A_TICK)) : []) {
    context.moveTo(px(tick), y + height);
    context.lineTo(px(tick), y + height + 3);
    context.fillText(`${short(tick)} s`, px(tick), y + height + 4);
  }
  context.moveTo(x, y + height);
  context.lineTo(x + width, y + height);
  context.stroke();

  const first = shown[0];
  if (first !== undefined) drawVisits(context, first, px, y, height);

  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillStyle = colours.ink;
  const { name, along } = model.columns[column]!;
  context.fillText(fitted(context, `${name}: ${along ?? ""}`, width + LEFT - 4), x - LEFT + 4, y - 3);

  for (const { trace, colour, dash } of shown) {
    context.strokeStyle = colour;
    context.lineWidth = 1.8;
    context.setLineDash([...dash]);
    context.beginPath();
    trace.along[column]?.rate.forEach((value, piece) => {
      context.lineTo(px(trace.t[piece]!), py(value));
      context.lineTo(px(trace.t[piece + 1]!), py(value));
    });
    context.stroke();
  }
  context.setLineDash([]);
  if (time !== null) drawCursor(context, { column, x, y, width, height }, shown, time, px, py, colours);
  context.restore();
}

/** Shades the times at which a trajectory is at the stops of a tour, with their numbers. */
function drawVisits(
  context: CanvasRenderingContext2D,
  { trace, colour }: Traced & { trace: Trace },
  px: (t: number) => number,
  y: number,
  height: number,
): void {
  context.save();
  context.textAlign = "center";
  context.textBaseline = "top";
  context.fillStyle = colour;
  for (const [number, , begin, end] of trace.visits) {
    context.globalAlpha = 0.16;
    context.fillRect(px(begin), y, Math.max(px(end) - px(begin), 1.5), height);
    context.globalAlpha = 1;
    context.fillText(String(number), px((begin + end) / 2), y + 1);
  }
  context.restore();
}

/** Draws the cursor, with its time and the rates there. */
function drawCursor(
  context: CanvasRenderingContext2D,
  { column, x, y, width, height }: Strip,
  shown: readonly (Traced & { trace: Trace })[],
  time: number,
  px: (t: number) => number,
  py: (rate: number) => number,
  colours: Theme,
): void {
  context.strokeStyle = colours.ink;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(px(time), y);
  context.lineTo(px(time), y + height);
  context.stroke();
  const right = px(time) > x + 0.6 * width;
  context.textAlign = right ? "right" : "left";
  context.textBaseline = "middle";
  let above = -Infinity;
  const values = shown
    .filter(({ trace }) => time <= (trace.t.at(-1) ?? -1))
    .flatMap(({ trace, colour }) => {
      const rate = trace.along[column]?.rate[pieceAt(trace, time)];
      return rate === undefined ? [] : [{ rate, colour }];
    })
    .sort((a, b) => b.rate - a.rate);
  for (const [i, { rate, colour }] of values.entries()) {
    context.fillStyle = colour;
    context.beginPath();
    context.arc(px(time), py(rate), 3, 0, 2 * Math.PI);
    context.fill();
    above = Math.max(Math.min(py(rate), y + height - LINE * (values.length - i - 0.5)), above + LINE);
    context.lineWidth = 3;
    context.strokeStyle = colours.halo;
    const at = px(time) + (right ? -7 : 7); // values below each other, above the axis
    context.strokeText(short(rate), at, above);
    context.fillText(short(rate), at, above);
  }
}

/** The beginning of a text that fits into a width. */
function fitted(context: CanvasRenderingContext2D, text: string, room: number): string {
  if (context.measureText(text).width <= room) return text;
  let kept = text;
  while (kept.length > 1 && context.measureText(`${kept}\u2026`).width > room) kept = kept.slice(0, -1);
  return `${kept}\u2026`;
}
