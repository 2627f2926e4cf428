// A brush on an axis: drawn with mouse, finger or pen; moved at its middle, resized at its ends, cleared by a click.
import type { Bound } from "./selection";
import type { Scale } from "./scale";

const END = 7; // pixels about an end of a brush at which it is resized
const STARTED = 3; // pixels that make a drag of a click

export interface Brushed {
  /** Current scale of the axis. */
  scale(): Scale;
  bound(): Bound | null;
  /** `done` is false while the brush is dragged. */
  set(bound: Bound | null, done: boolean): void;
  /** A click where nothing was brushed. */
  click(event: PointerEvent): void;
}

interface Drag {
  readonly kind: "new" | "move" | "end";
  /** Positions on the axis, 0 at the bottom and 1 at the top: where the drag began, and the brush at that time. */
  readonly from: number;
  readonly a: number;
  readonly b: number;
  readonly before: Bound | null;
  started: boolean;
}

/** Positions of the ends of a bound, the lower one first; an open end is the end of the axis. */
export function endsOf(scale: Scale, { low, high }: Bound): [number, number] {
  const within = (place: number): number => Math.min(Math.max(place, 0), 1);
  const { column } = scale;
  const a = within(scale.place(Math.max(low, column.low)));
  const b = within(scale.place(Math.min(high, column.high)));
  return a <= b ? [a, b] : [b, a];
}

/** Makes an element, as high as the axis and `pad` pixels more at both ends, take a brush. */
export function brushOn(strip: HTMLElement, pad: number, axis: Brushed): void {
  let drag: Drag | null = null;
  const pixels = (): number => Math.max(strip.clientHeight - 2 * pad, 1);
  const placeOf = (event: PointerEvent): number => {
    const box = strip.getBoundingClientRect();
    return 1 - (event.clientY - box.top - pad) / pixels();
  };
  const kindAt = (place: number): Pick<Drag, "kind" | "a" | "b"> => {
    const bound = axis.bound();
    if (bound === null) return { kind: "new", a: place, b: place };
    const [low, high] = endsOf(axis.scale(), bound);
    const near = END / pixels();
    if (Math.abs(place - high) <= near) return { kind: "end", a: low, b: high };
    if (Math.abs(place - low) <= near) return { kind: "end", a: high, b: low };
    return place > low && place < high ? { kind: "move", a: low, b: high } : { kind: "new", a: place, b: place };
  };
  const boundAt = (place: number, { kind, from, a, b }: Drag): Bound | null => {
    if (kind !== "move") return axis.scale().bound(a, kind === "end" ? b + place - from : place, pixels());
    const shift = Math.min(Math.max(place - from, -a), 1 - b);
    return axis.scale().bound(a + shift, b + shift, pixels());
  };

  strip.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !event.isPrimary) return;
    const from = placeOf(event);
    drag = { ...kindAt(from), from, before: axis.bound(), started: false };
    strip.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  strip.addEventListener("pointermove", (event) => {
    const place = placeOf(event);
    if (drag === null) {
      strip.style.cursor = { new: "crosshair", move: "grab", end: "ns-resize" }[kindAt(place).kind];
      return;
    }
    drag.started ||= Math.abs(place - drag.from) * pixels() > STARTED;
    if (drag.started) axis.set(boundAt(place, drag), false);
  });
  strip.addEventListener("pointerup", (event) => {
    if (drag === null) return;
    const { started, before } = drag;
    const bound = boundAt(placeOf(event), drag);
    drag = null;
    if (started) axis.set(bound, true);
    else if (before !== null) axis.set(null, true);
    else axis.click(event);
  });
  strip.addEventListener("pointercancel", () => {
    if (drag?.started) axis.set(drag.before, true);
    drag = null;
  });
}
