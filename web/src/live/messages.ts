// Messages between the page and `hpop live` (hpop/live): JSON objects with a `type`. Metres, radians, seconds; UTC ms in `at`.
import type { Point, Ring, Scene, Surroundings } from "../ride/model";

export type Role = "drive" | "watch";

export interface LiveCriterion {
  readonly name: string;
  readonly label: string;
  readonly unit: string;
}

/** A part of the floor with a name, that one may ask about or close. */
export interface NamedRegion {
  readonly name: string;
  /** Whether a robot can never be there: one may only ask about the sides. */
  readonly solid: boolean;
  readonly ring: Ring;
}

/** What never changes in a session. */
export interface LiveScene extends Surroundings {
  readonly title: string;
  readonly role: Role;
  readonly criteria: readonly LiveCriterion[];
  readonly regions: readonly NamedRegion[];
  /** Corners of the robot's outline in its own frame. */
  readonly outline: Ring;
  /** Height of the camera, m, and its place before the robot's centre. */
  readonly camera: { readonly x: number; readonly z: number };
  readonly settings: Readonly<Record<string, boolean>>;
  /** Names of the regions that are closed. */
  readonly closed: readonly string[];
  /** Address of pictures of the robot's own camera, which take the place of the drawn view; "" without. */
  readonly video: string;
  /** Address of the explorer with the present front; "" without. */
  readonly explorer: string;
}

/** A measured state of the robot and the people: 20 a second. */
export interface State {
  readonly at: number;
  readonly x: number;
  readonly y: number;
  readonly theta: number;
  readonly moving: boolean;
  readonly people: readonly (readonly number[])[];
  /** Number of the option that is driven. */
  readonly plan: number | null;
  /** Why the robot brakes although its viewer did not stop it; "" if it does not. */
  readonly braked: string;
}

export interface Place {
  readonly x: number;
  readonly y: number;
  readonly status: string;
  readonly words: string;
  readonly goal: Point | null;
}

/** A way to the destination. */
export interface Option {
  readonly option: number;
  readonly costs: Readonly<Record<string, number>>;
  readonly line: readonly Point[];
}

export interface Card extends Option {
  readonly name: string;
  readonly words: string;
}

export interface Options {
  /** When the ways were asked for, s: told when one of them is taken, since newer ways may be under way. */
  readonly asked: number;
  readonly cards: readonly Card[];
  readonly all: readonly Option[];
  /** Number of the way that is driven now; null if it is none of these. */
  readonly present: number | null;
  readonly certificate: string;
}

export interface Why {
  readonly sentence: string;
  readonly exact: boolean;
  readonly line: readonly Point[];
}

export interface Turn {
  readonly in: number;
  readonly direction: "left" | "right";
  readonly degrees: number;
}

export type Message = Readonly<Record<string, unknown>> & { readonly type: string };

/** The message of a text, or null if it is none. */
export function messageOf(text: string): Message | null {
  const found: unknown = JSON.parse(text);
  return typeof found === "object" && found !== null && "type" in found && typeof found.type === "string" ? (found as Message) : null;
}

export function words(value: unknown): string {
  return typeof value === "string" ? value : "";
}

function number(value: unknown): number {
  return typeof value === "number" && Number.isFinite(value) ? value : 0;
}

function index(value: unknown): number | null {
  return typeof value === "number" && Number.isInteger(value) ? value : null;
}

function list(value: unknown): readonly unknown[] {
  return Array.isArray(value) ? value : [];
}

function record(value: unknown): Readonly<Record<string, unknown>> {
  return typeof value === "object" && value !== null ? (value as Record<string, unknown>) : {};
}

function points(value: unknown): Point[] {
  return list(value).map((p): Point => [number(list(p)[0]), number(list(p)[1])]);
}

function flags(value: unknown): Record<string, boolean> {
  return Object.fromEntries(Object.entries(record(value)).map(([name, on]) => [name, on === true]));
}

export function sceneOf(message: Message): LiveScene {
  const surroundings = message as unknown as Surroundings;
  const world = surroundings.scene as Scene | undefined;
  if (world === undefined) throw new Error("the scene of the server has no world; the page and the server are of different versions");
  const camera = record(message["camera"]);
  return {
    ...surroundings,
    solids: (message["solids"] as LiveScene["solids"] | undefined) ?? [],
    links: (message["links"] as LiveScene["links"] | undefined) ?? [],
    field_of_view: (message["field_of_view"] as Point | null | undefined) ?? null,
    title: words(message["title"]) || words(message["name"]),
    role: message["role"] === "watch" ? "watch" : "drive",
    criteria: list(message["criteria"]).map((one) => {
      const { name, label, unit } = record(one);
      const plain = (words(label) || words(name)).replace(/ \([^)]*\)$/u, ""); // the unit stands behind the value
      return { name: words(name), label: plain, unit: words(unit) };
    }),
    regions: regionsOf(message["regions"]),
    outline: points(message["outline"]),
    camera: { x: number(camera["x"]), z: number(camera["z"]) || number(message["camera_height"]) || 1.2 },
    settings: flags(message["settings"]),
    closed: list(message["closed"]).map(words),
    video: words(message["video"]),
    explorer: words(message["explorer"]),
  };
}

function regionsOf(value: unknown): NamedRegion[] {
  return list(value).map((one) => {
    const { name, kind, corners } = record(one);
    return { name: words(name), solid: kind === "obstacle", ring: points(corners) };
  });
}

export function stateOf(message: Message): State {
  const { at, x, y, theta, moving, people, plan, braked } = message;
  return {
    at: number(at),
    x: number(x),
    y: number(y),
    theta: number(theta),
    moving: moving === true,
    people: list(people) as (readonly number[])[],
    plan: index(plan),
    braked: words(braked),
  };
}

export function placeOf(message: Message): Place {
  const goal = message["goal"];
  const { x, y } = record(goal);
  const [gx, gy] = Array.isArray(goal) ? list(goal) : [x, y];
  return {
    x: number(message["x"]),
    y: number(message["y"]),
    status: words(message["status"]),
    words: words(message["words"]),
    goal: typeof gx === "number" && typeof gy === "number" ? [gx, gy] : null,
  };
}

export function optionsOf(message: Message): Options {
  const option = (one: unknown): Option => {
    const { option: index, costs, line } = record(one);
    const values = Object.entries(record(costs)).map(([name, value]): [string, number] => [name, number(value)]);
    return { option: number(index), costs: Object.fromEntries(values), line: points(line) };
  };
  const cards = list(message["cards"]).map((one) => ({ ...option(one), name: words(record(one)["name"]), words: words(record(one)["words"]) }));
  const all = list(message["all"]).map(option);
  return { asked: number(message["asked"]), cards, all: all.length > 0 ? all : cards, present: index(message["present"]), certificate: words(message["certificate"]) };
}

export function whyOf(message: Message): Why {
  return { sentence: words(message["sentence"]), exact: message["exact"] !== false, line: points(message["line"]) };
}

export function namesOf(message: Message): string[] {
  return list(message["names"]).map(words);
}

export function turnOf(message: Message): Turn {
  const direction = message["direction"] === "right" ? "right" : "left";
  return { in: number(message["in"]), direction, degrees: Math.abs(number(message["degrees"])) };
}
