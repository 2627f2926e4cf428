// How smoothly a ride was drawn. A ride that shows fewer than 60 pictures a second for a twentieth of its time is told:
// what people feel then may be the device's doing.

/** ms: longer than a sixtieth of a second by a seventh, so that a clock that trembles is not taken for a slow device. */
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

  /** Of a ride that begins at a time in ms: a first picture that comes late counts as well. */
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
