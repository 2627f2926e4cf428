// Help of the page, and its options: options that change the view are off by default, and the log records them.
import { button, element } from "../shared/dom";

export interface Option {
  readonly label: string;
  readonly title: string;
  readonly get: () => boolean;
  readonly set: (on: boolean) => void;
}

const KEYS: readonly (readonly [string, string])[] = [
  ["Space", "play, stop"],
  ["1 2 3 …, X", "ride along this trajectory; along the next"],
  ["← →, Home, End", "a second back or forward (five with Shift); start, end"],
  ["↑ ↓", "faster, slower"],
  ["T", "compare at equal time, or at equal progress"],
  ["drag, double click, R", "look around; look ahead again"],
  ["F", "the view alone, or with map and criteria"],
  ["N", "hide or show numbers and names (blind)"],
  ["V, Esc", "enter the headset; leave it at once"],
];

export function helpDialog(options: readonly Option[], notes: readonly string[], licence: string, saveLog: () => void): HTMLDialogElement {
  const dialog = element("dialog");
  dialog.append(element("h2", "", "The ride"));
  dialog.append(
    element(
      "p",
      "",
      "You see what the robot’s camera sees. The robot carries you; you choose where to look. " +
        "Equal progress: the same share of the path is done, where a radian of turning counts as half a metre.",
    ),
  );
  const keys = element("dl");
  for (const [key, what] of KEYS) keys.append(element("dt", "", key), element("dd", "", what));
  dialog.append(keys, element("h3", "", "Options, off by default; they are logged"));
  for (const option of options) {
    const label = element("label");
    const box = element("input");
    box.type = "checkbox";
    box.checked = option.get();
    box.addEventListener("change", () => {
      option.set(box.checked);
    });
    label.title = option.title;
    label.append(box, ` ${option.label}`);
    dialog.append(label);
  }
  if (notes.length > 0) {
    dialog.append(element("h3", "numbers", "Notes"));
    const list = element("ul", "numbers");
    list.append(...notes.map((note) => element("li", "", note)));
    dialog.append(list);
  }
  const terms = element("details");
  terms.append(element("summary", "", "The view is drawn by three.js. Its licence is"), element("pre", "", licence));
  dialog.append(terms);
  const row = element("p");
  row.append(
    button("Save the log", "Save a file of all actions with their times", saveLog),
    " ",
    button("Close", "Back to the ride", () => {
      dialog.close();
    }),
  );
  dialog.append(row);
  return dialog;
}
