// Two dialogs: help with words and keys, and the selection as text to copy.
import { asCommands, asPython } from "./copy";
import { button, make } from "./dom";
import { wordList } from "./guide";
import type { State } from "./state";

const KEYS: readonly (readonly [string, string])[] = [
  ["\u2191 \u2193, Page, Home, End", "move along the sorted table"],
  ["Enter or P", "pin the row in focus, or unpin it"],
  ["A, B, C", "pin the row in focus as A, B or C"],
  ["K", "keep: show only the selected rows"],
  ["X", "exclude: hide the selected rows"],
  ["Alt \u2190, Alt \u2192", "undo a step, redo it"],
  ["0", "show all rows again"],
  ["Y", "copy the selection"],
  ["Esc", "clear the focus"],
  ["?", "this help"],
];

const WORDS = [
  "Each line on the axes, each dot and each path is one trajectory. None is better than another in every cost, so the choice is yours.",
  "Drag along an axis to bound a cost. Drag the band to move it, its ends to resize it, and click it to clear it. You can also type the numbers at its ends.",
  "Wishes rank the rows within the bounds; the nearest is drawn in gold.",
  "Drag the name of an axis to reorder axes (or press Shift and an arrow key). \u21c5 flips an axis, log stretches small values, \u00d7 removes it.",
  "The address of this page holds bounds, pins, wishes and order, so a copied address shows the same selection. Nothing is sent. Your browser only remembers that you closed the first hint.",
];

function dialog(heading: string, ...content: readonly HTMLElement[]): HTMLDialogElement {
  const close = button("\u00d7", "close", () => { element.close(); }, "close");
  const element = make("dialog", "", [make("div", "panel-head", [make("h2", "", heading), close]), ...content], { "aria-label": heading });
  element.addEventListener("click", (event) => {
    if (event.target === element) element.close();
  });
  return element;
}

export function helpDialog(state: State): HTMLDialogElement {
  const keys = make("dl", "keys", KEYS.flatMap(([key, words]) => [make("dt", "", key), make("dd", "", words)]));
  return dialog("Help", ...WORDS.map((words) => make("p", "", words)), wordList(state), keys);
}

/** A dialog that is filled each time it opens. */
export function copyDialog(state: State): { element: HTMLDialogElement; open: () => void } {
  const part = (heading: string, text: () => string): { element: HTMLElement; fill: () => void } => {
    const area = make("textarea", "", "", { readonly: "", rows: "7", spellcheck: "false", "aria-label": heading });
    const copy = button("Copy", `copy ${heading}`, () => {
      area.select();
      navigator.clipboard.writeText(area.value).then(
        () => { copy.textContent = "Copied"; },
        () => { copy.textContent = "Press Ctrl-C"; }, // where a browser forbids it, the text is selected
      );
    });
    const fill = (): void => {
      area.value = text();
      copy.textContent = "Copy";
    };
    return { element: make("div", "copy-part", [make("div", "panel-head", [make("h3", "", heading), copy]), area]), fill };
  };
  const parts = [part("Python", () => asPython(state)), part("Command line", () => asCommands(state))];
  const element = dialog("Copy the selection", ...parts.map((one) => one.element));
  const open = (): void => {
    for (const one of parts) one.fill();
    element.showModal();
  };
  return { element, open };
}
