// Which part of the plane a map shows, and how wheel, pinch, drag and keys change it.

export interface Extent {
  readonly xMin: number;
  readonly yMin: number;
  readonly xMax: number;
  readonly yMax: number;
}

const MARGIN = 14; // CSS pixels round what is shown as a whole
const CLOSEST = 4000; // CSS pixels to a metre: a quarter of a millimetre to the pixel
const FARTHEST = 0.5; // of the scale that shows the whole
const STEP = 1.3; // of one key or click

/** x to the right, y up in metres; CSS pixels to the right and down. */
export class Camera {
  /** CSS pixels to a metre. */
  scale = 1;
  private left = 0; // m at the left border
  private top = 0; // m at the upper border
  private whole = 1;
  private width = 1;
  private height = 1;
  private extent: Extent = { xMin: 0, yMin: 0, xMax: 1, yMax: 1 };

  /** Shows an extent as a whole. */
  show(extent: Extent, width: number, height: number): void {
    this.extent = extent;
    [this.width, this.height] = [Math.max(width, 1), Math.max(height, 1)];
    const wide = Math.max(extent.xMax - extent.xMin, 1e-3);
    const high = Math.max(extent.yMax - extent.yMin, 1e-3);
    const [w, h] = [Math.max(this.width - 2 * MARGIN, 1), Math.max(this.height - 2 * MARGIN, 1)];
    this.scale = this.whole = Math.min(w / wide, h / high);
    this.left = (extent.xMin + extent.xMax - this.width / this.scale) / 2;
    this.top = (extent.yMin + extent.yMax + this.height / this.scale) / 2;
  }

  /** Shows what it showed in a frame of another size: the whole, or the same middle as near as before. */
  resize(width: number, height: number): void {
    const near = this.scale / this.whole;
    const [x, y] = [this.x(this.width / 2), this.y(this.height / 2)];
    this.show(this.extent, width, height);
    if (near === 1) return;
    this.scale = this.whole * near;
    this.left = x - this.width / 2 / this.scale;
    this.top = y + this.height / 2 / this.scale;
  }

  reset(): void {
    this.show(this.extent, this.width, this.height);
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

  /** Comes nearer by a factor; what lies under the pixel (px, py) stays there. */
  zoom(factor: number, px = this.width / 2, py = this.height / 2): void {
    const [x, y] = [this.x(px), this.y(py)];
    const most = Math.max(CLOSEST, this.whole);
    this.scale = Math.min(Math.max(this.scale * factor, this.whole * FARTHEST), most);
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

  /** Keeps some of the extent in sight: its nearest side never leaves the middle. */
  private hold(): void {
    const [wide, high] = [this.width / 2 / this.scale, this.height / 2 / this.scale];
    this.left = Math.min(Math.max(this.left + wide, this.extent.xMin), this.extent.xMax) - wide;
    this.top = Math.min(Math.max(this.top - high, this.extent.yMin), this.extent.yMax) + high;
  }
}

/** What a gesture is told. */
export interface Gestures {
  /** The camera shows something else. */
  moved(): void;
  /** The pointer is at a pixel without pressing, or null: it left. */
  hovered(at: { x: number; y: number } | null): void;
  /** A click or a tap, without a drag. */
  clicked(at: { x: number; y: number }, event: PointerEvent): void;
}

const SLACK = 4; // CSS pixels that a click may move

/** Lets wheel, drag, pinch and keys move a camera over an element that may have the focus. */
export function steer(element: HTMLElement, camera: Camera, gestures: Gestures): void {
  const held = new Map<number, { x: number; y: number }>();
  let dragged = false;
  let origin = { x: 0, y: 0 };
  const at = (event: MouseEvent) => {
    const box = element.getBoundingClientRect();
    return { x: event.clientX - box.left - element.clientLeft, y: event.clientY - box.top - element.clientTop };
  };
  element.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
      const here = at(event);
      camera.zoom(Math.exp(-Math.max(-120, Math.min(120, event.deltaY * lines)) * 0.0025), here.x, here.y);
      gestures.moved();
    },
    { passive: false },
  );
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    if (held.size === 0) {
      dragged = false;
      origin = at(event);
    }
    held.set(event.pointerId, at(event));
  });
  element.addEventListener("pointermove", (event) => {
    const here = at(event);
    const before = held.get(event.pointerId);
    if (before === undefined) {
      if (event.pointerType !== "touch") gestures.hovered(here);
      return;
    }
    if (!dragged && held.size === 1 && Math.hypot(here.x - origin.x, here.y - origin.y) < SLACK) return;
    if (!dragged) {
      dragged = true;
      element.setPointerCapture(event.pointerId);
      gestures.hovered(null);
    }
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    if (other === undefined) camera.pan(here.x - before.x, here.y - before.y);
    else {
      const was = Math.hypot(before.x - other.x, before.y - other.y);
      const is = Math.hypot(here.x - other.x, here.y - other.y);
      camera.pan((here.x - before.x) / 2, (here.y - before.y) / 2);
      if (was > 0 && is > 0) camera.zoom(is / was, (here.x + other.x) / 2, (here.y + other.y) / 2);
    }
    held.set(event.pointerId, here);
    gestures.moved();
  });
  const released = (event: PointerEvent) => {
    if (!held.delete(event.pointerId)) return;
    if (event.type === "pointerup" && !dragged) gestures.clicked(at(event), event);
  };
  element.addEventListener("pointerup", released);
  element.addEventListener("pointercancel", released);
  element.addEventListener("pointerleave", () => {
    if (held.size === 0) gestures.hovered(null);
  });
  element.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (!moveByKey(camera, event.key)) return;
    event.preventDefault();
    event.stopPropagation();
    gestures.moved();
  });
}

const PAN = 60; // CSS pixels of one key

/** Plus and minus come nearer and go back, 0 shows the whole, arrows move; tells whether the key was one of these. */
function moveByKey(camera: Camera, key: string): boolean {
  if (key === "+" || key === "=") camera.zoom(STEP);
  else if (key === "-" || key === "_") camera.zoom(1 / STEP);
  else if (key === "0") camera.reset();
  else if (key === "ArrowLeft") camera.pan(PAN, 0);
  else if (key === "ArrowRight") camera.pan(-PAN, 0);
  else if (key === "ArrowUp") camera.pan(0, PAN);
  else if (key === "ArrowDown") camera.pan(0, -PAN);
  else return false;
  return true;
}
