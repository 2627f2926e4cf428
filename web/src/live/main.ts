// The live page: choose where to go, be offered ways, drive, and be told why. It draws what `hpop live` sends.
import { addStyle } from "../shared/payload";
import { element } from "../shared/dom";
import { Link } from "./link";
import { type Message, type Role, sceneOf, words } from "./messages";
import { Page } from "./page";
import css from "./style.css";

addStyle(css);
const payload = JSON.parse(document.getElementById("payload")?.textContent ?? "{}") as Readonly<Record<string, unknown>>;
const watches = payload["role"] === "watch" || /\bwatch\b/u.test(location.search + location.hash);
const role: Role = watches ? "watch" : "drive";
const waiting = element("p", "waiting", "Waiting for the robot …");
waiting.setAttribute("role", "status");
document.body.append(waiting);
let page: Page | null = null;
let shown = "";

function failed(error: unknown): void {
  const reason = error instanceof Error ? error.message : String(error);
  waiting.textContent = /webgl/i.test(reason)
    ? "This browser cannot draw WebGL, which this page needs. Try another browser, or turn on hardware acceleration in its settings."
    : reason;
  document.body.replaceChildren(waiting);
}

function received(message: Message): void {
  if (message.type !== "scene") {
    page?.receive(message);
    return;
  }
  const text = JSON.stringify(message); // another scene comes with another role, or after a restart of the server
  if (text === shown) return;
  shown = text;
  const scene = sceneOf(message);
  if (scene.title !== "") document.title = `${scene.title}: drive`;
  waiting.remove();
  page?.close();
  page = new Page(scene, link, words(payload["licence"]) || words(message["licence"]));
}

const link = new Link(words(payload["token"]), role, {
  message(message) {
    try {
      received(message);
    } catch (error) {
      failed(error);
    }
  },
  connected(on, again) {
    if (page === null) waiting.textContent = on ? "Waiting for the robot …" : "No connection to the robot. Trying again …";
    page?.connected(on, again);
  },
});
