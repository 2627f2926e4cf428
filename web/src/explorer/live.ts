// Live page: `hpop plan --web` sends each front that the running search finds; the user's choices stay.
import { make } from "./dom";
import type { Page } from "./page";

/** Shows the fronts that a server sends after the page's own front, and whether more may come. */
export function follow(page: Page, seen: number): void {
  const note = make("p", "live", "live: the search is running", { role: "status" });
  document.querySelector(".header .counts")?.after(note);
  const source = new EventSource(`events?after=${seen}`);
  let shown = Promise.resolve();
  source.addEventListener("open", () => { note.textContent = "live: the search is running"; });
  source.addEventListener("front", ({ data }: MessageEvent<string>) => {
    const told = shown.then(() => page.update(JSON.parse(data) as unknown)); // one after another
    shown = told.catch((error: unknown) => { // later fronts are shown nevertheless
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
