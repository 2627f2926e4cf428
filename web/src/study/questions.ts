// Questions as the page asks them: an item is a group of choices, or a number to be typed where there are very many.
import { type Voice, element } from "./dom";
import { type Form, type Item, type Scale, valuesOf } from "./model";

/** Most choices that are shown as buttons; for more, a number is typed. */
const MOST_CHOICES = 21;
const MOST_IN_ROW = 11;
/** Most choices with words in a row on a phone; with more choices, rows of FEWER_WORDS. */
const MOST_WORDS = 4;
const FEWER_WORDS = 3;

let names = 0;

/** One question; `chosen` is called with each answer. */
export function question(
  voice: Voice,
  form: Form,
  item: Item,
  answer: number | undefined,
  chosen: (value: number) => void,
): HTMLElement {
  const scale = item.scale ?? form.scale;
  if (scale === null || scale === undefined) throw new Error(`form ${form.id}: item ${item.id} has no scale`);
  const values = valuesOf(scale);
  if (values.length > MOST_CHOICES) return typed(voice, item, scale, answer, chosen);
  const labels = scale.labels?.[voice.language] ?? [];
  const named = labels.length === values.length;
  const options = values.map((value, i) => ({
    value: String(value),
    text: named ? labels[i]! : String(value),
    spoken: named ? "" : endLabel(labels, i, values.length),
  }));
  if (scale.absent) options.push({ value: String(scale.absent.value), text: voice.of(scale.absent.text), spoken: "" });
  const group = choices(voice.of(item.text), options, answer === undefined ? null : String(answer), (value) => {
    chosen(Number(value));
  });
  group.classList.add(named ? "worded" : "numbered");
  if (!named && labels.length === 2) {
    const ends = element("p", "ends");
    ends.setAttribute("aria-hidden", "true"); // the labels are at the choices at both ends
    const says = (value: number, label: string): HTMLElement => element("span", "", `${value} = ${label}`);
    ends.append(says(scale.low, labels[0]!), says(scale.high, labels[1]!));
    group.append(ends);
  }
  return group;
}

export interface Option {
  readonly value: string;
  readonly text: string;
  /** Text that screen readers add. */
  readonly spoken: string;
}

/** A group of which one is chosen. */
export function choices(
  legend: string,
  options: readonly Option[],
  answer: string | null,
  chosen: (value: string) => void,
): HTMLFieldSetElement {
  const group = element("fieldset", "question");
  group.append(legendOf(legend));
  const row = element("div", "choices");
  row.style.setProperty("--count", String(Math.min(options.length, MOST_IN_ROW)));
  row.style.setProperty("--words", String(options.length > MOST_WORDS ? FEWER_WORDS : options.length));
  names += 1;
  for (const { value, text, spoken } of options) {
    const label = element("label");
    const input = element("input");
    input.type = "radio";
    input.name = `question-${names}`;
    input.value = value;
    input.checked = value === answer;
    input.addEventListener("change", () => {
      markMissing(group, "");
      chosen(value);
    });
    const shown = element("span", "", text);
    if (spoken !== "") shown.append(element("span", "unseen", `, ${spoken}`));
    label.append(input, shown);
    row.append(label);
  }
  group.append(row);
  return group;
}

/** Shows or removes the note beside a question that it has no answer. */
export function markMissing(group: HTMLElement, said: string): void {
  group.classList.toggle("missing", said !== "");
  group.querySelector(".lacks")!.textContent = said === "" ? "" : ` ${said}`;
}

/** What is asked, and room for what `markMissing` says. */
function legendOf(text: string): HTMLElement {
  const legend = element("legend", "", text);
  legend.append(element("span", "lacks"));
  return legend;
}

function endLabel(labels: readonly string[], i: number, count: number): string {
  if (labels.length !== 2) return "";
  return i === 0 ? labels[0]! : i === count - 1 ? labels[1]! : "";
}

function typed(
  voice: Voice,
  item: Item,
  scale: Scale,
  answer: number | undefined,
  chosen: (value: number) => void,
): HTMLElement {
  const group = element("fieldset", "question");
  group.append(legendOf(voice.of(item.text)));
  const label = element("label", "typed", `${voice.say("choose_number", { low: scale.low, high: scale.high })} `);
  const input = element("input");
  input.type = "number";
  input.min = String(scale.low);
  input.max = String(scale.high);
  input.step = String(scale.step ?? 1);
  if (answer !== undefined) input.value = String(answer);
  input.addEventListener("change", () => {
    if (input.value === "" || !input.reportValidity()) return;
    markMissing(group, "");
    chosen(Number(input.value));
  });
  label.append(input);
  group.append(label);
  return group;
}
