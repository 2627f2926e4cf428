// Density rasters: how many trajectories cover each pixel, instead of a blot of lines over one another.
//
// Lines are walked pixel by pixel into counts and painted at once, by the logarithm of the count. 8,000 lines through
// five axes take some 20 ms; strokes of a canvas take fifty times that and hide the density.

/** Counts of a grid of pixels; x to the right, y down, pixel (i, j) covers [i, i + 1) x [j, j + 1). */
export class Raster {
  readonly counts: Uint32Array;

  constructor(
    readonly width: number,
    readonly height: number,
  ) {
    this.counts = new Uint32Array(width * height);
  }

  clear(): void {
    this.counts.fill(0);
  }

  /** Copies the counts of a raster of equal size. */
  copy(other: Raster): void {
    this.counts.set(other.counts);
  }

  /** The largest count. */
  most(): number {
    let most = 0;
    for (const count of this.counts) if (count > most) most = count;
    return most;
  }

  /**
   * Adds `weight` to the pixels of a segment: one in each column that it touches where it is wider than high, else one
   * in each row, so that no column stays white and no pixel counts twice. What lies outside the raster is cut off.
   */
  line(x0: number, y0: number, x1: number, y1: number, weight = 1): void {
    const { width, height } = this;
    if (!(x0 >= 0 && x0 < width && x1 >= 0 && x1 < width && y0 >= 0 && y0 < height && y1 >= 0 && y1 < height)) {
      const part = clipped(x0, y0, x1, y1, width, height);
      if (part === null) return;
      [x0, y0, x1, y1] = part;
    }
    if (Math.abs(x1 - x0) >= Math.abs(y1 - y0)) {
      if (x0 <= x1) walk(this.counts, x0, y0, x1, y1, 1, width, weight);
      else walk(this.counts, x1, y1, x0, y0, 1, width, weight);
    } else if (y0 <= y1) walk(this.counts, y0, x0, y1, x1, width, 1, weight);
    else walk(this.counts, y1, x1, y0, x0, width, 1, weight);
  }

  /** Adds `weight` to the pixels whose centres lie within `radius` (pixels) of the middle of the pixel at (x, y). */
  point(x: number, y: number, radius: number, weight = 1): void {
    const column = Math.floor(x);
    const row = Math.floor(y);
    const reach = Math.floor(radius);
    for (let dy = -reach; dy <= reach; dy++) {
      const j = row + dy;
      if (j < 0 || j >= this.height) continue;
      const half = Math.floor(Math.sqrt(radius * radius - dy * dy));
      const first = j * this.width + Math.max(column - half, 0);
      const last = j * this.width + Math.min(column + half, this.width - 1);
      for (let at = first; at <= last; at++) this.counts[at]! += weight;
    }
  }
}

/** Walks from a0 to a1 >= a0 along the longer side; b is the other coordinate, strides lead to the next pixel. */
function walk(
  counts: Uint32Array,
  a0: number,
  b0: number,
  a1: number,
  b1: number,
  along: number,
  across: number,
  weight: number,
): void {
  const first = Math.trunc(a0);
  const last = Math.trunc(a1);
  const slope = a1 > a0 ? (b1 - b0) / (a1 - a0) : 0;
  let b = b0 + (first + 0.5 - a0) * slope; // at the middle of the pixel; at either end not beyond the segment
  counts[first * along + Math.trunc(a0 > first + 0.5 ? b0 : a1 < first + 0.5 ? b1 : b) * across]! += weight;
  for (let a = first + 1; a < last; a++) {
    b += slope;
    counts[a * along + Math.trunc(b) * across]! += weight;
  }
  if (last > first) counts[last * along + Math.trunc(a1 < last + 0.5 ? b1 : b + slope) * across]! += weight;
}

const EDGE = 1e-6; // pixels inside the far borders of the raster at which segments are cut off

/** The part of a segment within the raster, or null; by the parameters at which it crosses each side (Liang, Barsky). */
function clipped(
  x0: number,
  y0: number,
  x1: number,
  y1: number,
  width: number,
  height: number,
): [number, number, number, number] | null {
  const dx = x1 - x0;
  const dy = y1 - y0;
  let from = 0;
  let to = 1;
  for (const [step, room] of [
    [-dx, x0],
    [dx, width - EDGE - x0],
    [-dy, y0],
    [dy, height - EDGE - y0],
  ] as const) {
    if (!(room >= 0) && !(step < 0)) return null;
    if (step < 0) from = Math.max(from, room / step);
    else if (step > 0) to = Math.min(to, room / step);
  }
  if (!(from <= to)) return null;
  const inside = (value: number, size: number) => Math.min(Math.max(value, 0), size - EDGE);
  return [
    inside(x0 + from * dx, width),
    inside(y0 + from * dy, height),
    inside(x0 + to * dx, width),
    inside(y0 + to * dy, height),
  ];
}

/** 256 colours, packed as the pixels of an ImageData. */
export type Ramp = Uint32Array;

/** A ramp through colours written as #rrggbb, evenly. */
export function rampOf(stops: readonly string[]): Ramp {
  const table = new Uint8ClampedArray(4 * 256);
  const colours = stops.map((colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16)));
  for (let k = 0; k < 256; k++) {
    const place = (k / 255) * (stops.length - 1);
    const before = Math.min(Math.floor(place), stops.length - 2);
    const [a, b] = [colours[before]!, colours[before + 1]!];
    for (let c = 0; c < 3; c++) table[4 * k + c] = a[c]! + (place - before) * (b[c]! - a[c]!);
    table[4 * k + 3] = 255;
  }
  return new Uint32Array(table.buffer);
}

/** Colours of a density. */
export interface Inks {
  /** Colours of the selected trajectories, from one to the largest count. */
  readonly selected: Ramp;
  /** Colours of all other trajectories, the context. */
  readonly context: Ramp;
}

/** On paper: the more, the darker. The context is lighter than the lightest of the selected. */
const LIGHT: Inks = {
  selected: rampOf(["#6aa9dc", "#2f78b7", "#0b4a87", "#08244a"]),
  context: rampOf(["#dcdfe2", "#b4babf"]),
};

/** In the dark: the more, the lighter. */
const DARK: Inks = {
  selected: rampOf(["#2f7fc4", "#5caae6", "#a9d6fb", "#f2fbff"]),
  context: rampOf(["#31363c", "#555d66"]),
};

/** The inks of a scheme. */
export function inks(dark: boolean): Inks {
  return dark ? DARK : LIGHT;
}

const DIRECT = 4096; // colours of smaller counts are tabulated

/** Colour of a count, on a logarithmic scale from one to the largest count. */
function colours(ramp: Ramp, most: number): (count: number) => number {
  const low = Math.log(2);
  const span = Math.log(1 + most) - low;
  // If no count is above one, the middle of the ramp is used.
  const of = (count: number) =>
    ramp[span > 0 ? Math.min(Math.round((255 * (Math.log(1 + count) - low)) / span), 255) : 128]!;
  const table = Uint32Array.from({ length: Math.min(most + 1, DIRECT) }, (_, count) => of(count || 1));
  return (count) => (count < table.length ? table[count]! : of(count));
}

/** Density of selected rows over all rows. The raster of all is filled once per size, the other one at each filter. */
export class Density {
  readonly all: Raster;
  readonly selected: Raster;
  private readonly canvas: HTMLCanvasElement;
  private readonly image: ImageData;
  private readonly pixels: Uint32Array;

  /** Sizes in canvas pixels. */
  constructor(
    readonly width: number,
    readonly height: number,
  ) {
    this.all = new Raster(width, height);
    this.selected = new Raster(width, height);
    this.image = new ImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.canvas = document.createElement("canvas");
    [this.canvas.width, this.canvas.height] = [width, height];
  }

  /** Paints the density on a canvas from its pixel (x, y); pixels without trajectories stay unchanged. */
  paint(target: CanvasRenderingContext2D, { selected, context }: Inks, x = 0, y = 0): void {
    const { pixels } = this;
    const over = this.selected.counts;
    const under = this.all.counts;
    const ofSelected = colours(selected, this.selected.most());
    const ofOthers = colours(context, this.all.most());
    for (let at = 0; at < pixels.length; at++) {
      const count = over[at]!;
      const others = under[at]!;
      pixels[at] = count > 0 ? ofSelected(count) : others > 0 ? ofOthers(others) : 0;
    }
    this.canvas.getContext("2d")!.putImageData(this.image, 0, 0);
    target.save();
    target.setTransform(1, 0, 0, 1, 0, 0);
    target.drawImage(this.canvas, x, y);
    target.restore();
  }
}
