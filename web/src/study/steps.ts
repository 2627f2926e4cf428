// The steps of a session, in order, and the next step after the recorded events.
import { answerTo, chosenOf, type Event } from "./events";
import type { Design, Form, Place } from "./model";

export type Step =
  | { readonly kind: "consent" }
  | { readonly kind: "form"; readonly form: Form; readonly place: number; readonly condition: string | null }
  | { readonly kind: "ride"; readonly at: Place }
  | { readonly kind: "count"; readonly at: Place }
  | { readonly kind: "rest"; readonly after: Place }
  | { readonly kind: "compare"; readonly form: Form; readonly pair: readonly [string, string] }
  | { readonly kind: "remarks" }
  | { readonly kind: "end" };

function rated(design: Design, when: Form["when"][number]): Form[] {
  return Object.values(design.forms).filter((form) => form.kind !== "pairs" && form.when.includes(when));
}

/** All steps of a session that is not stopped. */
export function plan(design: Design): Step[] {
  const after = design.places.length + 1;
  const steps: Step[] = [{ kind: "consent" }];
  for (const form of rated(design, "before")) steps.push({ kind: "form", form, place: 0, condition: null });
  design.places.forEach((at, i) => {
    const before = design.places[i - 1];
    if (before !== undefined) steps.push({ kind: "rest", after: before });
    steps.push({ kind: "ride", at });
    if (at.tasks?.["counting"] !== undefined) steps.push({ kind: "count", at });
    for (const form of rated(design, "after_each")) {
      steps.push({ kind: "form", form, place: at.place, condition: at.condition });
    }
  });
  for (const form of rated(design, "after_all")) steps.push({ kind: "form", form, place: after, condition: null });
  for (const form of Object.values(design.forms).filter((one) => one.kind === "pairs")) {
    for (const pair of design.comparisons) steps.push({ kind: "compare", form, pair });
  }
  steps.push({ kind: "remarks" }, { kind: "end" });
  return steps;
}

/** Steps after a stop: how the participant feels, if any stimulus was seen. */
export function planAfterStop(design: Design, events: readonly Event[]): Step[] {
  const begun = events.findLast((e) => e.kind === "stimulus" && e.value === "begin");
  const end: Step = { kind: "end" };
  if (begun?.place === undefined) return [end];
  const each = rated(design, "after_each");
  const both = each.filter((form) => form.when.includes("before"));
  const forms = both.length > 0 ? both : each;
  const { place } = begun;
  // After a ride with answered questions, people may feel different from what they answered right after it.
  const isTold = forms.every((form) => form.items.every((item) => answerTo(events, place, form.id, item.id) !== undefined));
  const stopped = isTold
    ? { place: design.places.length + 1, condition: null }
    : { place, condition: begun.condition ?? null };
  return [...forms.map((form): Step => ({ kind: "form", form, ...stopped })), end];
}

function isOf(step: Step, event: Event): boolean {
  switch (step.kind) {
    case "consent": return event.kind === "consent" || event.kind === "start";
    case "form": return event.kind === "answer" && event.form === step.form.id && event.place === step.place;
    case "ride":
      return (event.kind === "stimulus" || event.kind === "frames" || (event.kind === "task" && event.item !== "count")) &&
        event.place === step.at.place;
    case "count": return isCount(event, step.at);
    case "rest": return event.kind === "pause" && event.place === step.after.place;
    case "compare": return event.kind === "compare" && step.form.items.some((i) => isChosen(step, event, i.id));
    case "remarks": return event.kind === "remark";
    case "end": return event.kind === "end";
  }
}

function isCount(event: Event, { place }: Place): boolean {
  return event.kind === "task" && event.item === "count" && event.place === place;
}

function isChosen(step: Step & { kind: "compare" }, event: Event, question: string): boolean {
  return chosenOf([event], step.pair, question) !== undefined;
}

function isDone(step: Step, events: readonly Event[]): boolean {
  switch (step.kind) {
    case "consent": return events.some((e) => e.kind === "start");
    case "form": return step.form.items.every((i) => answerTo(events, step.place, step.form.id, i.id) !== undefined);
    case "ride": return events.some((e) => e.kind === "stimulus" && e.value === "end" && e.place === step.at.place);
    case "count": return events.some((e) => isCount(e, step.at));
    case "rest": return events.some((e) => e.kind === "pause" && e.value === "end" && e.place === step.after.place);
    case "compare": return step.form.items.every((i) => chosenOf(events, step.pair, i.id) !== undefined);
    case "remarks": // until the end
    case "end": return false;
  }
}

/** Index of the step at which a session continues: the last one with events, or the next one if that is done. */
export function resumed(steps: readonly Step[], events: readonly Event[]): number {
  let last = 0;
  steps.forEach((step, i) => {
    if (events.some((event) => isOf(step, event))) last = i;
  });
  while (last < steps.length - 1 && isDone(steps[last]!, events)) last += 1;
  return last;
}
