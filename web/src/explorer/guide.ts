// The words of the first screen, in one line each, until the reader closes them; afterwards they show on hover and in the help.
import { button, make } from "./dom";
import type { State } from "./state";
import type { View } from "./view";

const EXPOSURE = "how closely obstacles surround the camera, added up over time: ten seconds with a tenth of the view's ball filled cost 1 s.";
export const KNEE = "a good compromise. Beyond it, a small gain in one cost takes a large loss in another. You need not take it.";
export const CERTIFICATE = "what is proven: whether a better trajectory may be missing, and on which grid. Click the line above for the full text.";

/** What a page remembers in the browser: that its words were closed once. */
const CLOSED = "hpop.guide";

/** Words with their meanings; exposure only where the front has it. */
export function words(state: State): [string, string][] {
  const exposure: [string, string][] = state.model.columns.some((column) => column.name === "exposure") ? [["exposure", EXPOSURE]] : [];
  return [...exposure, ["knee", KNEE], ["certificate", CERTIFICATE]];
}

/** A list of words and meanings. */
export function wordList(state: State): HTMLElement {
  return make("dl", "words", words(state).flatMap(([word, meaning]) => [make("dt", "", word), make("dd", "", meaning)]));
}

/** Whether the words are still to be shown; never where a browser cannot remember that they were closed. */
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
