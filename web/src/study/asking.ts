// Screens that ask: consent, a form, a comparison of two rides, remarks.
import { type Voice, button, element } from "./dom";
import { answerTo, chosenOf } from "./events";
import type { Design, Form, Place, Plan } from "./model";
import { choices, markMissing, question } from "./questions";
import type { Recorder } from "./recorder";
import { smallMap } from "./small_map";

/** Context of a screen. */
export interface Context {
  readonly voice: Voice;
  readonly design: Design;
  readonly recorder: Recorder;
  readonly plan: Plan | null;
}

/** Most characters of a remark. */
const MOST_LETTERS = 2000;

export function title(text: string): HTMLElement {
  const heading = element("h1", "", text);
  heading.tabIndex = -1; // screen readers continue here when a step begins
  return heading;
}

function paragraphs(text: string): HTMLElement[] {
  return text.split(/\n\s*\n/).filter((part) => part.trim() !== "").map((part) => element("p", "text", part.trim()));
}

export function consent({ voice, design }: Context, agreed: () => void, declined: () => void): HTMLElement {
  const screen = element("section");
  screen.append(title(voice.say("consent_title")), ...paragraphs(design.consent));
  screen.append(...paragraphs(design.protocol.stop_rule), element("p", "", voice.say("stop_hint")));
  const label = element("label", "agree");
  const box = element("input");
  box.type = "checkbox";
  box.id = "agree";
  label.append(box, element("span", "", voice.say("agree")));
  const said = element("p", "said");
  said.setAttribute("role", "alert");
  const row = element("div", "row");
  const begin = button(voice.say("begin"), "", () => {
    if (box.checked) {
      agreed();
      return;
    }
    said.textContent = voice.say("agree_first");
    box.focus();
  });
  begin.className = "main";
  row.append(begin, button(voice.say("decline"), "", declined));
  screen.append(label, said, row);
  return screen;
}

/** Questions of a form; the page points out missing answers once, and then allows them. */
function asked(
  { voice }: Context,
  groups: readonly HTMLElement[],
  isAnswered: (i: number) => boolean,
  done: () => void,
): HTMLElement[] {
  const said = element("p", "said");
  said.setAttribute("role", "alert");
  const row = element("div", "row");
  const go = button(voice.say("continue"), "", () => {
    const missing = groups.filter((group, i) => {
      markMissing(group, isAnswered(i) ? "" : voice.say("missing_here"));
      return !isAnswered(i);
    });
    const first = missing[0];
    if (first === undefined) {
      done();
      return;
    }
    said.textContent = voice.say("missing", { count: missing.length });
    without.hidden = false;
    first.querySelector("input")?.focus();
    first.scrollIntoView({ block: "center" });
  });
  go.className = "main";
  go.id = "continue";
  const without = button(voice.say("continue_without"), "", done);
  without.id = "without";
  without.hidden = true;
  row.append(go, without);
  for (const group of groups) {
    group.addEventListener("change", () => { // fewer answers are missing than the page has said
      said.textContent = "";
      without.hidden = true;
    });
  }
  return [...groups, said, row];
}

export function form(
  context: Context,
  { form, place, condition }: { readonly form: Form; readonly place: number; readonly condition: string | null },
  done: () => void,
): HTMLElement {
  const { voice, recorder } = context;
  const screen = element("section");
  screen.append(title(voice.of(form.ask))); // a title may reveal what the study is about
  const groups = form.items.map((item) => {
    const answer = answerTo(recorder.events, place, form.id, item.id);
    return question(voice, form, item, typeof answer === "number" ? answer : undefined, (value) => {
      const at = condition === null ? { place } : { place, condition };
      recorder.add({ kind: "answer", ...at, form: form.id, item: item.id, value });
    });
  });
  const isAnswered = (i: number): boolean =>
    answerTo(recorder.events, place, form.id, form.items[i]!.id) !== undefined;
  screen.append(...asked(context, groups, isAnswered, done));
  return screen;
}

export function compare(
  context: Context,
  { form, pair }: { readonly form: Form; readonly pair: readonly [string, string] },
  done: () => void,
): HTMLElement {
  const { voice, recorder, plan, design } = context;
  const [first, second] = pair;
  const placeOf = (name: string): Place | undefined => design.places.find((at) => at.condition === name);
  const screen = element("section");
  screen.append(
    title(voice.say("compare_title")),
    element("p", "ask", voice.say("compare_of", {
      first, second, first_place: placeOf(first)?.place ?? 0, second_place: placeOf(second)?.place ?? 0, count: design.places.length,
    })),
  );
  const ways = pair.map((name) => plan?.ways[name]);
  if (plan !== null && ways.every((way) => way !== undefined)) {
    const maps = element("details", "maps");
    maps.append(element("summary", "", voice.say("compare_maps")));
    const row = element("div", "pair");
    pair.forEach((name, i) => {
      const figure = element("figure");
      figure.append(smallMap(plan, ways[i]!, voice.say("compare_map", { name })), element("figcaption", "", name));
      row.append(figure);
    });
    maps.append(row);
    screen.append(maps);
  }
  const groups = form.items.map((item) => {
    const options = [
      ...pair.map((name) => ({
        value: name, text: voice.say(placeOf(name)?.kind === "video" ? "video_title" : "ride_title", { name }), spoken: "",
      })),
      { value: "none", text: voice.say("compare_none"), spoken: "" },
    ];
    const group = choices(voice.of(item.text), options, chosenOf(recorder.events, pair, item.id) ?? null, (chosen) => {
      recorder.add({ kind: "compare", value: { question: item.id, pair, chosen } });
    });
    group.classList.add("worded");
    return group;
  });
  const isAnswered = (i: number): boolean => chosenOf(recorder.events, pair, form.items[i]!.id) !== undefined;
  screen.append(...asked(context, groups, isAnswered, done));
  return screen;
}

/** How many tones were heard. */
export function count({ voice, recorder }: Context, { place, condition }: Place, done: () => void): HTMLElement {
  const screen = element("section");
  const label = element("label", "typed");
  const field = element("input");
  field.type = "number";
  field.inputMode = "numeric";
  [field.min, field.max] = ["0", "999"];
  label.append(element("span", "unseen", voice.say("count_label")), field);
  const said = element("p", "said");
  said.setAttribute("role", "alert");
  const go = button(voice.say("continue"), "", () => {
    const value = Number(field.value);
    if (field.value === "" || !Number.isInteger(value) || value < 0 || value > 999) {
      said.textContent = voice.say("choose_number", { low: 0, high: 999 });
      field.focus();
      return;
    }
    recorder.add({ kind: "task", item: "count", place, condition, value: { value } });
    done();
  });
  go.className = "main";
  go.id = "continue";
  const row = element("div", "row");
  row.append(go);
  screen.append(title(voice.say("count_title")), element("p", "", voice.say("count_about")), label, said, row);
  return screen;
}

export function remarks({ voice, design, recorder }: Context, done: () => void): HTMLElement {
  const screen = element("section");
  const label = element("label", "remarks");
  const text = element("textarea");
  text.maxLength = MOST_LETTERS;
  text.rows = 6;
  label.append(element("span", "unseen", voice.say("remarks_label")), text);
  const place = design.places.length + 1;
  const before = recorder.events.findLast((event) => event.kind === "remark")?.value;
  if (typeof before === "string") text.value = before;
  text.addEventListener("change", () => { // saved whenever the field is left, so that nothing is lost by stopping
    recorder.add({ kind: "remark", place, value: text.value.trim() });
  });
  const go = button(voice.say("continue"), "", done);
  go.className = "main";
  go.id = "continue";
  const row = element("div", "row");
  row.append(go);
  screen.append(title(voice.say("remarks_title")), element("p", "", voice.say("remarks_about")), label, row);
  return screen;
}
