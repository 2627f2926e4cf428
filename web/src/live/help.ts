// Help of the page: how to drive, the keys, the options of the view, and the licence.
import { button, element } from "../shared/dom";

const STEPS = [
  "Choose where to go: click on the map, on the floor of the view, or choose a landmark.",
  "Choose a way: its card says what it is like, the same number is on the map and on the floor.",
  "While the robot drives, push it with the arrow keys or the pad: it takes the way that leads there, if there is one.",
  "The robot brakes as soon as this page is hidden or the connection is lost.",
];
const KEYS: readonly (readonly [string, string])[] = [
  ["Space, Esc", "stop or go; stop"],
  ["1 … 5", "drive the way of this card"],
  ["↑ ← → ↓", "push the robot ahead, left, right, back"],
  ["W A S D, R", "look around; look ahead again"],
  ["drag, double click", "look around; look ahead again"],
  ["Enter, in the view", "choose the place in the middle of the view"],
  ["M, arrows, Enter", "go to the map; move the cross; choose its place"],
  ["B, L", "a larger map; go to the landmarks"],
  ["G, T, Q", "a click means: go there; add a stop; why not here?"],
  ["V", "enter the headset; Esc leaves it at once"],
];

export interface Choice {
  readonly label: string;
  readonly on: boolean;
  readonly set: (on: boolean) => void;
}

export function helpDialog(choices: readonly Choice[], licence: string): HTMLDialogElement {
  const dialog = element("dialog");
  const [list, keys] = [element("ol"), element("dl")];
  list.append(...STEPS.map((step) => element("li", "", step)));
  for (const [key, what] of KEYS) keys.append(element("dt", "", key), element("dd", "", what));
  dialog.append(element("h2", "", "How to drive"), list, element("h3", "", "Keys"), keys, element("h3", "", "The view"));
  for (const { label, on, set } of choices) {
    const [row, box] = [element("label"), element("input")];
    box.type = "checkbox";
    box.checked = on;
    box.addEventListener("change", () => { set(box.checked); });
    row.append(box, ` ${label}`);
    dialog.append(row);
  }
  if (licence !== "") {
    const terms = element("details");
    const text = element("pre", "", licence);
    terms.append(element("summary", "", "The view is drawn by three.js. Its licence is"), text);
    dialog.append(terms);
  }
  dialog.append(button("Close", "Back to the robot", () => { dialog.close(); }));
  return dialog;
}
