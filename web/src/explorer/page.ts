// The page: views in their places, drawn at most once an animation frame; used by a file, a notebook and a live page.
import { axesView } from "./axes";
import { copyDialog, helpDialog } from "./dialogs";
import { make } from "./dom";
import { fragmentOf, restore } from "./fragment";
import { guideView } from "./guide";
import { headerView, type Actions } from "./header";
import { keyboard } from "./keyboard";
import { mapView } from "./map";
import { matrixView } from "./matrix";
import { decode } from "./payload";
import { pinsPanel } from "./pins";
import { State, type Change } from "./state";
import { tableView } from "./table";
import { onTheme, setPrinting } from "./theme";
import { traceView } from "./trace";
import { flatten, type View } from "./view";
import { wishPanel } from "./wish_panel";

const SETTLED = 250; // ms after the last change until the address is written: browsers limit how often it may change

const MOST_TIMES = 4096; // durations that are stored

export interface Callbacks {
  /** Called with the selected rows. */
  selected?(rows: number[]): void;
  /** Called with the row at the focus. */
  hovered?(row: number | null): void;
  /** Called with the pinned rows A, B, C. */
  pinned?(rows: (number | null)[]): void;
  /** Whether the address of the page holds the user's choices. */
  readonly address?: boolean;
}

/** Counters for tests and benchmarks: how often views were drawn, and how long it took. */
export interface Counters {
  /** ms that the last drawings of all bases, and of all overlays, took. */
  readonly base: number[];
  readonly overlay: number[];
  /** ms after the page began to load at which it was drawn first. */
  ready: number;
}

/** Work for the next frame. */
type Due = "renew" | "resize" | "base" | "sort" | "overlay";

export interface Page {
  readonly state: State;
  readonly counters: Counters;
  /** Replaces the data; bounds, pins, wishes and axes stay. */
  update(payload: unknown): Promise<void>;
}

/** Shows a payload in an element, whose size the page takes. */
export async function mount(element: HTMLElement, payload: unknown, callbacks: Callbacks = {}): Promise<Page> {
  const state = new State(await decode(payload));
  const copy = copyDialog(state);
  const help = helpDialog(state);
  const actions: Actions = { copy: copy.open, help: () => { help.showModal(); } };
  const table = tableView(state);
  const wishes = wishPanel(state);
  const ranked = [table, wishes]; // the order of rows affects only views that are cheap to draw
  const header = headerView(state, actions);
  const views: View[] = [
    header,
    axesView(state),
    mapView(state),
    matrixView(state),
    traceView(state),
    table,
    wishes,
    pinsPanel(state),
  ];
  const root = make("main", "hpop", [...views.map((view) => view.element), help, copy.element]);
  if (callbacks.address === true) { // a page of its own, not a part of a notebook
    const guide = guideView(state);
    header.element.append(guide.element);
    views.push(guide);
  }
  element.append(root);

  const sized = [root, ...root.querySelectorAll(".plot, .axes-scroll")];
  const sizes = (): string => sized.map((one) => `${one.clientWidth} ${one.clientHeight}`).join();
  let drawnAt = ""; // sizes to which the canvases were fitted
  const counters: Counters = { base: [], overlay: [], ready: 0 };
  const due = new Set<Due>();
  let asked = false;

  function timed(times: number[], drawn: readonly View[], draw: (view: View) => void): void {
    const begin = performance.now();
    drawn.forEach(draw);
    if (times.length >= MOST_TIMES) times.splice(0, MOST_TIMES / 2);
    times.push(performance.now() - begin);
  }

  function frame(): void {
    asked = false;
    if (due.has("renew")) {
      arrange();
      for (const view of views) view.renew();
    }
    if (due.has("renew") || due.has("resize")) {
      for (const view of views) view.resize();
      drawnAt = sizes();
    }
    if (due.has("renew") || due.has("resize") || due.has("base")) timed(counters.base, views, (view) => { view.drawBase(); });
    else if (due.has("sort")) for (const view of ranked) view.drawBase();
    due.clear();
    timed(counters.overlay, views, (view) => { view.drawOverlay(); });
  }

  function ask(what: Due): void {
    due.add(what);
    if (!asked) requestAnimationFrame(frame);
    asked = true;
  }

  /** Hides parts that have nothing to show. */
  function arrange(): void {
    root.classList.toggle("empty", state.model.n === 0);
  }

  const heard: Readonly<Record<Change, () => void>> = {
    data: () => { ask("renew"); },
    filter: () => { ask("base"); },
    axes: () => { ask("base"); },
    sort: () => { ask("sort"); },
    overlay: () => { ask("overlay"); },
  };
  state.listen((change) => {
    heard[change]();
    if (change === "overlay") {
      callbacks.hovered?.(state.focus);
      callbacks.pinned?.([...state.pins]);
    } else if (change !== "sort" && change !== "axes") {
      callbacks.selected?.(Array.from(state.selected.keys()).filter((row) => state.selected[row] === 1));
    }
  });
  if (callbacks.address === true) keepAddress(state);

  root.tabIndex = -1;
  const onKey = keyboard(state, table, actions);
  (callbacks.address === true ? document : root).addEventListener("keydown", (event) => { onKey(event as KeyboardEvent); });
  const watch = new ResizeObserver(() => {
    if (sizes() !== drawnAt) ask("resize");
  });
  onTheme(() => { ask("resize"); });
  let onPaper: HTMLElement | null = null; // the table as a whole, while the page is printed
  for (const [event, printing] of [["beforeprint", true], ["afterprint", false]] as const) {
    window.addEventListener(event, () => {
      setPrinting(printing);
      root.classList.toggle("printing", printing);
      root.classList.toggle("pinned", state.pins.some((row) => row !== null));
      onPaper?.remove();
      onPaper = printing && state.count > 0 ? table.printed() : null;
      if (onPaper !== null) element.append(onPaper);
      due.add("resize");
      frame();
      if (printing) flatten(root);
    });
  }
  arrange();
  frameNow();
  for (const one of sized) watch.observe(one);
  return {
    state,
    counters,
    update: async (other) => { state.replace(await decode(other)); },
  };

  function frameNow(): void {
    due.add("resize");
    frame();
    counters.ready = performance.now();
  }
}

/** Reads the fragment of the address now and after each change, and writes the selection into it. */
function keepAddress(state: State): void {
  let timer = 0;
  const read = (): void => {
    const given = location.hash.replace(/^#/, "");
    if (given !== fragmentOf(state)) restore(state, given);
  };
  const write = (): void => {
    const fragment = fragmentOf(state);
    if (fragment === location.hash.replace(/^#/, "")) return;
    history.replaceState(null, "", fragment === "" ? location.pathname + location.search : `#${fragment}`);
  };
  read();
  window.addEventListener("hashchange", read);
  state.listen(() => {
    window.clearTimeout(timer);
    timer = window.setTimeout(write, SETTLED);
  });
}
