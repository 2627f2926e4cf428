// The page's data, `hpop-session` version 1, written by hpop/study/page.py. They contain the public part of one
// participant's session (`hpop-form` version 1): letters of conditions, not the conditions. Texts come from files:
// they are text, never markup.
import { payloadOf } from "../shared/payload";

/** A text by language. */
export type Text = Readonly<Record<string, string>>;

export interface Scale {
  readonly low: number;
  readonly high: number;
  readonly step?: number;
  /** By language: one for each value, or two for both ends. */
  readonly labels?: Readonly<Record<string, readonly string[]>>;
  /** The answer that an item does not apply. */
  readonly absent?: { readonly value: number; readonly text: Text } | null;
}

export interface Item {
  readonly id: string;
  readonly text: Text;
  readonly scale?: Scale | null;
}

export interface Form {
  readonly id: string;
  readonly title: Text;
  readonly when: readonly ("before" | "after_each" | "after_all")[];
  readonly kind?: "ratings" | "pairs";
  readonly ask: Text;
  readonly scale?: Scale | null;
  readonly items: readonly Item[];
}

export interface Place {
  readonly place: number;
  readonly condition: string;
  /** A ride, a still view or a video, each with a page; a real robot; or a session in which the participant drives. */
  readonly kind: "ride" | "view" | "video" | "robot" | "live";
  readonly stimulus: string;
  readonly seconds: number;
  /** Options and times of what is measured meanwhile (web/src/ride/tasks.ts). */
  readonly tasks?: Readonly<Record<string, unknown>>;
}

export interface Design {
  readonly design: string;
  readonly participant: string;
  readonly language: string;
  readonly consent: string;
  readonly protocol: { readonly rest_s: number; readonly stop_rule: string; readonly watched: number };
  readonly forms: Readonly<Record<string, Form>>;
  readonly places: readonly Place[];
  readonly comparisons: readonly (readonly [string, string])[];
}

export type Point = readonly [number, number];

/** Paths on a map, m: x right, y up. */
export interface Plan {
  readonly extent: readonly [number, number, number, number];
  readonly walls: readonly (readonly Point[])[];
  readonly ways: Readonly<Record<string, readonly Point[]>>;
}

export interface Session {
  readonly form: Design;
  readonly words: Readonly<Record<string, string>>;
  /** The script that draws rides, in the form that their pages contain. */
  readonly bundle: string;
  /** Pages of rides by letter, deflated, base64, without the script. */
  readonly rides: Readonly<Record<string, string>>;
  readonly plan: Plan | null;
  /** Whether the study's own computer serves the page and takes each answer. */
  readonly served: boolean;
}

export function given(): Session {
  return payloadOf("hpop-session", 1) as Session;
}

/** Values of a scale, rising. */
export function valuesOf(scale: Scale): number[] {
  const step = scale.step ?? 1;
  const count = Math.round((scale.high - scale.low) / step);
  return Array.from({ length: count + 1 }, (_, i) => Number((scale.low + i * step).toFixed(9)));
}
