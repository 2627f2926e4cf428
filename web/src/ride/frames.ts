// How smoothly a ride was drawn. A ride with fewer than 60 pictures a second for a twentieth of its time is reported:
// the device may then be the cause of what people feel.

/** ms: a seventh longer than a sixtieth of a second, so that jitter of the clock does not count as slow. */
const SLOW = (8 / 7) * (1000 / 60);
const MOST_SLOW = 0.05;

export interface FrameReport {
  /** Pictures shown. */
  readonly count: number;
  /** s, from the beginning to the last of them */
  readonly seconds: number;
  /** Share of that time in which fewer than 60 a second were shown. */
  readonly slow: number;
  /** ms */
  readonly longest: number;
  readonly flagged: boolean;
}

export class Frames {
  private count = 0;
  private all = 0;
  private slow = 0;
  private longest = 0;

  /** Begins at the time of the ride's start, ms, so that a late first picture counts as well. */
  constructor(private last: number) {}

  /** A picture is shown, at a time in ms. */
  shown(now: number): void {
    const step = Math.max(now - this.last, 0);
    this.all += step;
    if (step > SLOW) this.slow += step;
    this.longest = Math.max(this.longest, step);
    this.last = now;
    this.count += 1;
  }

  get report(): FrameReport {
    const slow = this.all > 0 ? this.slow / this.all : 0;
    return {
      count: this.count,
      seconds: rounded(this.all / 1000),
      slow: rounded(slow),
      longest: rounded(this.longest),
      flagged: slow >= MOST_SLOW,
    };
  }
}

function rounded(value: number): number {
  return Math.round(1000 * value) / 1000;
}
