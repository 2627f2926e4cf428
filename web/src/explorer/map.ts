// The map: paths of the selected trajectories, as a density over the floor; the others grey behind them.
import { button, headOf, make, panel } from "./dom";
import { steer, STEP } from "./gestures";
import { Ground, legendOf } from "./ground";
import type { Paths, Trace } from "./payload";
import { picksOver } from "./picks";
import { Density, inks } from "./raster";
import { SegmentGrid, segmentsOf, usersOf, type Segments } from "./segments";
import type { State } from "./state";
import { HOVER_WIDTH, PIN_COLOURS, PIN_DASHES, PIN_NAMES, PIN_WIDTH, theme, type Theme } from "./theme";
import { placeAt, tracedRows } from "./traced";
import { clear, fit, layersIn, type View } from "./view";
import { Viewport } from "./viewport";

const REACH = 6; // CSS pixels within which a segment is picked
const MOST_HOVERED = 12; // most rows highlighted at once where many overlap
const FINE = 2; // canvas pixels per CSS pixel of the legend
const BAR = 110; // largest length of a scale bar, CSS pixels
const EVERY = ["1", "2", "5"]; // lengths of a scale bar, times a power of ten

export function mapView(state: State): View {
  const plot = make("div", "plot", [], {
    tabindex: "0",
    role: "application",
    "aria-label": "Map. Plus and minus zoom, arrows move it, 0 shows the whole, Tab goes to the next trajectory here.",
  });
  const legend = make("p", "legend");
  const element = panel("map", "Map", plot, legend);
  const layers = layersIn(plot);
  const viewport = new Viewport();
  const picks = picksOver(plot, (row) => {
    state.pin(row);
  });

  let ground = new Ground(state.model.world, state.model.tour);
  let segments: Segments = segmentsOf(state.model.paths);
  let grid = new SegmentGrid(segments);
  let density = new Density(1, 1);
  const floor = document.createElement("canvas").getContext("2d")!;
  let stale = true; // whether the floor and the grey trajectories must be drawn again for another viewport
  let asked = false;

  /** Draws soon after the viewport changed: once a frame, however many events there were. */
  const move = () => {
    stale = true;
    letPageScroll();
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      drawBase();
      drawOverlay();
    });
  };

  /** A finger that moves up or down over the whole map scrolls the page; over a part of it, it moves the map. */
  const letPageScroll = () => {
    plot.style.touchAction = viewport.isWhole ? "pan-y" : "none";
  };

  const pick = (at: { x: number; y: number } | null) => {
    const rows = at === null ? [] : rowsNear(grid, segments, state.selected, viewport, at);
    if (picks.take(rows, at ?? { x: 0, y: 0 }) || rows.length > 0) state.hover(picks.turned(MOST_HOVERED));
  };

  headOf(element).append(
    button("+", "Zoom in (+)", () => { viewport.zoom(STEP); move(); }),
    button("\u2212", "Zoom out (-)", () => { viewport.zoom(1 / STEP); move(); }),
    button("Whole", "Show the whole map (0)", () => { viewport.reset(); move(); }),
  );
  steer(plot, viewport, {
    moved: move,
    hovered: pick,
    clicked: (at, event) => {
      if (event.pointerType === "touch") pick(at);
      state.click(picks.turned(MOST_HOVERED), event.pointerType);
    },
  });
  document.addEventListener("keydown", (event) => {
    if (picks.rows.length < 2) return;
    if (event.key === "Escape") pick(null);
    else if (event.key === "Tab") {
      event.preventDefault();
      picks.step(event.shiftKey ? -1 : 1);
      state.hover(picks.turned(MOST_HOVERED));
    }
  });

  function renew(): void {
    ground = new Ground(state.model.world, state.model.tour);
    segments = segmentsOf(state.model.paths);
    grid = new SegmentGrid(segments);
    picks.take([], { x: 0, y: 0 });
    viewport.renew(state.model.world.view, state.model.world.bounds);
    plot.dataset.segments = String(segments.count);
    stale = true;
  }

  function resize(): void {
    drawLegend(); // the legend takes the room that it needs, the map the rest
    fit(layers);
    viewport.resize(layers.width, layers.height);
    letPageScroll();
    const { width, height } = layers.base.canvas;
    density = new Density(width, height);
    [floor.canvas.width, floor.canvas.height] = [width, height];
    stale = true;
  }

  function drawBase(): void {
    const { base, ratio } = layers;
    const colours = theme();
    if (stale) {
      ground.draw(floor, viewport, colours, ratio);
      density.all.clear();
      fill(density.all, segments, usersOf(segments, new Uint8Array(state.model.n).fill(1)));
      stale = false;
    }
    if (state.count === state.model.n) density.selected.copy(density.all);
    else {
      density.selected.clear();
      fill(density.selected, segments, usersOf(segments, state.selected));
    }
    base.save();
    base.setTransform(1, 0, 0, 1, 0, 0);
    base.drawImage(floor.canvas, 0, 0);
    base.restore();
    density.paint(base, inks(colours.dark));
    ground.drawSymbols(base, viewport, colours, layers);
    plot.dataset.scale = drawScale(base, viewport, layers.height, colours);
  }

  function fill(raster: Density["all"], { count, x0, y0, x1, y1 }: Segments, users: Uint32Array): void {
    const { ratio } = layers;
    for (let s = 0; s < count; s++) {
      const users_ = users[s]!;
      if (users_ === 0) continue;
      raster.line(
        viewport.px(x0[s]!) * ratio,
        viewport.py(y0[s]!) * ratio,
        viewport.px(x1[s]!) * ratio,
        viewport.py(y1[s]!) * ratio,
        users_,
      );
    }
  }

  function drawOverlay(): void {
    const { overlay } = layers;
    const { model, hovered, pins, time } = state;
    const colours = theme();
    if (hovered.length === 0 || !picks.rows.includes(hovered[0]!)) picks.take([], { x: 0, y: 0 });
    clear(overlay);
    overlay.lineJoin = "round";
    const line = (row: number, colour: string, width: number, dash: readonly number[]) => {
      trace(overlay, model.paths, row, viewport);
      overlay.setLineDash([]);
      overlay.lineWidth = width + 2.5;
      overlay.strokeStyle = colours.halo;
      overlay.stroke();
      overlay.setLineDash([...dash]);
      overlay.lineWidth = width;
      overlay.strokeStyle = colour;
      overlay.stroke();
      overlay.setLineDash([]);
    };
    if (state.wished !== null) line(state.wished, colours.wish, HOVER_WIDTH, []);
    pins.forEach((row, i) => {
      if (row !== null) line(row, PIN_COLOURS[i]!, PIN_WIDTH, PIN_DASHES[i]!);
    });
    overlay.globalAlpha = 0.45;
    for (const row of hovered.slice(1)) line(row, colours.hover, 1, []);
    overlay.globalAlpha = 1;
    if (hovered.length > 0) line(hovered[0]!, colours.hover, HOVER_WIDTH, []);
    pins.forEach((row, i) => {
      if (row !== null) drawName(overlay, model.paths, row, viewport, PIN_NAMES[i]!, PIN_COLOURS[i]!, i);
    });
    if (time !== null) {
      for (const { row, colour } of tracedRows(state)) {
        if (!pins.includes(row) && !hovered.includes(row)) line(row, colour, 1, []);
        drawPose(overlay, model.traces.get(row), time, viewport, colour);
      }
    }
    plot.dataset.highlighted = hovered.join(",");
    picks.draw(model);
  }

  function drawLegend(): void {
    const { caption } = state.model.world;
    const colours = theme();
    const entries = legendOf(state.model.world, state.model.tour).map(({ words, draw }) => {
      const canvas = make("canvas");
      canvas.width = canvas.height = 16 * FINE;
      const context = canvas.getContext("2d")!;
      context.scale(FINE, FINE);
      draw(context, colours);
      return make("span", "entry", [canvas, words]);
    });
    legend.replaceChildren(...entries, make("span", "caption", caption));
  }

  renew();
  return { element, renew, resize, drawBase, drawOverlay };
}

/** Selected rows that pass a pixel, those of the nearest segment first. */
function rowsNear(
  grid: SegmentGrid,
  { rows }: Segments,
  selected: Uint8Array,
  viewport: Viewport,
  at: { x: number; y: number },
): number[] {
  const found = new Set<number>();
  for (const segment of grid.near(viewport.x(at.x), viewport.y(at.y), REACH / viewport.scale)) {
    for (let i = rows.offsets[segment]!; i < rows.offsets[segment + 1]!; i++) {
      const row = rows.items[i]!;
      if (selected[row] === 1) found.add(row);
    }
  }
  return [...found];
}

/** Traces the path of a row as the canvas's current path. */
function trace(context: CanvasRenderingContext2D, { offsets, x, y }: Paths, row: number, viewport: Viewport): void {
  context.beginPath();
  for (let at = offsets[row]!; at < offsets[row + 1]!; at++) context.lineTo(viewport.px(x[at]!), viewport.py(y[at]!));
}

/** Writes the letter of a pin on its path; each pin at another fraction of the path. */
function drawName(
  context: CanvasRenderingContext2D,
  { offsets, x, y }: Paths,
  row: number,
  viewport: Viewport,
  name: string,
  colour: string,
  place: number,
): void {
  const [first, last] = [offsets[row]!, offsets[row + 1]! - 1];
  let whole = 0;
  for (let at = first; at < last; at++) whole += Math.hypot(x[at + 1]! - x[at]!, y[at + 1]! - y[at]!);
  let rest = whole * [0.5, 0.35, 0.65][place]!;
  for (let at = first; at < last; at++) {
    const length = Math.hypot(x[at + 1]! - x[at]!, y[at + 1]! - y[at]!);
    if (rest > length || length === 0) {
      rest -= length;
      continue;
    }
    const px = viewport.px(x[at]! + (rest / length) * (x[at + 1]! - x[at]!));
    const py = viewport.py(y[at]! + (rest / length) * (y[at + 1]! - y[at]!));
    context.fillStyle = colour;
    context.beginPath();
    context.arc(px, py, 8, 0, 2 * Math.PI);
    context.fill();
    context.fillStyle = "#ffffff";
    context.font = "bold 11px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(name, px, py + 0.5);
    return;
  }
}

/** Draws the position of a traced row at a time, and the direction of its camera. */
function drawPose(
  context: CanvasRenderingContext2D,
  one: Trace | undefined,
  time: number,
  viewport: Viewport,
  colour: string,
): void {
  if (one === undefined) return;
  const { x, y, yaw } = placeAt(one, time);
  const [px, py] = [viewport.px(x), viewport.py(y)];
  for (const [stroke, width] of [[theme().paper, 6], [colour, 3]] as const) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(px, py);
    context.lineTo(px + 16 * Math.cos(yaw), py - 16 * Math.sin(yaw));
    context.stroke();
    context.beginPath();
    context.arc(px, py, 6, 0, 2 * Math.PI);
    context.stroke();
  }
  context.fillStyle = theme().paper;
  context.fill();
}

/** A bar of a round length in the lower left corner; returns the length in words. */
function drawScale(
  context: CanvasRenderingContext2D,
  { scale }: Viewport,
  height: number,
  { ink, halo }: Theme,
): string {
  const power = Math.floor(Math.log10(BAR / scale));
  const first = EVERY.map((digit) => Number(`${digit}e${power}`)).filter((length) => length * scale <= BAR).at(-1)!;
  const words = first >= 1000 ? `${first / 1000} km` : first >= 1 ? `${first} m` : `${Number((first * 100).toPrecision(3))} cm`;
  const [x, y] = [10, height - 10];
  context.save();
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "bottom";
  context.textAlign = "left";
  for (const [colour, width] of [[halo, 4.5], [ink, 2]] as const) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(x, y - 4);
    context.lineTo(x, y);
    context.lineTo(x + first * scale, y);
    context.lineTo(x + first * scale, y - 4);
    context.stroke();
  }
  context.lineWidth = 3;
  context.strokeStyle = halo;
  context.strokeText(words, x + 4, y - 4);
  context.fillStyle = ink;
  context.fillText(words, x + 4, y - 4);
  context.restore();
  return words;
}
