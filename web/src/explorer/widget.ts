// The explorer in a notebook, as anywidget loads it: the page in a frame, which sends the selection to Python.
//
// In the frame the page's style stays with the page, its keys are its own, and its layout follows the width of the cell.

/** Values that the notebook shares with Python. */
interface SharedModel {
  get(name: string): unknown;
  set(name: string, value: unknown): void;
  save_changes(): void;
  on(event: string, heard: () => void): void;
  off(event: string, heard: () => void): void;
}

/** Shows `page` in an element, `height` pixels high; sets `selected`, `hovered`, `pinned`. Returns a function to remove it. */
export function render({ model, el }: { readonly model: SharedModel; readonly el: HTMLElement }): () => void {
  const frame = document.createElement("iframe");
  frame.title = "explorer of a front";
  frame.setAttribute("sandbox", "allow-scripts"); // nothing of the notebook, whatever a front is called
  frame.allow = "clipboard-write";
  frame.style.cssText = "display: block; width: 100%; border: 0";
  const fill = (): void => { frame.srcdoc = String(model.get("page")); };
  const size = (): void => { frame.style.height = `${Number(model.get("height"))}px`; };
  const hear = (event: MessageEvent<unknown>): void => {
    if (event.source !== frame.contentWindow) return;
    const { chosen } = event.data as { chosen?: Readonly<Record<string, unknown>> };
    for (const name of ["selected", "hovered", "pinned"]) {
      if (chosen !== undefined && name in chosen) model.set(name, chosen[name]);
    }
    model.save_changes();
  };
  fill();
  size();
  window.addEventListener("message", hear);
  model.on("change:page", fill);
  model.on("change:height", size);
  el.append(frame);
  return () => {
    window.removeEventListener("message", hear);
    model.off("change:page", fill);
    model.off("change:height", size);
    frame.remove();
  };
}

export default { render };
