// Parallel axes: one line for each trajectory, drawn as a density; the selected ones over all others.
import { Axis } from "./axis";
import { button, headOf, make, panel } from "./dom";
import { text } from "./numbers";
import { Density, inks } from "./raster";
import type { State } from "./state";
import { GROUP_COLOURS, HOVER_WIDTH, PIN_COLOURS, PIN_DASHES, PIN_NAMES, PIN_WIDTH, REPORTED_DASH, theme } from "./theme";
import { clear, fit, layersIn, type View } from "./view";

const PAD = 8; // pixels above and below each axis, for its end values
const LEAST_GAP = 92; // pixels between axes; if they do not fit, the view scrolls
const MOST_GAP = 260;
const MARGIN = 58; // pixels beside the first and the last axis
const REACH = 9; // pixels: a line is picked within this distance of the mouse
const PIXELS_A_TICK = 34;

export function axesView(state: State): View {
  const inner = make("div", "axes-inner");
  const scroll = make("div", "axes-scroll", [inner], { tabindex: "0", role: "group", "aria-label": "axes, scroll sideways for more" });
  const dropped = make("div", "dropped");
  const element = panel("axes", "All costs", scroll);
  headOf(element).append(
    make("span", "hint", "A line is a trajectory; less is better. Drag along an axis to bound it, click a line to pin it."),
    dropped,
  );
  const plot = make("div", "axes-plot");
  inner.append(plot);
  const layers = layersIn(plot);

  let axes = new Map<number, Axis>();
  let order: readonly number[] = [];
  let xs: number[] = [];
  let ys: Float32Array[] = []; // (n,) CSS pixels from the top of the plot, for each axis shown
  let density: Density | null = null;
  let inSelected = new Uint8Array(0); // (n,) 1 for the rows that the raster of the selected rows contains
  let drawnFor = ""; // order and scales of the axes for which the raster of all rows was filled

  const placeAt = (clientX: number): number => {
    const x = clientX - inner.getBoundingClientRect().left;
    let place = 0;
    for (let i = 0; i < xs.length; i++) if (Math.abs(xs[i]! - x) < Math.abs(xs[place]! - x)) place = i;
    return place;
  };

  function renew(): void {
    for (const axis of axes.values()) axis.element.remove();
    const click = (event: PointerEvent): void => { state.click(near(event), event.pointerType); };
    axes = new Map(state.model.columns.map((_, index) => [index, new Axis(state, index, { placeAt, click }, PAD)]));
    drawnFor = "";
  }

  function layOut(): void {
    order = state.shown;
    const room = scroll.clientWidth;
    const gap = Math.min(Math.max((room - 2 * MARGIN) / Math.max(order.length - 1, 1), LEAST_GAP), MOST_GAP);
    const width = Math.max(gap * (order.length - 1) + 2 * MARGIN, room);
    const first = (width - gap * (order.length - 1)) / 2;
    inner.style.width = `${width}px`;
    xs = order.map((_, i) => first + i * gap);
    for (const [index, axis] of axes) {
      const place = order.indexOf(index);
      if (place < 0) axis.element.remove();
      else {
        if (axis.element.parentElement === null) inner.append(axis.element);
        axis.show(xs[place]!, Math.min(gap - 4, 2 * MARGIN));
      }
    }
    // The order in the document is the order of the axes, for users of the Tab key.
    const placed = order.map((index) => axes.get(index)!.element);
    if (placed.some((one, i) => inner.children[i + 1] !== one) && !inner.contains(document.activeElement)) inner.append(...placed);
  }

  function resize(): void {
    layOut();
    fit(layers);
    drawnFor = "";
  }

  const y = (axis: Axis, value: number): number => PAD + (1 - axis.scale.place(value)) * (layers.height - 2 * PAD);

  /** Adds the lines of rows to a raster, or subtracts them. */
  function walk(raster: Density["all"], rows: (row: number) => number): void {
    const { ratio } = layers;
    const { n } = state.model;
    for (let row = 0; row < n; row++) {
      const weight = rows(row);
      if (weight === 0) continue;
      for (let i = 0; i + 1 < xs.length; i++) {
        raster.line(xs[i]! * ratio, ys[i]![row]! * ratio, xs[i + 1]! * ratio, ys[i + 1]![row]! * ratio, weight);
      }
      if (xs.length === 1) {
        const [x, height] = [xs[0]! * ratio, ys[0]![row]! * ratio];
        raster.line(x - 30 * ratio, height, x + 30 * ratio, height, weight);
      }
    }
  }

  function fillAll(): void {
    const { canvas } = layers.base;
    ys = order.map((index) => {
      const axis = axes.get(index)!;
      return Float32Array.from(state.column(index).values, (value) => y(axis, value));
    });
    if (density?.width !== canvas.width || density.height !== canvas.height) density = new Density(canvas.width, canvas.height);
    density.all.clear();
    walk(density.all, () => 1);
    density.selected.clear();
    inSelected = new Uint8Array(state.model.n);
  }

  /** Updates the raster of the selected rows: adds and subtracts only rows that changed, if these are fewer. */
  function fillSelected({ all, selected: raster }: Density): void {
    const { selected, count, model } = state;
    let changed = 0;
    for (let row = 0; row < model.n; row++) if (selected[row] !== inSelected[row]) changed++;
    if (changed <= Math.min(count, model.n - count)) {
      walk(raster, (row) => selected[row]! - inSelected[row]!);
    } else if (count <= model.n - count) {
      raster.clear();
      walk(raster, (row) => selected[row]!);
    } else {
      raster.copy(all);
      walk(raster, (row) => selected[row]! - 1);
    }
    inSelected.set(selected);
  }

  function drawBase(): void {
    const key = [state.order, [...state.hidden], [...state.flipped], [...state.logs]].map(String).join(";");
    layOut();
    if (plot.clientWidth !== layers.width || plot.clientHeight !== layers.height) fit(layers);
    if (key !== drawnFor) {
      fillAll();
      showDropped();
    }
    drawnFor = key;
    fillSelected(density!);
    clear(layers.base);
    density!.paint(layers.base, inks(theme().dark));
    drawAxes();
  }

  function drawAxes(): void {
    const { base, height } = layers;
    const { ink, paper, quiet } = theme();
    base.font = "11px system-ui, sans-serif";
    base.textBaseline = "middle";
    base.textAlign = "right";
    order.forEach((index, i) => {
      const axis = axes.get(index)!;
      const column = state.column(index);
      const x = Math.round(xs[i]!) + 0.5;
      base.setLineDash(column.reported ? REPORTED_DASH : []);
      base.lineWidth = 1.5;
      base.strokeStyle = column.reported ? quiet : ink;
      stroke(base, [[x, PAD], [x, height - PAD]]);
      base.setLineDash([]);
      base.lineWidth = 1;
      for (const tick of axis.scale.ticks(Math.max(Math.floor((height - 2 * PAD) / PIXELS_A_TICK), 2))) {
        const at = Math.round(y(axis, tick)) + 0.5;
        stroke(base, [[x - 4, at], [x, at]]);
        label(base, tickText(tick), x - 7, at, ink, paper);
      }
      base.fillStyle = GROUP_COLOURS[column.group];
      base.fillRect(x - 2, 0, 4, 4);
    });
  }

  function showDropped(): void {
    const hidden = state.order.filter((index) => state.hidden.has(index));
    dropped.replaceChildren(
      ...hidden.map((index) => button(`+ ${state.column(index).name}`, `show the axis of ${state.column(index).name}`, () => { state.show(index, true); })),
    );
  }

  function drawOverlay(): void {
    const { overlay } = layers;
    const colours = theme();
    clear(overlay);
    overlay.lineJoin = "round";
    for (const [index, wish] of state.wishes) {
      const i = order.indexOf(index);
      if (i >= 0) diamond(overlay, xs[i]!, Math.min(Math.max(y(axes.get(index)!, wish), 3), layers.height - 3), colours.wish);
    }
    const wished = state.wished;
    if (wished !== null) drawRow(wished, colours.wish, HOVER_WIDTH, []);
    state.pins.forEach((row, pin) => {
      if (row === null) return;
      drawRow(row, PIN_COLOURS[pin]!, PIN_WIDTH, PIN_DASHES[pin]!);
      overlay.font = "bold 12px system-ui, sans-serif";
      overlay.textAlign = "center";
      label(overlay, PIN_NAMES[pin]!, (xs[0] ?? 0) + 10, ys[0]?.[row] ?? 0, PIN_COLOURS[pin]!, colours.paper);
    });
    const { focus } = state;
    if (focus === null) return;
    drawRow(focus, colours.hover, HOVER_WIDTH, []);
    overlay.font = "bold 11px system-ui, sans-serif";
    overlay.textAlign = "left";
    order.forEach((index, i) => {
      const column = state.column(index);
      label(overlay, text(column, column.values[focus]!), xs[i]! + 6, ys[i]![focus]!, colours.ink, colours.paper);
    });
  }

  function drawRow(row: number, colour: string, width: number, dash: readonly number[]): void {
    const { overlay } = layers;
    const points = xs.map((x, i): [number, number] => [x, ys[i]![row]!]);
    if (points.length === 1) points.splice(0, 1, [xs[0]! - 30, points[0]![1]], [xs[0]! + 30, points[0]![1]]);
    overlay.setLineDash([]);
    overlay.strokeStyle = theme().halo;
    overlay.lineWidth = width + 2.5;
    stroke(overlay, points);
    overlay.setLineDash(dash);
    overlay.strokeStyle = colour;
    overlay.lineWidth = width;
    stroke(overlay, points);
    overlay.setLineDash([]);
  }

  /** The selected row whose line passes nearest to the mouse, if one is near. */
  function near(event: PointerEvent): number[] {
    const box = plot.getBoundingClientRect();
    const [x, height] = [event.clientX - box.left, event.clientY - box.top];
    if (xs.length === 0 || height < 0 || height > box.height) return [];
    let i = 0;
    while (i + 2 < xs.length && x > xs[i + 1]!) i++;
    const [left, right] = [ys[i]!, ys[Math.min(i + 1, ys.length - 1)]!];
    const gap = (xs[i + 1] ?? xs[i]!) - xs[i]!;
    const t = gap === 0 ? 0 : Math.min(Math.max((x - xs[i]!) / gap, 0), 1);
    if (Math.abs(x - xs[i]! - t * gap) > 40) return [];
    let [nearest, least] = [-1, Infinity];
    for (let row = 0; row < state.model.n; row++) {
      if (state.selected[row] === 0) continue;
      const across = right[row]! - left[row]!;
      // The distance at a right angle to the line, so that steep lines are picked as easily as flat ones.
      const away = Math.abs(left[row]! + t * across - height) / (gap > 0 ? Math.hypot(1, across / gap) : 1);
      if (away < least) [nearest, least] = [row, away];
    }
    return least <= REACH ? [nearest] : [];
  }

  inner.addEventListener("pointermove", (event) => {
    if (event.pointerType !== "touch" && event.buttons === 0) state.hover(near(event));
  });
  inner.addEventListener("pointerleave", (event) => {
    if (event.pointerType !== "touch") state.hover([]);
  });
  plot.addEventListener("click", (event) => {
    state.click(near(event), (event).pointerType);
  });
  renew();
  return { element, renew, resize, drawBase, drawOverlay };
}

function tickText(tick: number): string {
  const size = Math.abs(tick);
  return (size !== 0 && (size >= 1e6 || size < 1e-4) ? tick.toExponential() : String(tick)).replace("-", "\u2212");
}

function stroke(context: CanvasRenderingContext2D, points: readonly (readonly [number, number])[]): void {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}

/** Text on a background in the colour of paper, readable over lines. */
function label(context: CanvasRenderingContext2D, words: string, x: number, y: number, ink: string, paper: string): void {
  context.textBaseline = "middle";
  context.lineWidth = 3.5;
  context.lineJoin = "round";
  context.strokeStyle = paper;
  context.strokeText(words, x, y);
  context.fillStyle = ink;
  context.fillText(words, x, y);
  context.lineWidth = 1;
  context.strokeStyle = ink;
}

function diamond(context: CanvasRenderingContext2D, x: number, y: number, colour: string): void {
  context.beginPath();
  for (const [dx, dy] of [[0, -6], [6, 0], [0, 6], [-6, 0]] as const) context.lineTo(x + dx, y + dy);
  context.closePath();
  context.fillStyle = colour;
  context.fill();
}
