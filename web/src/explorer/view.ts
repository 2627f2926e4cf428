// Interface of the page's views: parallel axes, map, matrix, table, trace.
//
// A view is made once, `axesView(state)`, reads `state.model` afresh whenever it draws, and draws only when asked: the
// page calls each method at most once an animation frame, in the order below, and counts the calls. Costly parts are on
// the base canvas, drawn when the selection changes; what follows the mouse is on the overlay above it.
export interface View {
  /** Placed by the page; its size is given by the layout, never by what is drawn in it. */
  readonly element: HTMLElement;
  /** The data `state.model` were replaced: drop everything derived from the old data. */
  renew(): void;
  /** The element has another size, or the colours changed: canvases are fitted to it. A drawBase follows. */
  resize(): void;
  /** Selection, scales, order or sort changed: everything is drawn again. A drawOverlay follows. */
  drawBase(): void;
  /** Hovered rows, pins or the cursor along time changed. */
  drawOverlay(): void;
}

/** Two canvases, one above the other, that fill their parent. */
export interface Layers {
  readonly base: CanvasRenderingContext2D;
  readonly overlay: CanvasRenderingContext2D;
  /** CSS pixels. */
  width: number;
  height: number;
  /** Canvas pixels per CSS pixel: at most 2, since more is slower and not visible. */
  ratio: number;
}

/** Puts two canvases into an element, which must be positioned. */
export function layersIn(parent: HTMLElement): Layers {
  const [base, overlay] = ["base", "overlay"].map((name) => {
    const canvas = document.createElement("canvas");
    canvas.className = `layer ${name}`;
    canvas.setAttribute("aria-hidden", "true");
    parent.append(canvas);
    return canvas.getContext("2d")!;
  });
  return { base: base!, overlay: overlay!, width: 0, height: 0, ratio: 1 };
}

/** Fits both canvases to their parent; drawing is in CSS pixels afterwards. */
export function fit(layers: Layers): void {
  const parent = layers.base.canvas.parentElement!;
  layers.width = parent.clientWidth;
  layers.height = parent.clientHeight;
  layers.ratio = Math.min(window.devicePixelRatio || 1, 2);
  for (const context of [layers.base, layers.overlay]) {
    context.canvas.width = Math.max(1, Math.round(layers.width * layers.ratio));
    context.canvas.height = Math.max(1, Math.round(layers.height * layers.ratio));
    context.setTransform(layers.ratio, 0, 0, layers.ratio, 0, 0);
  }
}

/** Draws each overlay onto its base for printing, where some browsers let empty overlays hide the base. */
export function flatten(root: HTMLElement): void {
  for (const overlay of root.querySelectorAll<HTMLCanvasElement>("canvas.overlay")) {
    const base = (overlay.previousElementSibling as HTMLCanvasElement).getContext("2d")!;
    base.save();
    base.setTransform(1, 0, 0, 1, 0, 0);
    base.drawImage(overlay, 0, 0);
    base.restore();
  }
}

/** Empties a canvas, whatever its transform. */
export function clear(context: CanvasRenderingContext2D): void {
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, context.canvas.width, context.canvas.height);
  context.restore();
}
