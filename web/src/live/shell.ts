// The frame of the page: the view, the side with the map and all panels, the bar with the brake, and what the page says.
import type { Point } from "../ride/model";
import { button, element } from "../shared/dom";
import { Camera } from "./camera";
import type { LiveScene } from "./messages";

const NOTES = 30;
/** Reasons of the server for which the robot brakes that need no alarm: the viewer asked for it. */
const WANTED = "stopped";

export interface ShellUser {
  toggle(): void;
  headset(): void;
  help(): void;
}

export class Shell {
  readonly root = element("div");
  readonly canvas = element("canvas");
  readonly map = element("canvas");
  private readonly camera: Camera | null = null;
  private readonly view = element("main");
  private readonly side = element("aside");
  private readonly go: HTMLButtonElement;
  private readonly toHeadset: HTMLButtonElement;
  private readonly said = element("p");
  private readonly alarm = element("p");
  private readonly notes = element("div");
  private readonly alarms = new Map<string, string>();

  constructor(
    scene: LiveScene,
    private readonly drives: boolean,
    user: ShellUser,
  ) {
    this.root.id = "live";
    this.root.classList.toggle("watch", !drives);
    this.go = button("", "Stop the robot, or let it drive on (Space)", () => { user.toggle(); });
    this.go.id = "go";
    this.toHeadset = button("Headset", "Enter the headset (V); Esc leaves it at once", () => { user.headset(); });
    this.toHeadset.hidden = true;
    this.said.id = "said";
    this.said.setAttribute("role", "status");
    this.alarm.id = "alarm";
    this.alarm.setAttribute("role", "alert");
    this.alarm.hidden = true;
    this.notes.setAttribute("role", "log");
    this.notes.tabIndex = 0; // it may scroll
    this.notes.setAttribute("aria-label", "Notes");
    this.view.id = "view";
    this.side.id = "side";
    this.side.setAttribute("aria-label", "Map, destination and ways");
    this.canvas.id = "seen";
    this.focusable(this.canvas, "The robot’s view. Enter chooses the place in the middle of the view; W, A, S and D look around; arrow keys push the robot.");
    this.map.id = "map";
    this.focusable(this.map, "Map: the robot, the people and the ways. Arrow keys move a cross, Enter chooses its place.");
    const spot = element("div", "", "+");
    spot.id = "spot";
    spot.setAttribute("aria-hidden", "true");
    this.view.append(element("h1", "unseen", document.title));
    if (scene.video !== "") {
      const lost = "The picture of the robot’s camera is lost. Trying again …";
      this.camera = new Camera(scene.video, (is) => { this.alert("video", is ? lost : ""); });
      this.view.append(this.camera.root);
    }
    this.view.append(this.canvas, spot, this.alarm);
    this.root.append(this.view, this.side, this.bar(scene, user));
    this.showGo(false, true);
  }

  /** Puts panels beside the view, and others over it; shows the page. */
  fill(over: readonly HTMLElement[], panels: readonly HTMLElement[], dialog: HTMLDialogElement): void {
    const log = element("section");
    log.id = "notes";
    log.append(element("h2", "", "Notes"), this.notes);
    this.view.append(...over);
    const below = element("div");
    below.id = "panels";
    below.tabIndex = 0; // it may scroll
    below.setAttribute("role", "group");
    below.setAttribute("aria-label", "Destination, ways and notes");
    below.append(...panels, log);
    const chart = element("div");
    chart.id = "chart";
    const larger = button("Larger map", "A larger map and a smaller view, or back (B)", () => { this.enlarge(); });
    larger.id = "larger";
    chart.append(this.map, larger);
    this.side.append(chart, below);
    this.root.append(dialog);
    document.body.append(this.root);
  }

  /** Makes the map large and the view small, or back. */
  enlarge(): void {
    const large = this.root.classList.toggle("charted");
    this.map.scrollIntoView({ block: "nearest" });
    this.root.querySelector("#larger")!.textContent = large ? "Smaller map" : "Larger map";
  }

  /** Offers the headset, unless there is a video, which it could not show. */
  offerHeadset(is: boolean): void {
    this.toHeadset.hidden = !is || this.camera !== null;
  }

  /** Fits the camera's picture to its field of view, given as shares of the view; without, it fills the view. */
  frame(shares: Point | null): void {
    this.camera?.frame(shares);
  }

  say(words: string): void {
    this.said.textContent = words;
  }

  note(words: string): void {
    const time = new Date().toLocaleTimeString("en-GB");
    this.notes.prepend(element("p", "", `${time}  ${words}`));
    while (this.notes.children.length > NOTES) this.notes.lastElementChild?.remove();
  }

  /** The connection is there, or is lost. */
  connected(on: boolean): void {
    this.alert("lost", on ? "" : "The connection is lost; the robot brakes. Trying again …");
  }

  /** The robot brakes for a reason; "" if it does not. */
  braked(why: string): void {
    this.alert("braked", why === "" || why === WANTED ? "" : `The robot brakes: ${why}.`);
  }

  showGo(stopped: boolean, moves: boolean): void {
    this.go.textContent = stopped ? "▶ Go" : "■ Stop";
    this.go.classList.toggle("stop", !stopped && moves);
  }

  private alert(kind: string, words: string): void {
    this.alarms.set(kind, words);
    const all = ["lost", "braked", "video"].map((one) => this.alarms.get(one)).find((one) => one !== undefined && one !== "") ?? "";
    if (this.alarm.textContent !== all) this.alarm.textContent = all;
    this.alarm.hidden = all === "";
  }

  private focusable(canvas: HTMLCanvasElement, label: string): void {
    canvas.tabIndex = 0;
    canvas.setAttribute("role", this.drives ? "application" : "img");
    canvas.setAttribute("aria-label", label);
  }

  private bar(scene: LiveScene, user: ShellUser): HTMLElement {
    const [bar, tools] = [element("footer"), element("div", "row tools")];
    bar.id = "bar";
    if (scene.explorer !== "") {
      const explore = element("a", "button", "Explore");
      explore.href = scene.explorer;
      explore.target = "_blank";
      explore.title = "All ways in the explorer, in a window of its own";
      tools.append(explore);
    }
    tools.append(this.toHeadset, button("Help", "How to drive, and the keys (?)", () => { user.help(); }));
    bar.append(this.drives ? this.go : element("strong", "watching", "Watching"), this.said, tools);
    return bar;
  }
}
