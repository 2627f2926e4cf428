// Two dialogs: help with the keys, and what is chosen as text to copy.
import { asCommands, asPython } from "./copy";
import { button, make } from "./dom";
import type { State } from "./state";

const KEYS: readonly (readonly [string, string])[] = [
  ["\u2191 \u2193, Page, Home, End", "go along the sorted table"],
  ["Enter or P", "pin the row at the focus, or take its pin away"],
  ["A, B, C", "pin it as A, B or C"],
  ["K", "keep: go on with the selected rows alone"],
  ["X", "exclude: go on without the selected rows"],
  ["Alt \u2190, Alt \u2192", "take a step back, and again"],
  ["0", "all rows again"],
  ["Y", "copy what is chosen"],
  ["Esc", "leave what is at the focus"],
  ["?", "this help"],
];

const WORDS = [
  "Every line on the axes, every dot and every path is one trajectory. None is better than another in every cost, so you choose.",
  "Drag along an axis to say what you accept; drag the brush to move it, its ends to resize it, click to clear it. The numbers at the ends can be typed.",
  "Wishes rank what the bounds leave: the nearest is drawn in gold.",
  "Drag the name of an axis to another place (Shift and an arrow key); \u21c5 flips it, log stretches small values, \u00d7 drops it.",
  "The address of this page holds bounds, pins, wishes and order: copied, it shows the same again. Nothing is stored or sent.",
];

function dialog(heading: string, ...content: readonly HTMLElement[]): HTMLDialogElement {
  const close = button("\u00d7", "close", () => { element.close(); }, "close");
  const element = make("dialog", "", [make("div", "panel-head", [make("h2", "", heading), close]), ...content], { "aria-label": heading });
  element.addEventListener("click", (event) => {
    if (event.target === element) element.close();
  });
  return element;
}

export function helpDialog(): HTMLDialogElement {
  const keys = make("dl", "keys", KEYS.flatMap(([key, words]) => [make("dt", "", key), make("dd", "", words)]));
  return dialog("Help", ...WORDS.map((words) => make("p", "", words)), keys);
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
  const element = dialog("Take along what is chosen", ...parts.map((one) => one.element));
  const open = (): void => {
    for (const one of parts) one.fill();
    element.showModal();
  };
  return { element, open };
}
