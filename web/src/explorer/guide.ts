// Explanations of terms, one line each, shown until the reader closes them; afterwards on hover and in the help.
import { button, make } from "./dom";
import type { State } from "./state";
import type { View } from "./view";

const EXPOSURE = "how closely obstacles surround the camera, added up over time: ten seconds with a tenth of the view's ball filled cost 1 s.";
export const KNEE = "a good compromise. Beyond it, a small gain in one cost takes a large loss in another. You need not take it.";
export const CERTIFICATE = "what is proven: whether a better trajectory may be missing, and on which grid. Click the line above for the full text.";

/** Key in the browser's storage that records that the explanations were closed. */
const CLOSED = "hpop.guide";

/** Terms with their meanings; exposure only if the front has it. */
export function words(state: State): [string, string][] {
  const exposure: [string, string][] = state.model.columns.some((column) => column.name === "exposure") ? [["exposure", EXPOSURE]] : [];
  return [...exposure, ["knee", KNEE], ["certificate", CERTIFICATE]];
}

/** A list of terms and meanings. */
export function wordList(state: State): HTMLElement {
  return make("dl", "words", words(state).flatMap(([word, meaning]) => [make("dt", "", word), make("dd", "", meaning)]));
}

/** Whether to show the explanations; never if the browser cannot store that they were closed. */
function isNew(): boolean {
  try {
    return window.localStorage.getItem(CLOSED) === null;
  } catch {
    return false;
  }
}

export function guideView(state: State): View {
  const list = make("div", "guide-words");
  const close = button("Got it", "close this hint for good; its words stay in the help (?)", () => {
    element.hidden = true;
    window.localStorage.setItem(CLOSED, "closed");
  });
  const element = make("aside", "guide", [list, close], { "aria-label": "what the words on this page mean" });
  const renew = (): void => {
    list.replaceChildren(wordList(state));
    if (state.model.n === 0) element.hidden = true;
  };
  element.hidden = !isNew();
  renew();
  return { element, renew, resize: () => undefined, drawBase: () => undefined, drawOverlay: () => undefined };
}
