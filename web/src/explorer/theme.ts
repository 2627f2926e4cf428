// Colours of what is drawn, light and dark. Pins and groups are of Okabe and Ito (2008), as in hpop/view/style.py;
// a dash repeats each colour, so that print without colour and colour-blind readers lose nothing.
import type { Group } from "./payload";

export interface Theme {
  readonly dark: boolean;
  readonly paper: string;
  readonly ink: string;
  /** Tick labels and secondary text. */
  readonly quiet: string;
  readonly line: string;
  /** Hovered rows. */
  readonly hover: string;
  /** Halo round a line that must be visible over others. */
  readonly halo: string;
  readonly wall: string;
  readonly zone: string;
  readonly person: string;
  readonly landmark: string;
  /** The row nearest to the wishes. */
  readonly wish: string;
}

export const PIN_NAMES = ["A", "B", "C"] as const;
export const PINS = PIN_NAMES.length;
/** Colours of pins A, B and C, in the light and the dark scheme. */
export const PIN_COLOURS = ["#D55E00", "#0072B2", "#CC79A7"] as const;
/** On and off, CSS pixels. */
export const PIN_DASHES: readonly (readonly number[])[] = [[], [9, 4], [2, 3]];
export const PIN_WIDTH = 2.6;
export const HOVER_WIDTH = 2.2;
/** Of axes and borders of reported values. */
export const REPORTED_DASH: readonly number[] = [3, 3];

export const GROUP_COLOURS: Readonly<Record<Group, string>> = {
  P: "#56B4E9",
  C: "#009E73",
  R: "#E69F00",
  O: "#9A8CD0",
  "": "#8a8f94",
};
export const GROUP_WORDS: Readonly<Record<Group, string>> = {
  P: "performance",
  C: "comfort",
  R: "robot",
  O: "others",
  "": "reported",
};

const LIGHT: Theme = {
  dark: false,
  paper: "#ffffff",
  ink: "#16191d",
  quiet: "#5b6570",
  line: "#c9ced4",
  hover: "#000000",
  halo: "rgba(255,255,255,0.9)",
  wall: "#5f6770",
  zone: "rgba(213,94,0,0.16)",
  person: "#009E73",
  landmark: "#8f6a00",
  wish: "#B07900",
};
const DARK: Theme = {
  dark: true,
  paper: "#14181d",
  ink: "#e9edf1",
  quiet: "#a2adb8",
  line: "#3c454f",
  hover: "#ffffff",
  halo: "rgba(10,13,16,0.9)",
  wall: "#8a949e",
  zone: "rgba(230,159,0,0.2)",
  person: "#2fc79b",
  landmark: "#e0b64a",
  wish: "#F0C040",
};

const dark = window.matchMedia("(prefers-color-scheme: dark)");
let onPaper = false;

/** The current colours; paper is white in print. */
export function theme(): Theme {
  return dark.matches && !onPaper ? DARK : LIGHT;
}

/** Sets whether the page is being printed. */
export function setPrinting(printing: boolean): void {
  onPaper = printing;
}

/** Calls a function when the colours change. */
export function onTheme(changed: () => void): void {
  dark.addEventListener("change", changed);
}
