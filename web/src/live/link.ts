// The connection to the server: it says that the viewer is here, comes back after a break, and sends what the viewer does.
import { type Message, messageOf, type Role } from "./messages";

/** ms between signs that the viewer is here: without one for half a second the robot brakes. */
const ALIVE = 150;
/** ms until the next attempt, at first and at most. */
const SOON = 400;
const LATE = 3000;
/** Directions of a viewer's head: ms between samples, and samples in a message. */
const SAMPLE = 1000 / 30;
const BATCH = 30;

export interface Listener {
  message(message: Message): void;
  /** The connection is there, or is gone; `again` after the first time. */
  connected(on: boolean, again: boolean): void;
}

export class Link {
  private socket: WebSocket | null = null;
  private wait = SOON;
  private was = false;
  private samples: [number, number, number][] = [];
  private sampled = 0;
  /** Whether the viewer wears a headset: the page then counts as visible. */
  worn = false;

  constructor(
    private readonly token: string,
    private readonly role: Role,
    private readonly listener: Listener,
  ) {
    setInterval(() => { if (this.isHere) this.send({ type: "alive" }); }, ALIVE);
    document.addEventListener("visibilitychange", () => { if (this.isHere) this.send({ type: "alive" }); });
    this.open();
  }

  /** Whether the page is in front of the viewer. */
  get isHere(): boolean {
    return this.worn || !document.hidden;
  }

  get isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Sends a message; returns whether there is a connection. */
  send(message: Message): boolean {
    if (!this.isOpen) return false;
    this.socket?.send(JSON.stringify(message));
    return true;
  }

  /** Notes where the viewer looks, rad from the robot's ahead: 30 times a second, sent each second. */
  look(yaw: number, pitch: number): void {
    const now = performance.now();
    if (now - this.sampled < SAMPLE - 1) return;
    this.sampled = now - this.sampled > 4 * SAMPLE ? now : this.sampled + SAMPLE;
    this.samples.push([Date.now(), rounded(yaw), rounded(pitch)]);
    if (this.samples.length < BATCH) return;
    this.send({ type: "head", samples: this.samples });
    this.samples = [];
  }

  private open(): void {
    const address = new URL("socket", location.href.replace(/[?#].*$/u, ""));
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.wait = SOON;
      this.send({ type: "hello", ...(this.token === "" ? {} : { token: this.token }), role: this.role });
      if (this.isHere) this.send({ type: "alive" });
      this.listener.connected(true, this.was);
      this.was = true;
    });
    socket.addEventListener("message", ({ data }: MessageEvent<unknown>) => {
      const message = typeof data === "string" ? messageOf(data) : null;
      if (message !== null) this.listener.message(message);
    });
    socket.addEventListener("close", () => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.samples = [];
      this.listener.connected(false, this.was);
      setTimeout(() => { this.open(); }, this.wait);
      this.wait = Math.min(1.6 * this.wait, LATE);
    });
  }
}

function rounded(angle: number): number {
  return Math.round(1e4 * angle) / 1e4;
}
