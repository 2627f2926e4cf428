// What the page is given, `hpop-ride` version 1: hpop/view/ride/page.py writes it. Metres, seconds, radians; world axes
// x right, y up in the plane, z height (REP-103). Texts come from files: they are names, never markup.
import { payloadOf } from "../shared/payload";

export type Colour = readonly [number, number, number];
export type Point = readonly [number, number];
export type Ring = readonly Point[];
export type Vector = readonly [number, number, number];

export interface Prism {
  readonly rings: readonly Ring[];
  readonly z: Point;
  readonly number: number;
  readonly colour: Colour;
  readonly is_wall: boolean;
  readonly name: string;
  /** There where the prism stands for a solid that is not upright; the page draws it as one of `solids`. */
  readonly solid?: unknown;
}

export interface Cells {
  /** Columns and rows, first and beyond the last: x0, y0, x1, y1. */
  readonly boxes: readonly (readonly [number, number, number, number])[];
  readonly resolution: number;
  /** x, y, yaw of the lower left corner. */
  readonly origin: Vector;
  readonly z: Point;
  readonly number: number;
  readonly colour: Colour;
}

export interface Part {
  readonly shape: "cylinder" | "ellipsoid";
  readonly radius: number;
  readonly low: number;
  readonly high: number;
  readonly colour: Colour;
  readonly back: Colour;
}

export interface Person {
  readonly x: number;
  readonly y: number;
  /** Corners of the way: time, x, y, and the yaw that holds from there to the next one. */
  readonly way: readonly (readonly [number, number, number, number])[];
  /** From when to when the person is there; null: for ever. */
  readonly there: readonly [number, number | null];
  readonly radius: number;
  readonly name: string;
  readonly number: number;
  readonly parts: readonly Part[];
}

export interface Landmark {
  readonly x: number;
  readonly y: number;
  readonly z: number;
  readonly facing: number | null;
  readonly name: string;
  readonly width: number;
  readonly height: number;
  readonly number: number;
  readonly colour: Colour;
}

export interface Zone {
  readonly kind: string;
  readonly name: string;
  readonly polygons: readonly (readonly Ring[])[];
  readonly colour: Colour;
}

export interface Surfaces {
  readonly period: number;
  readonly waves: readonly (readonly [number, number, number, number])[];
  readonly pitch: number;
  readonly line: number;
  readonly contrast: { readonly floor: number; readonly wall: number };
  readonly grid: { readonly floor: number; readonly wall: number };
  readonly skirting: Point;
  readonly floor: Colour;
  readonly outside: Colour;
  readonly zone_share: number;
  readonly sky: readonly [Colour, Colour];
  readonly light: Vector;
  readonly ambient: number;
  readonly diffuse: number;
  readonly haze?: number;
}

export interface Scene {
  readonly prisms: readonly Prism[];
  readonly cells: Cells | null;
  readonly people: readonly Person[];
  readonly landmarks: readonly Landmark[];
  readonly zones: readonly Zone[];
  readonly floor: readonly (readonly Ring[])[];
  readonly surfaces: Surfaces;
}

/** A convex body: corners, and triangles of them, counter-clockwise as seen from outside. */
export interface Mesh {
  readonly points: readonly Vector[];
  readonly triangles: readonly Vector[];
  readonly number: number;
  readonly colour: Colour;
}

/** Whole numbers that were differenced twice: a value is `scale` times what they sum up to. */
export interface Packed {
  readonly scale: number;
  /** One list a column. */
  readonly columns: readonly (readonly number[])[];
}

export interface Rates {
  /** (n + 1,) s: where the pieces begin, and the end of the last. */
  readonly times: readonly number[];
  /** (k, n) of each criterion. */
  readonly values: readonly (readonly number[])[];
}

export interface TrackData {
  /** "A", "B", ... */
  readonly name: string;
  /** Row of the front and its marks, in words; empty where the page is blind. */
  readonly label: string;
  readonly duration: number;
  /** Hz: samples are so far apart, the last one is at the end. */
  readonly rate: number;
  readonly positions: Packed;
  readonly quaternions: Packed;
  /** Of each link of the robot x, y, z and the quaternion, seven columns; empty where none is drawn. */
  readonly links: Packed;
  readonly rates: Rates | null;
  /** As the front holds them, of each criterion, with the unit. */
  readonly costs: readonly string[];
}

export interface Criterion {
  readonly name: string;
  /** Of its rate, in words: "m a second", "m at the time". */
  readonly unit: string;
  readonly group: string;
}

/** What stands round the viewer, and what of it the robot's camera sees. */
export interface Surroundings {
  readonly scene: Scene;
  readonly solids: readonly Mesh[];
  /** Shapes of the links, each in its own frame. */
  readonly links: readonly Mesh[];
  /** rad, horizontal and vertical, or null for all round. */
  readonly field_of_view: Point | null;
}

export interface Ride extends Surroundings {
  /** Whether the page was made without numbers and names of criteria: they are not in the file. */
  readonly blind: boolean;
  readonly criteria: readonly Criterion[];
  readonly tracks: readonly TrackData[];
  readonly notes: readonly string[];
  /** Of three.js, which draws the view. */
  readonly licence: string;
}

/** Where a person is at a time, and the yaw; null where it is not there. */
export function whereIs(person: Person, t: number): Vector | null {
  const [from, until] = person.there;
  if (t < from || (until !== null && t >= until)) return null;
  let before = person.way[0];
  for (const corner of person.way) {
    if (before !== undefined && corner[0] > t) {
      const share = Math.max(0, (t - before[0]) / (corner[0] - before[0]));
      return [before[1] + share * (corner[1] - before[1]), before[2] + share * (corner[2] - before[2]), before[3]];
    }
    before = corner;
  }
  return before === undefined ? null : [before[1], before[2], before[3]];
}

/** A stimulus of a study, `hpop-stimulus` version 1: hpop/study/stimuli.py writes it. It holds no name but its letter. */
export interface Stimulus extends Surroundings {
  readonly name: string;
  /** Whether nothing moves: the view from the start, at rest. */
  readonly still: boolean;
  readonly track: TrackData;
  /** What the page says, by name; gaps are written {seconds}. */
  readonly words: Readonly<Record<string, string>>;
}

/** The data of a page of a ride. */
export function ride(): Ride {
  return payloadOf("hpop-ride", 1) as Ride;
}

/** The data of a stimulus. */
export function stimulus(): Stimulus {
  return payloadOf("hpop-stimulus", 1) as Stimulus;
}
