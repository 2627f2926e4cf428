// Which trajectory is ridden, at what time, how fast; and what goes together with what when one switches.
import type { Track } from "./track";

/** Trajectories are compared at the same time since the start, or where the same share of the way is done. */
export type Together = "time" | "progress";

export const SPEEDS = [0.25, 0.5, 1, 2, 4] as const;

export class Clock {
  current = 0;
  /** s, of the current trajectory */
  t = 0;
  speed = 1;
  playing = false;
  together: Together = "time";

  constructor(readonly tracks: readonly Track[]) {}

  get track(): Track {
    return this.tracks[this.current]!;
  }

  get atEnd(): boolean {
    return this.t >= this.track.duration;
  }

  /** The time of another trajectory that goes together with now. */
  timeOf(other: number): number {
    const track = this.tracks[other]!;
    if (other === this.current) return this.t;
    if (this.together === "time") return Math.min(this.t, track.duration);
    return track.timeAt(this.track.progressAt(this.t));
  }

  switchTo(other: number): void {
    if (other < 0 || other >= this.tracks.length) return;
    const t = this.timeOf(other);
    this.current = other;
    this.t = t;
  }

  seek(t: number): void {
    this.t = Math.min(Math.max(t, 0), this.track.duration);
  }

  /** Lets so many seconds pass for who watches; whether that led to the end. */
  advance(seconds: number): boolean {
    if (!this.playing) return false;
    this.seek(this.t + this.speed * seconds);
    if (!this.atEnd) return false;
    this.playing = false;
    return true;
  }
}
