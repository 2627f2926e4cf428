// Clock of a ride: the current trajectory, its time and speed, and the corresponding time of another trajectory.
import type { Track } from "./track";

/** Trajectories are compared at equal times since the start, or at equal shares of the path. */
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

  /** The time of another trajectory that corresponds to the current time. */
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

  /** Advances by seconds of the viewer's time; returns whether the end was reached. */
  advance(seconds: number): boolean {
    if (!this.playing) return false;
    this.seek(this.t + this.speed * seconds);
    if (!this.atEnd) return false;
    this.playing = false;
    return true;
  }
}
