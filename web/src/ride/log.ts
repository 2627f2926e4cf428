// Log of the user's actions with their times, for studies: kept in the page, and saved as a file on request.
export interface Entry {
  /** s since the page was opened */
  readonly at: number;
  readonly what: string;
  readonly value: string | number | boolean;
}

export class Log {
  readonly entries: Entry[] = [];

  add(what: string, value: string | number | boolean): void {
    this.entries.push({ at: Math.round(performance.now()) / 1000, what, value });
  }

  /** Gives the entries to the user as a file. */
  save(): void {
    const text = JSON.stringify({ schema: "hpop-ride-log", version: 1, began: performance.timeOrigin, entries: this.entries });
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = "ride-log.json";
    link.click();
    URL.revokeObjectURL(link.href);
  }
}
