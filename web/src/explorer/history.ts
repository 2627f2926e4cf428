// History for undo and redo. During a drag, the last step is overwritten.

export class History<T> {
  private steps: T[];
  private place = 0;
  private open = false;

  constructor(first: T) {
    this.steps = [first];
  }

  get now(): T {
    return this.steps[this.place]!;
  }

  get canBack(): boolean {
    return this.place > 0;
  }

  get canForward(): boolean {
    return this.place < this.steps.length - 1;
  }

  /** Adds a step; `done` is false while the step goes on, as during a drag. */
  put(step: T, done: boolean): void {
    if (this.open) this.steps[this.place] = step;
    else {
      this.steps = [...this.steps.slice(0, this.place + 1), step];
      this.place++;
    }
    this.open = !done;
  }

  back(): boolean {
    if (!this.canBack) return false;
    this.open = false;
    this.place--;
    return true;
  }

  forward(): boolean {
    if (!this.canForward) return false;
    this.open = false;
    this.place++;
    return true;
  }

  /** Forgets all steps. */
  restart(first: T): void {
    this.steps = [first];
    this.place = 0;
    this.open = false;
  }
}
