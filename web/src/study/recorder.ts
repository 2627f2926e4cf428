// Recorders of events: in the page, which offers them as a file; or at once on the study's own computer, one by one, in
// order, tried again until they have arrived. The page keeps, and shows the number of, events that have not arrived.
import { type Device, type Event, type Happening, dated, device } from "./events";
import type { Design } from "./model";

/** State of the events, for the page to show. */
export type Standing =
  | { readonly kind: "file" }
  | { readonly kind: "saved" }
  | { readonly kind: "saving" }
  | { readonly kind: "waiting"; readonly count: number }
  | { readonly kind: "elsewhere" }
  | { readonly kind: "withdrawn" }
  | { readonly kind: "refused"; readonly reason: string };

/** ms until an event that did not arrive is sent again, and until a request counts as failed */
const AGAIN = 2000;
const PATIENCE = 10000;

export abstract class Recorder {
  events: Event[] = [];
  readonly device: Device = device();
  changed: () => void = () => undefined;

  constructor(protected readonly design: Design) {}

  abstract get standing(): Standing;
  /** Whether events would be lost with the page. */
  abstract get isUnsaved(): boolean;
  /** The events of an earlier visit are there, once this is done. */
  abstract open(): Promise<void>;
  protected abstract keep(event: Event): void;

  /** Whether events can still be added. */
  get isOpen(): boolean {
    return true;
  }

  /** Adds an event; `at` is its time, ms, if it was earlier than now. */
  add(happening: Happening, at = Date.now()): void {
    if (!this.isOpen) return;
    const event = dated(happening, this.events, at);
    this.events.push(event);
    this.keep(event);
    this.changed();
  }

  get file(): string {
    return `${this.design.participant}.json`;
  }

  /** Hands all events over as a file. */
  save(): void {
    const { design, participant } = this.design;
    const answers = { schema: "hpop-answers", version: 1, design, participant, device: this.device, events: this.events };
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([JSON.stringify(answers)], { type: "application/json" }));
    link.download = this.file;
    link.click();
    URL.revokeObjectURL(link.href);
    this.changed();
  }
}

/** Recorder of a page that was opened as a file. */
export class InPage extends Recorder {
  private saved = 0;

  get standing(): Standing {
    return { kind: "file" };
  }

  get isUnsaved(): boolean {
    return this.saved < this.events.length;
  }

  get isHandedOver(): boolean {
    return this.saved > 0;
  }

  override save(): void {
    this.saved = this.events.length;
    super.save();
  }

  async open(): Promise<void> {
    // nothing is known of an earlier visit
  }

  protected keep(): void {
    // it is in the page
  }
}

interface Reply {
  readonly events?: Event[];
  readonly error?: string;
  /** "elsewhere" where another window has taken over, "withdrawn" where the participant has withdrawn. */
  readonly why?: string;
}

/** Recorder of a page that the study's own computer serves. */
export class Posted extends Recorder {
  private readonly waiting: Event[] = [];
  private readonly tab = crypto.randomUUID();
  private isSending = false;
  private failures = 0;
  private over: Standing | null = null;

  get standing(): Standing {
    if (this.over !== null) return this.over;
    if (this.failures > 0) return { kind: "waiting", count: Math.max(this.waiting.length, 1) };
    return this.waiting.length > 0 ? { kind: "saving" } : { kind: "saved" };
  }

  get isUnsaved(): boolean {
    return this.waiting.length > 0;
  }

  override get isOpen(): boolean {
    return this.over === null;
  }

  async open(): Promise<void> {
    const reply = await this.post({});
    this.events = reply?.events ?? [];
  }

  protected keep(event: Event): void {
    this.waiting.push(event);
    void this.send();
  }

  private async send(): Promise<void> {
    if (this.isSending) return;
    this.isSending = true;
    for (let event = this.waiting[0]; event !== undefined && this.over === null; event = this.waiting[0]) {
      if ((await this.post({ event })) !== null) this.waiting.shift();
      this.changed();
    }
    this.isSending = false;
  }

  /** Deletes everything of a withdrawn participant from this page. */
  private forget(): void {
    this.over = { kind: "withdrawn" };
    this.events = [];
    this.waiting.length = 0;
  }

  /** The reply of the study's computer, after retries; null if it refuses what was sent. */
  private async post(what: { readonly event?: Event }): Promise<Reply | null> {
    const { design, participant } = this.design;
    for (;;) {
      const body = JSON.stringify({ design, tab: this.tab, device: this.device, now: Date.now(), ...what });
      try {
        const reply = await fetch(`answers/${participant}`, {
          method: "POST",
          headers: { "Content-Type": "application/json" },
          body,
          keepalive: true, // requests on their way arrive even if the page is closed
          signal: AbortSignal.timeout(PATIENCE),
        });
        const said = (await reply.json()) as Reply;
        if (reply.status < 500) {
          this.failures = 0;
          if (reply.ok) return said;
          if (said.why === "elsewhere") this.over = { kind: "elsewhere" };
          else if (said.why === "withdrawn") this.forget();
          else this.over = { kind: "refused", reason: said.error ?? "" };
          this.changed();
          return null;
        }
      } catch {
        // no connection, or an invalid reply: try again
      }
      this.failures += 1;
      this.changed();
      await new Promise((done) => setTimeout(done, AGAIN));
    }
  }
}
