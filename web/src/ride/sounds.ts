// Sounds at exact times. The sound card has its own clock: its offset to the page's clock is measured again and again.
// Each sound is handed over before its time, so that a slow picture does not delay it, and is moved if the clocks drift.

/** Frequencies, Hz, one after the other, and the duration of each, s. */
const SOUNDS = {
  tone: { pitches: [440], each: 0.15 },
  signal: { pitches: [1320], each: 0.15 },
  chime: { pitches: [660, 880], each: 0.12 },
} as const;
export type Sound = keyof typeof SOUNDS;

const LOUD = 0.25;
/** s of fading in and out, without which a tone clicks */
const SOFT = 0.005;
/** ms for which a measured offset is kept; the offset is their median, and unsure while there are fewer than LEAST. */
const KEPT = 500;
const LEAST = 5;

/** A sound that was handed over: its beginning on the card's clock, s, and how to take it back. */
export interface Playing {
  readonly begin: number;
  readonly stop: () => void;
}

export class Sounds {
  private readonly context = new AudioContext({ latencyHint: "interactive" });
  private offsets: { readonly at: number; readonly offset: number }[] = [];

  /** Lets sounds begin; browsers allow it after a button was pressed. */
  open(): void {
    void this.context.resume();
  }

  /** Measures the offset of both clocks. */
  measure(): void {
    const { contextTime = 0, performanceTime = 0 } = this.context.getOutputTimestamp();
    if (contextTime <= 0 || performanceTime <= 0) return;
    const at = performance.now();
    this.offsets.push({ at, offset: performanceTime - 1000 * contextTime });
    while (this.offsets.length > LEAST && this.offsets[0]!.at < at - KEPT) this.offsets.shift();
  }

  /** Whether the clocks were compared often enough. */
  get isCompared(): boolean {
    return this.offsets.length >= LEAST;
  }

  /** Plays a sound at a time of the page's clock, ms, or now. */
  play(sound: Sound, at: number | null = null): Playing {
    const { context } = this;
    const begin = Math.max(at === null ? 0 : (at - this.offset) / 1000, context.currentTime);
    const { pitches, each } = SOUNDS[sound];
    const gain = context.createGain();
    gain.connect(context.destination);
    gain.gain.setValueAtTime(0, begin);
    gain.gain.linearRampToValueAtTime(LOUD, begin + SOFT);
    gain.gain.setValueAtTime(LOUD, begin + pitches.length * each - SOFT);
    gain.gain.linearRampToValueAtTime(0, begin + pitches.length * each);
    pitches.forEach((pitch, i) => {
      const tone = context.createOscillator();
      tone.frequency.value = pitch;
      tone.connect(gain);
      tone.start(begin + i * each);
      tone.stop(begin + (i + 1) * each);
    });
    return { begin, stop: () => { gain.disconnect(); } };
  }

  /** The page's time, ms, at which a sound with a beginning on the card's clock is heard. */
  heard(begin: number): number {
    return this.offset + 1000 * begin;
  }

  /** Stops the card's clock, or lets it go on: sounds that wait are later by the time of the pause. */
  pause(on: boolean): void {
    this.offsets = [];
    void (on ? this.context.suspend() : this.context.resume());
  }

  close(): void {
    void this.context.close();
  }

  private get offset(): number {
    const sorted = this.offsets.map(({ offset }) => offset).sort((a, b) => a - b);
    return sorted[sorted.length >> 1] ?? performance.now() - 1000 * this.context.currentTime;
  }
}
