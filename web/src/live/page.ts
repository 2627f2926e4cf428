// The live page: the robot's view, the map, where to go, the ways there, and what the robot says.
import { GazeButtons } from "../ride/gaze";
import { Headset } from "../ride/headset";
import type { Point, Vector } from "../ride/model";
import { element } from "../shared/dom";
import { Announcer } from "./announce";
import { type Drawn, drawnCard, DRIVEN, PICKED, WHY } from "./colours";
import { Destination } from "./destination";
import { helpDialog } from "./help";
import { type KeyUser, pressed } from "./keyboard";
import type { Link } from "./link";
import { type LiveScene, type Message, namesOf, optionsOf, placeOf, stateOf, turnOf, whyOf, words } from "./messages";
import { Minimap } from "./minimap";
import { Motion } from "./motion";
import { Plate } from "./plate";
import { Regions } from "./regions";
import { Shell } from "./shell";
import { Steering } from "./steering";
import { type Pointed, View } from "./view";
import { Ways } from "./ways";

const LONGEST = 0.25; // s: time step of a picture, for a page that was hidden
const MAP_EVERY = 50; // ms between pictures of the map
const VIGNETTE = 0.85;
const STOPPED = "stopped"; // the reason of the server while the viewer's stop holds

export class Page {
  private readonly shell: Shell;
  private readonly view: View;
  private readonly minimap: Minimap;
  private readonly motion = new Motion();
  private readonly destination: Destination;
  private readonly ways: Ways;
  private readonly regions: Regions;
  private readonly announcer: Announcer;
  private readonly steering = new Steering((direction) => { this.send({ type: "push", direction }); });
  private readonly headset: Headset;
  private readonly gaze: GazeButtons;
  private readonly plate = new Plate();
  private readonly dialog: HTMLDialogElement;
  private readonly drives: boolean;
  private readonly listening = new AbortController();
  private stopped = false;
  private moves = false;
  private narrow = matchMedia("(prefers-reduced-motion: reduce)").matches;
  private asked: Point | null = null;
  private last = 0;
  private mapped = 0;
  private placed = "";

  constructor(
    scene: LiveScene,
    private readonly link: Link,
    licence: string,
  ) {
    this.drives = scene.role === "drive";
    const send = (message: Message): void => { this.send(message); };
    const changed = (): void => { this.draw(); };
    this.shell = new Shell(scene, this.drives, {
      toggle: () => { this.halt(!this.stopped); },
      headset: () => { void this.headset.enter(); },
      help: () => { this.dialog.showModal(); },
    });
    const { landmarks } = scene.scene;
    const named = landmarks.filter(({ name }) => name !== "").map(({ name, x, y }): [string, Point] => [name, [x, y]]);
    this.destination = new Destination(new Map(named), { send, changed });
    this.ways = new Ways(scene.criteria, this.drives, {
      take: (option, asked) => { this.send({ type: "take", option, asked }); },
      wish: (wish) => { this.send({ type: "wish", wish }); },
      picked: changed,
    });
    this.regions = new Regions(scene.regions, scene.closed, this.drives, (message) => {
      this.asked = null;
      this.send(message);
      this.draw();
    }, () => {
      this.asked = null;
      this.draw();
    });
    const set = (name: string, value: boolean): void => { this.send({ type: "setting", name, value }); };
    this.announcer = new Announcer(scene.settings, this.drives, set);
    this.view = new View(this.shell.canvas, scene, (pointed) => { this.pointedAt(pointed); });
    const crossed = ([x, y]: Point): void => { this.say(`Cross at ${x.toFixed(1)} m, ${y.toFixed(1)} m`); };
    this.minimap = new Minimap(this.shell.map, scene, (at) => { this.choose(at); }, crossed);
    this.gaze = new GazeButtons([
      { label: () => (this.stopped ? "Go" : "Stop"), press: () => { this.halt(!this.stopped); } },
      { label: () => (this.ways.options.cards.length > 0 ? "Next way" : "No way yet"), press: () => { this.nextWay(); } },
      { label: () => (this.destination.mode === "why" ? "Go there" : "Why not?"), press: () => { this.destination.setMode(this.destination.mode === "why" ? "go" : "why"); } },
      { label: () => "Leave", press: () => { this.headset.leave(); } },
    ]);
    this.headset = new Headset(this.view.stage, this.gaze, (on) => { this.worn(on); }, () => { this.select(); });
    this.view.stage.rig.add(this.plate.object, this.controller);
    this.steering.sticks = () => this.sticks();
    this.dialog = helpDialog([{ label: "Dark margins while the robot moves: some people feel better with them", on: this.narrow, set: (on) => { this.narrow = on; } }], licence);
    this.fill();
    this.listen();
    this.fit();
    this.draw();
    this.view.stage.renderer.setAnimationLoop((now) => { this.step(now); });
  }

  /** Takes the page off, before another takes its place. */
  close(): void {
    this.view.stage.renderer.setAnimationLoop(null);
    this.view.stage.renderer.dispose();
    this.listening.abort();
    this.shell.root.remove();
  }

  // What the server says

  receive(message: Message): void {
    switch (message.type) {
      case "state":
        this.receiveState(message);
        return;
      case "turn":
        this.announcer.announce(turnOf(message));
        return;
      case "place":
        this.destination.answered(placeOf(message));
        break;
      case "options":
        this.ways.show(optionsOf(message));
        if (this.destination.found()) this.ways.reveal();
        break;
      case "taken":
        if (typeof message["option"] === "number") this.ways.showDriven(message["option"]);
        this.say(`${message["by"] === "plan" ? "The robot changes its way" : "The robot"} ${words(message["words"])}.`);
        this.regions.clear();
        this.asked = null;
        break;
      case "pushed":
        this.say(`${message["followed"] === true ? "Your push is followed: the robot" : "Your push is not followed:"} ${words(message["words"])}.`);
        break;
      case "why":
        this.regions.answered(whyOf(message));
        this.say("");
        this.plate.write(words(message["sentence"]));
        break;
      case "closed":
        this.regions.setClosed(namesOf(message));
        break;
      case "setting":
        this.announcer.set({ [words(message["name"])]: message["value"] === true });
        break;
      case "note":
        this.shell.note(words(message["words"]));
        break;
      case "arrived":
        this.destination.arrived();
        this.ways.clear("");
        this.say("Arrived. Choose where to go next.");
        this.announcer.clear();
        this.regions.clear();
        break;
      case "refused":
        this.say(words(message["words"]));
        this.destination.refused();
        break;
    }
    this.draw();
  }

  private receiveState(message: Message): void {
    const state = stateOf(message);
    const before = this.motion.latest?.plan ?? null;
    this.motion.add(state);
    this.shell.braked(state.braked);
    [this.stopped, this.moves] = [state.braked === STOPPED, state.moving];
    this.shell.showGo(this.stopped, this.moves);
    if (state.plan !== null && state.plan !== before) {
      this.ways.showDriven(state.plan);
      this.draw();
    }
  }

  connected(on: boolean, again: boolean): void {
    this.shell.connected(on);
    if (on && again) this.say("Connected again.");
    if (on) return;
    this.motion.clear();
    this.announcer.clear();
  }

  // What the viewer does

  private send(message: Message): void {
    if (!this.drives) this.say("You are watching: another viewer drives.");
    else if (!this.link.send(message)) this.say("There is no connection at the moment.");
    else if (message.type === "why") this.say("Looking for the best way through there …");
    else if (message.type === "take") this.say("Changing to this way …");
  }

  private halt(on: boolean): void {
    this.send({ type: on ? "stop" : "go" });
  }

  /** In a headset: the way after the one that is driven. */
  private nextWay(): void {
    const { cards } = this.ways.options;
    const driven = cards.findIndex((card) => this.ways.isDriven(card));
    if (cards.length > 0) this.ways.takeCard((driven + 1) % cards.length);
  }

  private choose([x, y]: Point): void {
    if (!this.drives) return;
    this.asked = this.destination.mode === "why" ? [x, y] : null;
    this.regions.clear();
    this.destination.choose({ x: rounded(x), y: rounded(y) });
    this.draw();
  }

  private pointedAt(pointed: Pointed): void {
    if (!this.drives) return;
    if ("floor" in pointed) this.choose(pointed.floor);
    else if ("landmark" in pointed && pointed.landmark.name !== "") this.destination.choose({ landmark: pointed.landmark.name });
    else this.say("Something is in the way there: point at the floor, or at a landmark.");
  }

  // Headset

  private get controller(): ReturnType<View["stage"]["renderer"]["xr"]["getController"]> {
    return this.view.stage.renderer.xr.getController(0);
  }

  /** A press of a headset's controller, where no button is looked at. */
  private select(): void {
    this.view.chooseAlong(this.controller);
  }

  private sticks(): [number, number][] {
    const session = this.view.stage.renderer.xr.getSession();
    const found: [number, number][] = [];
    session?.inputSources.forEach(({ gamepad }) => {
      if (gamepad !== undefined) found.push([gamepad.axes[2] ?? 0, gamepad.axes[3] ?? 0]);
    });
    return found;
  }

  private worn(on: boolean): void {
    this.link.worn = on;
    this.plate.object.visible = on;
    if (on) return;
    this.view.looking.apply();
    this.fit();
  }

  // Display

  private say(told: string): void {
    this.shell.say(told);
    this.plate.write(told);
  }

  /** The ways as they are drawn on the map and on the floor: what is driven or looked at comes last, above. */
  private get drawn(): Drawn[] {
    const { options, pick, looked } = this.ways;
    const driven = options.all.find((option) => this.ways.isDriven(option)) ?? null;
    const strong = looked ?? pick ?? driven;
    const drawn = options.cards.map((card, i) => drawnCard(card, i, card.option === strong?.option));
    for (const [one, colour] of [[driven, DRIVEN], [pick, PICKED]] as const) {
      if (one === null || options.cards.some(({ option }) => option === one.option)) continue;
      drawn.push({ line: one.line, colour, dashes: [], mark: "", strong: one === strong });
    }
    const { why } = this.regions;
    if (why !== null) drawn.push({ line: why.line, colour: WHY, dashes: [3, 4], mark: "?", strong: false });
    return drawn.sort((a, b) => Number(a.strong) - Number(b.strong));
  }

  private draw(): void {
    if (!this.shell.root.isConnected) return;
    this.view.showWays(this.drawn, this.destination.goals);
    this.mapped = 0;
  }

  private drawMap(pose: Vector | null, people: readonly Vector[]): void {
    const [look] = this.view.head;
    const { drawn: ways, asked } = this;
    this.minimap.draw({ pose, people, ways, goals: this.destination.goals, asked, closed: this.regions.shut, look });
  }

  private step(now: number): void {
    const seconds = Math.min(Math.max((now - this.last) / 1000, 0), LONGEST);
    this.last = now;
    const found = this.motion.at(performance.now());
    const placed = JSON.stringify(found);
    if (found !== null && placed !== this.placed) this.view.place(found.pose, found.people);
    this.placed = placed;
    this.view.stage.narrow = this.narrow && this.moves ? VIGNETTE : 0;
    if (now - this.mapped >= MAP_EVERY) {
      this.drawMap(found?.pose ?? null, found?.people ?? []);
      this.mapped = now;
    }
    if (this.drives) {
      this.link.look(...this.view.head);
      this.steering.poll(now);
    }
    this.announcer.step(performance.now());
    if (this.headset.isOn) {
      this.gaze.look(this.view.stage.head, seconds);
      if (this.announcer.words !== "") this.plate.write(this.announcer.words);
    }
    this.view.aim(this.shell.canvas.matches(":focus-visible"), this.headset.isOn ? this.controller : null);
    this.view.draw(seconds);
    document.documentElement.dataset["ready"] = "yes";
  }

  private fit(): void {
    this.shell.frame(this.view.stage.resize());
    this.mapped = 0;
  }

  // Parts

  private fill(): void {
    const settings = element("section");
    settings.append(this.announcer.settings, this.announcer.spoken);
    const driving = this.drives ? [this.destination.root] : [];
    const over = [this.announcer.overlay, this.regions.overlay, ...(this.drives ? [this.steering.root] : [])];
    this.shell.fill(over, [...driving, this.ways.cardsRoot, this.ways.slidersRoot, this.regions.root, settings], this.dialog);
    this.say(this.drives ? "Choose where to go: click on the map, or on the floor." : "You are watching: another viewer drives.");
    void this.headset.isThere().then((is) => { this.shell.offerHeadset(is); });
  }

  private listen(): void {
    const { signal } = this.listening;
    const keys: KeyUser = {
      steer: (key) => this.steering.key(key),
      look: (left, up) => { this.view.turn(left, up); },
      ahead: () => { this.view.looking.recentre(); },
      toMap: () => { this.shell.map.focus(); },
      enlarge: () => { this.shell.enlarge(); },
      toLandmarks: () => { this.destination.focus(); },
      headset: () => { void this.headset.enter(); },
      help: () => { this.dialog.showModal(); },
      mode: (mode) => { this.destination.setMode(mode); },
      take: (card) => {
        if (document.activeElement === this.shell.map) this.shell.canvas.focus(); // arrow keys steer from now on
        return this.ways.takeCard(card);
      },
      toggle: () => { this.halt(!this.stopped); },
      stop: () => { this.halt(true); },
      middle: () => { this.view.chooseMiddle(); },
    };
    window.addEventListener("resize", () => { this.fit(); }, { signal });
    window.addEventListener("keydown", (event) => {
      if (this.dialog.open) return;
      if (event.key === "Escape" && this.headset.isOn) this.headset.leave();
      else if (!pressed(event, keys, this.drives, this.shell.canvas)) return;
      event.preventDefault();
    }, { signal });
    new ResizeObserver(() => { this.fit(); }).observe(this.shell.canvas);
  }
}

/** A coordinate to a millimetre. */
function rounded(value: number): number {
  return Math.round(1000 * value) / 1000;
}
