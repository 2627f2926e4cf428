// Keys of the page. Fields and buttons keep the keys that they need themselves.
import type { Mode } from "./destination";

export interface KeyUser {
  /** Takes a key that steers; returns whether it is one. */
  steer(key: string): boolean;
  look(left: number, up: number): void;
  ahead(): void;
  toMap(): void;
  enlarge(): void;
  toLandmarks(): void;
  headset(): void;
  help(): void;
  mode(mode: Mode): void;
  /** Drives the way of a card; returns whether there is one. */
  take(card: number): boolean;
  toggle(): void;
  stop(): void;
  /** Chooses the place in the middle of the view. */
  middle(): void;
}

/** Does what a key means, for a viewer who drives or only watches; returns whether it means anything. */
export function pressed(event: KeyboardEvent, user: KeyUser, drives: boolean, view: HTMLElement): boolean {
  const { target } = event;
  if (event.ctrlKey || event.altKey || event.metaKey || target instanceof HTMLSelectElement) return false;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const field = target instanceof HTMLInputElement;
  const activates = field || (target instanceof HTMLElement && ["BUTTON", "A", "SUMMARY"].includes(target.tagName));
  if (!field && drives && user.steer(key)) return true;
  const actions: Record<string, () => void> = {
    w: () => { user.look(0, 1); },
    a: () => { user.look(1, 0); },
    s: () => { user.look(0, -1); },
    d: () => { user.look(-1, 0); },
    r: () => { user.ahead(); },
    m: () => { user.toMap(); },
    b: () => { user.enlarge(); },
    v: () => { user.headset(); },
    "?": () => { user.help(); },
  };
  const driving: Record<string, () => void> = {
    g: () => { user.mode("go"); },
    t: () => { user.mode("stops"); },
    q: () => { user.mode("why"); },
    l: () => { user.toLandmarks(); },
    Escape: () => { user.stop(); },
    ...(activates ? {} : { " ": () => { user.toggle(); } }),
    ...(target === view ? { Enter: () => { user.middle(); } } : {}),
  };
  const action = actions[key] ?? (drives ? driving[key] : undefined);
  action?.();
  return action !== undefined || (drives && /^[1-9]$/u.test(key) && user.take(Number(key) - 1));
}
