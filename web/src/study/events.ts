// The record: events in the order in which they happened, `hpop-answers` version 1. Nothing is changed or removed;
// of several answers to one item the last one counts.

export interface Compared {
  readonly question: string;
  readonly pair: readonly [string, string];
  readonly chosen: string;
}

export type Value = number | string | boolean | Compared | Readonly<Record<string, number | readonly (readonly number[])[]>>;

export type Kind =
  | "consent" | "start" | "stimulus" | "frames" | "task" | "answer" | "compare" | "remark" | "pause" | "stop" | "resume" | "end";

/** An event without its time. Place 0 is before the first stimulus, the last place is after all stimuli. */
export interface Happening {
  readonly kind: Kind;
  readonly place?: number;
  readonly condition?: string;
  readonly form?: string;
  readonly item?: string;
  readonly value?: Value;
}

export interface Event extends Happening {
  /** s since the first event; rises */
  readonly t: number;
  /** UTC, as ISO 8601 writes it */
  readonly at: string;
}

/** Device on which the session was seen. */
export interface Device {
  readonly browser: string;
  readonly touch: boolean;
  readonly width: number;
  readonly height: number;
  headset: boolean;
  /** Pictures a second of the smoothest ride so far; null before the first. */
  refresh_hz: number | null;
}

export function device(): Device {
  return {
    browser: navigator.userAgent.slice(0, 300),
    touch: navigator.maxTouchPoints > 0,
    width: window.innerWidth,
    height: window.innerHeight,
    headset: false,
    refresh_hz: null,
  };
}

/** A happening with its time, ms, after all events so far. */
export function dated(happening: Happening, before: readonly Event[], now: number): Event {
  const first = before[0];
  const last = before.at(-1);
  let t = 0;
  if (first !== undefined && last !== undefined) {
    const since = (now - Date.parse(first.at)) / 1000 + first.t;
    t = Math.max(since, last.t + 0.001); // clocks may be set back
  }
  return { t: Math.round(1000 * t) / 1000, at: new Date(now).toISOString(), ...happening };
}

/** The last answer to an item. */
export function answerTo(events: readonly Event[], place: number, form: string, item: string): Value | undefined {
  return events.findLast((e) => e.kind === "answer" && e.place === place && e.form === form && e.item === item)?.value;
}

/** The last choice between two rides. */
export function chosenOf(events: readonly Event[], pair: readonly [string, string], question: string): string | undefined {
  const found = events.findLast((e) => {
    if (e.kind !== "compare") return false;
    const value = e.value as Compared;
    return value.question === question && value.pair[0] === pair[0] && value.pair[1] === pair[1];
  });
  return (found?.value as Compared | undefined)?.chosen;
}
