// How ways are told apart, on the map and on the floor: by colour, dashes and number.
import { colourOfTrack, dashesOfTrack } from "../ride/colours";
import type { Card, Option } from "./messages";

export const GOAL = "#ffd23f";
export const WHY = "#ff6f59";
/** The way that is driven, and the one that the sliders picked, where they are on no card. */
export const DRIVEN = "#ffffff";
export const PICKED = "#c792ff";

/** A way to draw. */
export interface Drawn {
  readonly line: Option["line"];
  readonly colour: string;
  readonly dashes: readonly number[];
  /** Its number among the cards; "" without. */
  readonly mark: string;
  /** Whether it is driven or looked at: it is drawn wider, and last. */
  readonly strong: boolean;
}

export function drawnCard(card: Card, i: number, strong: boolean): Drawn {
  return { line: card.line, colour: colourOfTrack(i), dashes: dashesOfTrack(i), mark: String(i + 1), strong };
}
