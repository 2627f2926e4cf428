// Viewport: the part of the plane that a map shows.

/** x_min, y_min, x_max, y_max, m. */
export type Box = readonly [number, number, number, number];

const MARGIN = 14; // CSS pixels of margin round the whole
const CLOSEST = 4000; // CSS pixels to a metre: a quarter of a millimetre to the pixel
const FARTHEST = 0.5; // least scale, as a share of the scale that shows everything

/** x to the right, y up in metres; CSS pixels to the right and down. */
export class Viewport {
  /** CSS pixels to a metre. */
  scale = 1;
  private left = 0; // m at the left border
  private top = 0; // m at the upper border
  private whole = 1;
  private width = 1;
  private height = 1;
  private home: Box = [0, 0, 1, 1];
  private bounds: Box = [0, 0, 1, 1];

  /** Sets another plane and shows `home`; `bounds` contains everything to draw. */
  renew(home: Box, bounds: Box): void {
    [this.home, this.bounds] = [home, bounds];
    this.reset();
  }

  /** Adapts to another size: the whole stays the whole; else the centre and the relative scale stay. */
  resize(width: number, height: number): void {
    const near = this.scale / this.whole;
    const [x, y] = [this.x(this.width / 2), this.y(this.height / 2)];
    const moved = !this.isWhole;
    [this.width, this.height] = [Math.max(width, 1), Math.max(height, 1)];
    this.reset();
    if (!moved) return;
    this.scale = this.whole * near;
    this.centre(x, y);
  }

  /** Whether it shows the whole, as after `reset`. */
  get isWhole(): boolean {
    const [x, y] = [this.x(this.width / 2), this.y(this.height / 2)];
    const aside = Math.abs(x - middle(this.home, 0)) + Math.abs(y - middle(this.home, 1));
    return this.scale === this.whole && aside < 1e-6;
  }

  /** Shows the whole. */
  reset(): void {
    this.scale = this.whole = this.fitting(this.home);
    this.centre(middle(this.home, 0), middle(this.home, 1));
  }

  /** Metres under a pixel, and the pixel over metres. */
  x(pixel: number): number {
    return this.left + pixel / this.scale;
  }

  y(pixel: number): number {
    return this.top - pixel / this.scale;
  }

  px(x: number): number {
    return (x - this.left) * this.scale;
  }

  py(y: number): number {
    return (this.top - y) * this.scale;
  }

  /** Zooms by a factor; the point under the pixel (px, py) stays there. */
  zoom(factor: number, px = this.width / 2, py = this.height / 2): void {
    const [x, y] = [this.x(px), this.y(py)];
    const least = FARTHEST * Math.min(this.whole, this.fitting(this.bounds));
    this.scale = Math.min(Math.max(this.scale * factor, least), Math.max(CLOSEST, this.whole));
    this.left = x - px / this.scale;
    this.top = y + py / this.scale;
    this.hold();
  }

  /** Moves the picture by pixels. */
  pan(dx: number, dy: number): void {
    this.left -= dx / this.scale;
    this.top += dy / this.scale;
    this.hold();
  }

  /** Draws in metres on a canvas of `ratio` pixels to a CSS pixel. */
  transform(context: CanvasRenderingContext2D, ratio: number): void {
    const scale = this.scale * ratio;
    context.setTransform(scale, 0, 0, -scale, -this.left * scale, this.top * scale);
  }

  private fitting(box: Box): number {
    const wide = Math.max(this.width - 2 * MARGIN, 1) / Math.max(box[2] - box[0], 1e-3);
    return Math.min(wide, Math.max(this.height - 2 * MARGIN, 1) / Math.max(box[3] - box[1], 1e-3));
  }

  private centre(x: number, y: number): void {
    this.left = x - this.width / 2 / this.scale;
    this.top = y + this.height / 2 / this.scale;
  }

  /** Keeps part of the plane in sight: its borders never pass the middle. */
  private hold(): void {
    const [x, y] = [this.x(this.width / 2), this.y(this.height / 2)];
    const [xMin, yMin, xMax, yMax] = this.bounds;
    this.centre(Math.min(Math.max(x, xMin), xMax), Math.min(Math.max(y, yMin), yMax));
  }
}

function middle(box: Box, axis: 0 | 1): number {
  return (box[axis] + box[axis + 2]!) / 2;
}
