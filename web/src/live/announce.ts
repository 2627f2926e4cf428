// Announcements of the next turn: an arrow, a tone, and the seconds until it. Each can be switched: studies compare them.
import { element } from "../shared/dom";
import type { Turn } from "./messages";

const LABELS: Readonly<Record<string, string>> = { arrow: "an arrow in the view", tone: "a tone", seconds: "the seconds until it" };
/** A message tells of another turn if its time is off by more, s. */
const ANOTHER = 1.2;
const AFTER = 0.7;
/** Hz, of the tone for a turn to the left and to the right. */
const TONES = { left: 440, right: 660 } as const;

export class Announcer {
  readonly overlay = element("div");
  readonly settings = element("fieldset");
  /** Read aloud by screen readers. */
  readonly spoken = element("p", "unseen");
  /** What is announced now; "" for nothing. */
  words = "";
  private readonly boxes = new Map<string, HTMLInputElement>();
  private turn: { at: number; turn: Turn } | null = null;
  private audio: AudioContext | null = null;

  constructor(
    settings: Readonly<Record<string, boolean>>,
    may: boolean,
    private readonly changed: (name: string, on: boolean) => void,
  ) {
    this.spoken.setAttribute("role", "status");
    this.overlay.id = "turn";
    this.overlay.hidden = true;
    this.overlay.setAttribute("aria-hidden", "true");
    this.settings.append(element("legend", "", "Before a turn, show or play"));
    this.settings.disabled = !may;
    for (const [name, text] of Object.entries(LABELS)) {
      const [label, box] = [element("label"), element("input")];
      box.type = "checkbox";
      box.checked = settings[name] ?? name !== "tone";
      box.addEventListener("change", () => {
        if (name === "tone" && box.checked) this.beep("left");
        this.changed(name, box.checked);
      });
      label.append(box, ` ${text}`);
      this.settings.append(label);
      this.boxes.set(name, box);
    }
  }

  /** Follows settings that were changed elsewhere. */
  set(settings: Readonly<Record<string, boolean>>): void {
    for (const [name, box] of this.boxes) box.checked = settings[name] ?? box.checked;
  }

  announce(turn: Turn): void {
    const at = performance.now() / 1000 + turn.in;
    const known = this.turn;
    this.turn = { at, turn };
    if (known !== null && known.turn.direction === turn.direction && Math.abs(known.at - at) < ANOTHER) return;
    if (this.isOn("tone")) this.beep(turn.direction);
    if (this.isOn("arrow") || this.isOn("seconds")) this.spoken.textContent = `${told(turn)}${this.isOn("seconds") ? ` in ${Math.ceil(turn.in)} s` : ""}`;
  }

  clear(): void {
    this.turn = null;
  }

  /** Counts the seconds down. */
  step(now: number): void {
    const left = this.turn === null ? -1 : this.turn.at - now / 1000;
    if (left < -AFTER) this.turn = null;
    const parts = [];
    if (this.turn !== null && this.isOn("arrow")) parts.push(`${this.turn.turn.direction === "left" ? "↰" : "↱"} ${told(this.turn.turn)}`);
    if (this.turn !== null && this.isOn("seconds")) parts.push(left > 0.5 ? `${parts.length > 0 ? "in" : "Turn in"} ${Math.round(left)} s` : "now");
    this.words = parts.join(" ");
    if (this.overlay.textContent !== this.words) this.overlay.textContent = this.words;
    this.overlay.hidden = this.words === "";
  }

  private isOn(name: string): boolean {
    return this.boxes.get(name)?.checked === true;
  }

  private beep(direction: "left" | "right"): void {
    this.audio ??= new AudioContext();
    const { audio } = this;
    const [tone, volume, side] = [audio.createOscillator(), audio.createGain(), audio.createStereoPanner()];
    tone.frequency.value = TONES[direction];
    side.pan.value = direction === "left" ? -0.7 : 0.7;
    volume.gain.setValueAtTime(0.2, audio.currentTime);
    volume.gain.exponentialRampToValueAtTime(0.001, audio.currentTime + 0.35);
    tone.connect(volume).connect(side).connect(audio.destination);
    tone.start();
    tone.stop(audio.currentTime + 0.4);
  }
}

function told({ direction, degrees }: Turn): string {
  return `Turn ${direction}${degrees > 0 ? ` ${Math.round(degrees)}°` : ""}`;
}
