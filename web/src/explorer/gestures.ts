// Wheel, drag, pinch and keys that move a map; clicks and hovering are passed on for picking.
import type { Viewport } from "./viewport";

export const STEP = 1.3; // zoom factor of one key or click

/** Callbacks for gestures. */
export interface Gestures {
  /** Called when the viewport has changed. */
  moved(): void;
  /** The pointer is at a pixel without pressing, or null: it left. */
  hovered(at: { x: number; y: number } | null): void;
  /** A click or a tap, without a drag. */
  clicked(at: { x: number; y: number }, event: PointerEvent): void;
}

const SLACK = 4; // CSS pixels that a click may move

/** Lets wheel, drag, pinch and keys move a viewport over an element that may have the focus. */
export function steer(element: HTMLElement, viewport: Viewport, gestures: Gestures): void {
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
      viewport.zoom(Math.exp(-Math.max(-120, Math.min(120, event.deltaY * lines)) * 0.0025), here.x, here.y);
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
    if (other === undefined) viewport.pan(here.x - before.x, here.y - before.y);
    else {
      const was = Math.hypot(before.x - other.x, before.y - other.y);
      const is = Math.hypot(here.x - other.x, here.y - other.y);
      viewport.pan((here.x - before.x) / 2, (here.y - before.y) / 2);
      if (was > 0 && is > 0) viewport.zoom(is / was, (here.x + other.x) / 2, (here.y + other.y) / 2);
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
  element.addEventListener("pointerleave", (event) => {
    if (held.size === 0 && event.pointerType !== "touch") gestures.hovered(null);
  });
  element.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (!moveByKey(viewport, event.key)) return;
    event.preventDefault();
    event.stopPropagation();
    gestures.moved();
  });
}

const PAN = 60; // CSS pixels that an arrow key moves the map

/** Plus and minus zoom, 0 shows the whole map, arrows move it; returns whether the key was one of these. */
function moveByKey(viewport: Viewport, key: string): boolean {
  if (key === "+" || key === "=") viewport.zoom(STEP);
  else if (key === "-" || key === "_") viewport.zoom(1 / STEP);
  else if (key === "0") viewport.reset();
  else if (key === "ArrowLeft") viewport.pan(PAN, 0);
  else if (key === "ArrowRight") viewport.pan(-PAN, 0);
  else if (key === "ArrowUp") viewport.pan(0, PAN);
  else if (key === "ArrowDown") viewport.pan(0, -PAN);
  else return false;
  return true;
}
