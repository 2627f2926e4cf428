// Title, how many are selected, how the search ended and what is claimed, in full; what is done to all rows.
import { button, make } from "./dom";
import { count } from "./numbers";
import type { State } from "./state";
import type { View } from "./view";

export interface Actions {
  readonly help: () => void;
  readonly copy: () => void;
}

export function headerView(state: State, actions: Actions): View {
  const title = make("h1");
  const counts = make("p", "counts", "", { "aria-live": "polite" });
  const badge = make("span", "status");
  const claim = make("span", "claim");
  const full = make("div", "claims");
  const details = make("details", "about", [make("summary", "", [badge, claim]), full]);
  const back = button("\u2190 Back", "take the last step back (Alt-Left)", () => { state.back(); });
  const forward = button("Forward \u2192", "take it again (Alt-Right)", () => { state.forward(); });
  const keep = button("Keep", "go on with the selected rows alone (K)", () => { state.keep("selected"); });
  const exclude = button("Exclude", "go on without the selected rows (X)", () => { state.keep("others"); });
  const all = button("All", "all rows again, no bounds (0)", () => { state.clear(); });
  const tools = make(
    "div",
    "tools",
    [
      make("div", "tool-group", [back, forward]),
      make("div", "tool-group", [keep, exclude, all]),
      make("div", "tool-group", [
        button("Copy\u2026", "copy what is chosen, as Python or for the command line (Y)", actions.copy),
        button("?", "help, keys (?)", actions.help),
      ]),
    ],
    { role: "toolbar", "aria-label": "selection" },
  );
  const element = make("header", "header", [make("div", "header-line", [title, counts, tools]), details]);

  function renew(): void {
    const { model } = state;
    title.textContent = model.title;
    title.title = model.title;
    badge.textContent = model.status;
    badge.classList.toggle("complete", model.complete);
    const notes = model.notes.length === 0 ? "" : model.notes.length === 1 ? " \u00b7 1 note" : ` \u00b7 ${model.notes.length} notes`;
    claim.textContent = (model.certificate[0] ?? "") + notes;
    full.replaceChildren(
      ...model.certificate.map((paragraph) => make("p", "", paragraph)),
      ...(model.notes.length > 0 ? [make("h2", "", "Notes"), make("ul", "", model.notes.map((note) => make("li", "", note)))] : []),
      make("p", "hint", "Classes of criteria: P performance, C comfort, R robot, O others; dashed axes are reported, not minimised."),
    );
    details.open = model.n === 0;
  }

  function drawBase(): void {
    const { model, history } = state;
    counts.replaceChildren(make("strong", "", count(state.count)), ` of ${count(model.n)}${model.n === 1 ? " trajectory" : " trajectories"}`);
    counts.classList.toggle("none", state.count === 0);
    back.disabled = !history.canBack;
    forward.disabled = !history.canForward;
    all.disabled = !state.isFiltered;
    keep.disabled = exclude.disabled = !state.isChosen;
  }

  renew();
  return { element, renew, resize: () => undefined, drawBase, drawOverlay: () => undefined };
}
