// Elements of the page, and what it says. Texts are set as text: what comes from a file is never markup.
import type { Session, Text } from "./model";

export { button, element } from "../shared/dom";

/** Texts in the language of the study. */
export class Voice {
  readonly words: Session["words"];
  readonly language: string;

  constructor({ words, form }: Session) {
    this.words = words;
    this.language = form.language;
  }

  /** A text of the page by its name, with its placeholders filled. */
  say(name: string, gaps: Readonly<Record<string, string | number>> = {}): string {
    let text = this.words[name] ?? name;
    for (const [gap, filling] of Object.entries(gaps)) text = text.replaceAll(`{${gap}}`, () => String(filling));
    return text;
  }

  /** A text of a form. */
  of(text: Text): string {
    return text[this.language] ?? Object.values(text)[0] ?? "";
  }
}
