// A search that runs: `hpop plan --web` sends each front as it is found, and the page keeps what was chosen.
import { make } from "./dom";
import type { Page } from "./page";

/** Shows what a server sends after the front that the page was made of; says beside the counts whether more may come. */
export function follow(page: Page, seen: number): void {
  const note = make("p", "live", "live: the search is running", { role: "status" });
  document.querySelector(".header .counts")?.after(note);
  const source = new EventSource(`events?after=${seen}`);
  let shown = Promise.resolve();
  source.addEventListener("open", () => { note.textContent = "live: the search is running"; });
  source.addEventListener("front", ({ data }: MessageEvent<string>) => {
    const told = shown.then(() => page.update(JSON.parse(data) as unknown)); // one after another
    shown = told.catch((error: unknown) => { // the next ones are shown all the same
      note.textContent = `live: the newest front cannot be shown: ${String(error)}`;
    });
  });
  source.addEventListener("end", () => {
    source.close();
    void shown.then(() => {
      const { complete, status } = page.state.model;
      note.textContent = `${complete ? "complete" : status}: the search has ended; front.html has its results`;
    });
  });
  source.addEventListener("error", () => { note.textContent = "no connection: the command may have ended"; });
}
