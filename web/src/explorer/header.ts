// The title, the number of selected rows, the status and certificate of the search, and buttons for all rows.
import { button, make } from "./dom";
import { CERTIFICATE } from "./guide";
import { count } from "./numbers";
import type { Tour } from "./payload";
import type { State } from "./state";
import type { View } from "./view";

export interface Actions {
  readonly help: () => void;
  readonly copy: () => void;
}

/** An order of stops to choose: its numbers, the stops that it misses, and the number of rows. */
function optionOf({ stops, orders, order }: Tour, one: string): HTMLOptionElement {
  const rows = Array.from(order).filter((index) => orders[index] === one).length;
  const missed = stops.flatMap((_, i) => (one.split(" ").includes(String(i + 1)) ? [] : [i + 1]));
  const without = missed.length === 0 ? "" : `, without ${missed.join(" ")}`;
  return make("option", "", `${one.replace(/ /g, " \u2192 ")}${without} (${count(rows)})`, { value: one });
}

export function headerView(state: State, actions: Actions): View {
  const title = make("h1");
  const counts = make("p", "counts", "", { "aria-live": "polite" });
  const badge = make("span", "status");
  const claim = make("span", "claim");
  const full = make("div", "claims");
  const details = make("details", "about", [
    make("summary", "", [badge, claim], { title: `certificate: ${CERTIFICATE}` }),
    full,
  ]);
  const order = make("select", "", [], { "aria-label": "order of stops" });
  order.addEventListener("change", () => { state.inOrder(order.value === "" ? null : order.value); });
  const orders = make("label", "orders", ["order of stops ", order], { title: "show only trajectories that visit the stops in this order; the map shows the numbers" });
  const back = button("\u2190 Back", "undo the last step (Alt-Left)", () => { state.back(); });
  const forward = button("Forward \u2192", "redo the step (Alt-Right)", () => { state.forward(); });
  const keep = button("Keep", "show only the selected rows (K)", () => { state.keep("selected"); });
  const exclude = button("Exclude", "hide the selected rows (X)", () => { state.keep("others"); });
  const all = button("All", "show all rows again, without bounds (0)", () => { state.clear(); });
  const tools = make(
    "div",
    "tools",
    [
      make("div", "tool-group", [back, forward]),
      make("div", "tool-group", [keep, exclude, all]),
      make("div", "tool-group", [
        button("Copy\u2026", "copy the selection as Python or as commands (Y)", actions.copy),
        button("?", "help and keys (?)", actions.help),
      ]),
    ],
    { role: "toolbar", "aria-label": "selection" },
  );
  const element = make("header", "header", [make("div", "header-line", [title, counts, orders, tools]), details]);

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
      make("p", "hint", "Criteria: P performance, C comfort, R robot, O other people. Dashed axes are reported, not minimised."),
    );
    details.open = model.n === 0;
    orders.hidden = model.tour === null || model.n === 0;
    order.replaceChildren(...(model.tour === null ? [] : [make("option", "", "any", { value: "" }), ...model.tour.orders.map((one) => optionOf(model.tour!, one))]));
  }

  function drawBase(): void {
    const { model, history } = state;
    counts.replaceChildren(make("strong", "", count(state.count)), ` of ${count(model.n)}${model.n === 1 ? " trajectory" : " trajectories"}`);
    counts.classList.toggle("none", state.count === 0);
    back.disabled = !history.canBack;
    forward.disabled = !history.canForward;
    order.value = state.filter.order ?? "";
    all.disabled = !state.isFiltered;
    keep.disabled = exclude.disabled = !state.isChosen;
  }

  renew();
  return { element, renew, resize: () => undefined, drawBase, drawOverlay: () => undefined };
}
