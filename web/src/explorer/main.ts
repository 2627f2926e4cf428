// The page of a front, as `hpop.view.save_explorer` writes it.
import { addStyle, payloadOf } from "../shared/payload";
import { telling } from "./embedded";
import { follow } from "./live";
import { mount, type Page } from "./page";
import { SCHEMA, VERSION } from "./payload";
import css from "./style.css";
import viewsCss from "./views.css";

declare global {
  interface Window {
    /** The page, for tests, benchmarks, and what a live server sends. */
    hpop?: Page;
  }
}

addStyle(css + viewsCss);
const payload = payloadOf(SCHEMA, VERSION);
const { live, embedded } = payload as { live?: number; embedded?: boolean };
mount(document.body, payload, embedded === true ? telling() : { address: true }).then(
  (page) => {
    window.hpop = page;
    if (live !== undefined) follow(page, live);
  },
  (error: unknown) => {
    const words = document.createElement("p");
    words.textContent = `This page cannot be shown: ${error instanceof Error ? error.message : String(error)}`;
    document.body.append(words);
    throw error;
  },
);
