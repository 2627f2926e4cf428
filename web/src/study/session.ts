// A session: its steps in order, and a bar with the progress, whether answers are saved, and the button
// that stops everything at once.
import { type Context, compare, consent, count, form, remarks, title } from "./asking";
import { Voice, button, element } from "./dom";
import type { Session as Given } from "./model";
import { InPage, Posted, type Standing } from "./recorder";
import { type Screen, declined, end, live, rest, ride, video } from "./showing";
import { type Step, plan, planAfterStop, resumed } from "./steps";

export class Session {
  private readonly voice: Voice;
  private readonly context: Context;
  private readonly recorder: InPage | Posted;
  private readonly bar = element("header");
  private readonly progress = element("span", "progress");
  private readonly saved = element("span", "saved");
  private readonly banner = element("div", "banner");
  private readonly main = element("main");
  private readonly dialog = element("dialog");
  private readonly stop: HTMLButtonElement;
  private steps: Step[];
  private at = 0;
  private isStopped = false;
  private screen: Screen | null = null;

  constructor(private readonly given: Given) {
    this.voice = new Voice(given);
    this.recorder = given.served ? new Posted(given.form) : new InPage(given.form);
    this.recorder.changed = () => { this.showStanding(); };
    this.context = { voice: this.voice, design: given.form, recorder: this.recorder, plan: given.plan };
    this.steps = plan(given.form);
    this.stop = button(this.voice.say("stop"), "", () => { this.askToStop(); });
    this.stop.id = "stop";
    this.saved.setAttribute("role", "status");
    this.banner.setAttribute("role", "alert");
    this.bar.append(element("strong", "", given.form.participant), this.progress, this.saved, this.stop);
    this.main.id = "step";
    this.makeDialog();
    document.body.append(this.bar, this.banner, this.main, this.dialog);
    window.addEventListener("beforeunload", (event) => {
      if (this.recorder.isUnsaved) event.preventDefault();
    });
    this.showStanding();
  }

  /** Begins, or continues after the events of an earlier visit. */
  async begin(): Promise<void> {
    await this.recorder.open();
    if (!this.recorder.isOpen) return;
    const { events } = this.recorder;
    if (events.some((event) => event.kind === "stop")) {
      this.isStopped = true;
      this.steps = planAfterStop(this.given.form, events);
    }
    this.at = this.isStopped ? resumedAfterStop(this.steps, this.context) : resumed(this.steps, events);
    if (events.some((event) => event.kind === "end")) this.at = this.steps.length - 1;
    else if (events.length > 0) this.recorder.add({ kind: "resume" });
    this.show();
    this.showStanding();
    document.documentElement.dataset["ready"] = "yes";
  }

  // Steps

  private next(): void {
    this.at = Math.min(this.at + 1, this.steps.length - 1);
    this.show();
  }

  private show(): void {
    const step = this.steps[this.at]!;
    this.screen?.leave?.();
    this.screen = null; // its traces are in the record before those of the next
    const screen = this.screenOf(step);
    this.screen = screen;
    this.place(screen);
    const isOver = step.kind === "end";
    this.progress.textContent = isOver ? "" : this.voice.say("step", { step: this.at + 1, steps: this.steps.length });
    this.stop.hidden = isOver;
  }

  private place(screen: Screen): void {
    this.main.replaceChildren(screen.root);
    document.body.classList.toggle("wide", screen.isWide === true);
    window.scrollTo(0, 0);
    screen.root.querySelector("h1")?.focus();
  }

  private screenOf(step: Step): Screen {
    const { context, recorder } = this;
    const next = (): void => { this.next(); };
    switch (step.kind) {
      case "consent":
        return {
          root: consent(context, () => {
            recorder.add({ kind: "consent", value: true });
            recorder.add({ kind: "start" });
            next();
          }, () => { this.decline(); }),
        };
      case "form": {
        const root = form(context, step, next);
        if (this.isStopped && this.at === 0) {
          root.prepend(title(this.voice.say("stopped_title")), element("p", "", this.voice.say("stopped_about")));
        }
        return { root };
      }
      case "ride": {
        if (step.at.kind === "live" || step.at.kind === "robot") return live(context, step.at, next);
        const page = this.given.rides[step.at.condition];
        const show = (): Screen => ride(context, step.at, { text: page ?? "", bundle: this.given.bundle }, next);
        if (step.at.kind !== "video") return show();
        const here = page === undefined || !this.given.served ? null : (): void => {
          this.screen = show();
          this.place(this.screen);
        };
        return video(context, step.at, here, next);
      }
      case "count": return { root: count(context, step.at, next) };
      case "rest": return rest(context, step.after, this.given.form.protocol.rest_s, next);
      case "compare": return { root: compare(context, step, next) };
      case "remarks": return { root: remarks(context, next) };
      case "end":
        if (!recorder.events.some((event) => event.kind === "end")) recorder.add({ kind: "end" });
        return end(context, this.isStopped);
    }
  }

  // Stopping

  private makeDialog(): void {
    const yes = button(this.voice.say("stop_yes"), "", () => {
      this.dialog.close();
      this.stopped();
    });
    yes.className = "danger";
    const no = button(this.voice.say("stop_no"), "", () => { this.dialog.close(); });
    const row = element("div", "row");
    row.append(yes, no);
    const heading = element("h2", "", this.voice.say("stop_title"));
    heading.id = "stop-title";
    this.dialog.setAttribute("aria-labelledby", heading.id);
    this.dialog.append(heading, element("p", "", this.voice.say("stop_about")), row);
    this.dialog.addEventListener("close", () => {
      if (!this.isStopped && this.steps[this.at]?.kind === "ride" && this.screen === null) this.show();
    });
  }

  /** Asks whether to stop; a running ride ends at once, whatever the answer. */
  private askToStop(): void {
    if (this.steps[this.at]?.kind === "ride") {
      this.screen?.leave?.();
      this.screen = null;
      this.main.replaceChildren();
    }
    this.dialog.showModal();
  }

  private stopped(): void {
    if (this.steps[this.at]?.kind === "consent") {
      this.decline();
      return;
    }
    this.screen?.leave?.();
    this.screen = null;
    if (!this.isStopped) {
      this.recorder.add({ kind: "stop" });
      this.isStopped = true;
      this.steps = planAfterStop(this.given.form, this.recorder.events);
      this.at = 0;
    } else {
      this.at = this.steps.length - 1; // a second stop is not questioned
    }
    this.show();
  }

  private decline(): void {
    this.stop.hidden = true;
    this.progress.textContent = "";
    this.place(declined(this.context));
  }

  // What the page says of its answers

  private showStanding(): void {
    const { standing } = this.recorder;
    const short: Partial<Record<Standing["kind"], string>> = { saved: "saved", saving: "saving" };
    const name = short[standing.kind];
    const hasAny = this.recorder.events.length > 0;
    this.saved.textContent = name !== undefined && hasAny ? this.voice.say(name) : "";
    const said = this.said(standing);
    const isLost = standing.kind === "elsewhere" || standing.kind === "refused" || standing.kind === "withdrawn";
    if (isLost) {
      this.screen?.leave?.();
      this.screen = null;
      this.main.replaceChildren();
      this.stop.hidden = true;
      this.dialog.close();
      this.progress.textContent = "";
    }
    if (said === this.banner.firstChild?.textContent) return;
    this.banner.replaceChildren();
    this.banner.className = `banner ${standing.kind}`;
    if (said === "") return;
    this.banner.append(element("p", "", said));
    if (standing.kind === "waiting" || (isLost && this.recorder.isUnsaved)) {
      this.banner.append(button(this.voice.say("save_file"), "", () => { this.recorder.save(); }));
    }
  }

  /** Whether all events of a page that was opened as a file were saved to a file. */
  private isHandedOver(): boolean {
    return this.recorder instanceof InPage && this.recorder.isHandedOver && !this.recorder.isUnsaved;
  }

  private said(standing: Standing): string {
    switch (standing.kind) {
      case "file": return this.isHandedOver() ? "" : this.voice.say("file_warning");
      case "waiting": return this.voice.say("unsaved", { count: standing.count });
      case "elsewhere": return this.voice.say("elsewhere");
      case "withdrawn": return this.voice.say("withdrawn");
      case "refused": return this.voice.say("refused", { reason: standing.reason });
      default: return "";
    }
  }
}

/** Index of the first step after a stop that is not answered yet. */
function resumedAfterStop(steps: readonly Step[], { recorder }: Context): number {
  const since = recorder.events.slice(recorder.events.findLastIndex((event) => event.kind === "stop"));
  return resumed(steps, since);
}
