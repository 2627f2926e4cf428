// The scatter matrix: each pair of columns, as a density of points; a rectangle bounds both columns of its cell.
import { endsOf } from "./brush";
import { button, headOf, make, panel } from "./dom";
import { plain } from "./numbers";
import type { Column } from "./payload";
import { Density, inks, type Raster } from "./raster";
import { Scale } from "./scale";
import type { State } from "./state";
import { PIN_COLOURS, PIN_NAMES, theme, type Theme } from "./theme";
import { clear, fit, layersIn, type View } from "./view";

const MOST_COLUMNS = 6; // most columns of the full triangle; with more columns, one chosen pair is shown
const LEAST_CELL = 40; // CSS pixels
const LEFT = 64; // CSS pixels for the names and end values of rows
const BOTTOM = 36; // CSS pixels for the names and end values of columns
const GAP = 8; // CSS pixels between cells
const PAD = 6; // CSS pixels between a cell's border and its points
const REACH = 12; // CSS pixels within which a point is picked
const SAME = 0.6; // CSS pixels within which points count as overlapping
const MOST_HOVERED = 12; // most rows highlighted at once where many overlap
const NAME = 18; // CSS pixels that the letter of a pin takes beside its point
const STARTED = 4; // CSS pixels of movement that turn a click into a rectangle
const SMALL = "11px system-ui, sans-serif";

interface Cell {
  /** Columns along x and y. */
  readonly across: number;
  readonly up: number;
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  /** Whether the cell has the names of columns below it, and of rows beside it. */
  readonly lowest: boolean;
  readonly first: boolean;
}

/** Points of a cell sorted into squares as wide as the reach, to find the nearest ones quickly. */
interface Squares {
  readonly columns: number;
  readonly offsets: Uint32Array;
  readonly rows: Uint32Array;
}

export function matrixView(state: State): View {
  const plot = make("div", "plot");
  const pair = { across: make("select"), up: make("select") };
  const choice = make("span", "pair", [
    make("label", "", [pair.across, " across "]),
    make("label", "", [pair.up, " up"]),
  ]);
  const note = make("p", "note", "Pairs need two columns.");
  const element = panel("matrix", "Pairs", note, plot);
  const toggle = button("", "", () => {
    alone = !alone;
    drawBase();
    drawOverlay();
  });
  headOf(element).append(choice, toggle);
  note.hidden = choice.hidden = toggle.hidden = true;
  const layers = layersIn(plot);

  let cells: Cell[] = [];
  let density = new Density(1, 1);
  let scales = new Map<number, Scale>();
  let places = new Map<number, Float32Array>();
  let squares = new Map<Cell, Squares>();
  let chosen: [number, number] | null = null;
  let alone = false; // whether the user chose to show one pair, though there is room for all
  let filledFor = ""; // key for which the raster of all points was filled
  let drag: { cell: Cell; x: number; y: number; started: boolean } | null = null;

  const spotOf = (event: PointerEvent) => {
    const box = plot.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const cellAt = ({ x, y }: { x: number; y: number }) =>
    cells.find((cell) => x >= cell.x && x < cell.x + cell.width && y >= cell.y && y < cell.y + cell.height);
  const pxOf = (cell: Cell, row: number) => cell.x + PAD + places.get(cell.across)![row]! * (cell.width - 2 * PAD);
  const pyOf = (cell: Cell, row: number) => cell.y + PAD + (1 - places.get(cell.up)![row]!) * (cell.height - 2 * PAD);

  const choose = () => {
    chosen = [Number(pair.across.value), Number(pair.up.value)];
    drawBase();
    drawOverlay();
  };
  pair.across.addEventListener("change", choose);
  pair.up.addEventListener("change", choose);

  plot.addEventListener("pointerdown", (event) => {
    const spot = spotOf(event);
    const cell = cellAt(spot);
    if (cell === undefined || event.button !== 0 || !event.isPrimary) return;
    drag = { cell, ...spot, started: false };
    plot.setPointerCapture(event.pointerId);
  });
  plot.addEventListener("pointermove", (event) => {
    const spot = spotOf(event);
    if (drag === null) {
      const cell = cellAt(spot);
      plot.style.cursor = cell === undefined ? "" : "crosshair";
      state.hover(cell === undefined ? [] : near(cell, spot));
      return;
    }
    drag.started ||= Math.hypot(spot.x - drag.x, spot.y - drag.y) > STARTED;
    if (drag.started) bound(drag, spot, false);
  });
  plot.addEventListener("pointerup", (event) => {
    if (drag === null) return;
    const { cell, started } = drag;
    const spot = spotOf(event);
    if (started) bound(drag, spot, true);
    else {
      const rows = near(cell, spot);
      if (rows.length > 0) state.click(rows, event.pointerType);
      else free(cell);
    }
    drag = null;
  });
  plot.addEventListener("pointercancel", () => {
    drag = null;
  });
  plot.addEventListener("pointerleave", (event) => {
    if (drag === null && event.pointerType !== "touch") state.hover([]);
  });

  /** Bounds both columns of a cell by a rectangle between two positions. */
  function bound(from: { cell: Cell; x: number; y: number }, to: { x: number; y: number }, done: boolean): void {
    const { cell } = from;
    const [wide, high] = [cell.width - 2 * PAD, cell.height - 2 * PAD];
    const across = (x: number) => (x - cell.x - PAD) / wide;
    const up = (y: number) => 1 - (y - cell.y - PAD) / high;
    const { [0]: ofX, [1]: ofY } = [scales.get(cell.across)!, scales.get(cell.up)!] as const;
    state.bound(cell.across, ofX.bound(across(from.x), across(to.x), wide), false);
    state.bound(cell.up, ofY.bound(up(from.y), up(to.y), high), done);
  }

  /** Removes the bounds of both columns of a cell. */
  function free(cell: Cell): void {
    const { bounds } = state.filter;
    if (!bounds.has(cell.across) && !bounds.has(cell.up)) return;
    state.bound(cell.across, null, false);
    state.bound(cell.up, null);
  }

  /** The selected rows nearest to a position; several if they overlap. */
  function near(cell: Cell, spot: { x: number; y: number }): number[] {
    const { columns, offsets, rows } = squaresOf(cell);
    const [i, j] = [Math.floor((spot.x - cell.x) / REACH), Math.floor((spot.y - cell.y) / REACH)];
    let least = REACH;
    let found: { row: number; distance: number }[] = [];
    for (let b = Math.max(j - 1, 0); b <= j + 1; b++) {
      for (let a = Math.max(i - 1, 0); a <= Math.min(i + 1, columns - 1); a++) {
        const square = b * columns + a;
        if (square + 1 >= offsets.length) continue;
        for (let at = offsets[square]!; at < offsets[square + 1]!; at++) {
          const row = rows[at]!;
          const distance = Math.hypot(pxOf(cell, row) - spot.x, pyOf(cell, row) - spot.y);
          if (distance > least + SAME) continue;
          least = Math.min(least, distance);
          found.push({ row, distance });
        }
      }
    }
    found = found.filter(({ distance }) => distance <= least + SAME);
    return found
      .sort((a, b) => a.distance - b.distance || a.row - b.row)
      .slice(0, MOST_HOVERED)
      .map(({ row }) => row);
  }

  function squaresOf(cell: Cell): Squares {
    const known = squares.get(cell);
    if (known !== undefined) return known;
    const columns = Math.ceil(cell.width / REACH);
    const offsets = new Uint32Array(columns * Math.ceil(cell.height / REACH) + 1);
    const square = new Int32Array(state.model.n).fill(-1);
    for (let row = 0; row < state.model.n; row++) {
      if (state.selected[row] === 0) continue;
      const i = Math.floor((pxOf(cell, row) - cell.x) / REACH);
      square[row] = Math.floor((pyOf(cell, row) - cell.y) / REACH) * columns + i;
      offsets[square[row]! + 1]! += 1;
    }
    for (let at = 1; at < offsets.length; at++) offsets[at]! += offsets[at - 1]!;
    const next = offsets.slice();
    const rows = new Uint32Array(state.count);
    for (let row = 0; row < state.model.n; row++) if (square[row]! >= 0) rows[next[square[row]!]!++] = row;
    const made = { columns, offsets, rows };
    squares.set(cell, made);
    return made;
  }

  function layOut(): void {
    const { shown } = state;
    const { width, height } = layers;
    const across = (width - LEFT - GAP) / (shown.length - 1) - GAP;
    const up = (height - BOTTOM - GAP) / (shown.length - 1) - GAP;
    const room = shown.length <= MOST_COLUMNS && Math.min(across, up) >= LEAST_CELL;
    const whole = room && !(alone && shown.length > 2);
    toggle.hidden = !room || shown.length < 3;
    toggle.textContent = alone ? "All pairs" : "One pair";
    toggle.title = alone ? "Show each pair of columns" : "Show one pair larger";
    choice.hidden = whole || shown.length < 3;
    note.hidden = shown.length > 1;
    cells = [];
    if (shown.length < 2) return;
    if (whole) {
      for (let i = 1; i < shown.length; i++) {
        for (let j = 0; j < i; j++) {
          const at = { x: LEFT + j * (across + GAP), y: GAP + (i - 1) * (up + GAP), width: across, height: up };
          cells.push({ across: shown[j]!, up: shown[i]!, ...at, lowest: i === shown.length - 1, first: j === 0 });
        }
      }
      return;
    }
    const [first, second] = [chosen?.[0] ?? -1, chosen?.[1] ?? -1];
    const x = shown.includes(first) ? first : shown[0]!;
    const y = shown.includes(second) ? second : shown[1]!;
    for (const [select, value] of [[pair.across, x], [pair.up, y]] as const) {
      select.replaceChildren(
        ...shown.map((index) => make("option", "", state.column(index).name, { value: String(index) })),
      );
      select.value = String(value);
    }
    const at = { x: LEFT, y: GAP, width: width - LEFT - 2 * GAP, height: height - BOTTOM - 2 * GAP };
    if (at.width > 4 * PAD && at.height > 4 * PAD) cells = [{ across: x, up: y, ...at, lowest: true, first: true }];
  }

  function fill(raster: Raster, selected: Uint8Array | null): void {
    const { n } = state.model;
    const { ratio } = layers;
    const radius = (n <= 400 ? 2.5 : n <= 2500 ? 1.5 : 1) * ratio;
    for (const cell of cells) {
      for (let row = 0; row < n; row++) {
        if (selected !== null && selected[row] === 0) continue;
        raster.point(pxOf(cell, row) * ratio, pyOf(cell, row) * ratio, radius);
      }
    }
  }

  function drawBase(): void {
    const { base } = layers;
    const { model, shown } = state;
    layOut();
    const scale = (index: number) => new Scale(state.column(index), state.isLog(index), state.flipped.has(index));
    const key = [...shown, ...cells.map(({ across, up }) => `${across} ${up}`)].join() + scaleKey(state);
    if (key !== filledFor) {
      filledFor = key;
      scales = new Map(shown.map((index) => [index, scale(index)]));
      places = new Map(
        [...scales].map(([index, one]) => [index, Float32Array.from(state.column(index).values, (v) => one.place(v))]),
      );
      density.all.clear();
      fill(density.all, null);
    }
    squares = new Map();
    if (state.count === model.n) density.selected.copy(density.all);
    else {
      density.selected.clear();
      fill(density.selected, state.selected);
    }
    const colours = theme();
    clear(base);
    for (const cell of cells) drawFrame(base, cell, state, scales, colours);
    density.paint(base, inks(colours.dark));
  }

  function drawOverlay(): void {
    const { overlay } = layers;
    const { hovered, pins, model } = state;
    const colours = theme();
    clear(overlay);
    for (const cell of cells) {
      drawBounds(overlay, cell, state, scales, colours);
      for (const { row } of model.marks) ring(overlay, pxOf(cell, row), pyOf(cell, row), 4, 1.2, colours.ink, colours);
      if (state.wished !== null) ring(overlay, pxOf(cell, state.wished), pyOf(cell, state.wished), 5, 2.4, colours.wish, colours);
      pins.forEach((row, i) => {
        if (row === null) return;
        const x = pxOf(cell, row);
        drawPin(overlay, x, pyOf(cell, row), i, x + NAME > cell.x + cell.width, colours);
      });
      for (const row of hovered.slice(0, 1)) ring(overlay, pxOf(cell, row), pyOf(cell, row), 5.5, 2.2, colours.hover, colours);
    }
    plot.dataset.highlighted = hovered.join(",");
  }

  function resize(): void {
    fit(layers);
    density = new Density(layers.base.canvas.width, layers.base.canvas.height);
    filledFor = "";
  }

  return {
    element,
    renew: () => {
      filledFor = "";
      chosen = null;
      drag = null;
    },
    resize,
    drawBase,
    drawOverlay,
  };
}

/** Key of everything on which the positions of points depend, except the columns shown. */
function scaleKey(state: State): string {
  return state.shown.map((index) => `${state.isLog(index)}${state.flipped.has(index)}`).join();
}

function drawFrame(
  context: CanvasRenderingContext2D,
  cell: Cell,
  state: State,
  scales: ReadonlyMap<number, Scale>,
  colours: Theme,
): void {
  const { x, y, width, height, lowest, first } = cell;
  context.save();
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  context.strokeRect(x + 0.5, y + 0.5, width - 1, height - 1);
  context.font = SMALL;
  const ends = (index: number) => {
    const column = state.column(index);
    const { equal, flipped } = scales.get(index)!;
    const [low, high] = [rounded(column, column.low), rounded(column, column.high)];
    return equal ? (["", low, ""] as const) : flipped ? ([high, "", low] as const) : ([low, "", high] as const);
  };
  const draw = (words: string, at: [number, number], align: CanvasTextAlign) => {
    context.textAlign = align;
    context.fillStyle = colours.quiet;
    context.fillText(words, ...at);
  };
  const name = (index: number, room: number, at: [number, number]) => {
    const { label, name: alone } = state.column(index);
    context.textAlign = "center";
    context.fillStyle = colours.ink;
    context.fillText(context.measureText(label).width <= room ? label : shortened(context, alone, room), ...at);
  };
  if (lowest) {
    const [low, middle, high] = ends(cell.across);
    context.textBaseline = "top";
    if (context.measureText(low + high).width + 8 <= width) draw(low, [x + 1, y + height + 4], "left");
    draw(middle, [x + width / 2, y + height + 4], "center");
    draw(high, [x + width - 1, y + height + 4], "right");
    name(cell.across, width, [x + width / 2, y + height + 19]);
  }
  if (first) {
    const [low, middle, high] = ends(cell.up);
    context.textBaseline = "middle";
    draw(low, [x - 5, y + height - PAD], "right");
    draw(middle, [x - 5, y + height / 2], "right");
    draw(high, [x - 5, y + PAD], "right");
    context.translate(10, y + height / 2);
    context.rotate(-Math.PI / 2);
    name(cell.up, height, [0, 0]);
  }
  context.restore();
}

/** Draws the rectangle that the bounds of its columns leave of a cell. */
function drawBounds(
  context: CanvasRenderingContext2D,
  cell: Cell,
  state: State,
  scales: ReadonlyMap<number, Scale>,
  colours: Theme,
): void {
  const { bounds } = state.filter;
  const [across, up] = [bounds.get(cell.across), bounds.get(cell.up)];
  if (across === undefined && up === undefined) return;
  const [left, right] = across === undefined ? [0, 1] : endsOf(scales.get(cell.across)!, across);
  const [low, high] = up === undefined ? [0, 1] : endsOf(scales.get(cell.up)!, up);
  const [wide, tall] = [cell.width - 2 * PAD, cell.height - 2 * PAD];
  const [x, y] = [cell.x + PAD + left * wide - 3, cell.y + PAD + (1 - high) * tall - 3];
  context.save();
  context.strokeStyle = colours.ink;
  context.lineWidth = 1;
  context.setLineDash([3, 2]);
  context.strokeRect(x, y, (right - left) * wide + 6, (high - low) * tall + 6);
  context.restore();
}

/** A ring with a halo. */
function ring(
  context: CanvasRenderingContext2D,
  x: number,
  y: number,
  radius: number,
  width: number,
  colour: string,
  colours: Theme,
): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.lineWidth = width + 2;
  context.strokeStyle = colours.halo;
  context.stroke();
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
}

/** A disc, a square and a triangle: A, B and C differ without their colours too. The letter stays in the cell. */
function drawPin(
  context: CanvasRenderingContext2D,
  x: number,
  y: number,
  place: number,
  leftward: boolean,
  colours: Theme,
): void {
  context.beginPath();
  if (place === 0) context.arc(x, y, 5, 0, 2 * Math.PI);
  else if (place === 1) context.rect(x - 4.5, y - 4.5, 9, 9);
  else {
    context.moveTo(x, y - 6);
    context.lineTo(x + 6, y + 5);
    context.lineTo(x - 6, y + 5);
    context.closePath();
  }
  context.fillStyle = PIN_COLOURS[place]!;
  context.fill();
  context.lineWidth = 1.5;
  context.strokeStyle = colours.halo;
  context.stroke();
  context.font = "bold 11px system-ui, sans-serif";
  context.textAlign = leftward ? "right" : "left";
  context.textBaseline = "middle";
  context.lineWidth = 3;
  context.strokeText(PIN_NAMES[place]!, x + (leftward ? -8 : 8), y);
  context.fillText(PIN_NAMES[place]!, x + (leftward ? -8 : 8), y);
}

/** A value to three figures, but with all digits before the decimal point. */
function rounded({ counts }: Column, value: number): string {
  return plain(value, counts ? 0 : Math.max(0, 2 - Math.floor(Math.log10(Math.abs(value) || 100))));
}

/** The beginning of a text that fits into a width. */
function shortened(context: CanvasRenderingContext2D, words: string, room: number): string {
  if (context.measureText(words).width <= room) return words;
  let kept = words;
  while (kept.length > 1 && context.measureText(`${kept}\u2026`).width > room) kept = kept.slice(0, -1);
  return `${kept}\u2026`;
}
