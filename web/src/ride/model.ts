// The page's data, `hpop-ride` version 1, written by hpop/view/ride/page.py. Metres, seconds, radians; world axes
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
  /** Present if the prism encloses a solid that is not upright; the page draws it as one of `solids`. */
  readonly solid?: unknown;
}

export interface Cells {
  /** First column and row, and those after the last: x0, y0, x1, y1. */
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
  /** Corners of the person's path: time, x, y, and the yaw until the next corner. */
  readonly way: readonly (readonly [number, number, number, number])[];
  /** Times at which the person comes and leaves; null for never. */
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

/** Whole numbers that were differenced twice: a value is `scale` times their double sum. */
export interface Packed {
  readonly scale: number;
  /** One list for each column. */
  readonly columns: readonly (readonly number[])[];
}

export interface Rates {
  /** (n + 1,) s: where the pieces begin, and the end of the last. */
  readonly times: readonly number[];
  /** (k, n) of each criterion. */
  readonly values: readonly (readonly number[])[];
}

/** A visit of a stop of a tour: its number from 1, its name, and from when to when, s. */
export interface Visit {
  readonly number: number;
  readonly name: string;
  readonly begin: number;
  readonly end: number;
}

export interface TrackData {
  /** "A", "B", ... */
  readonly name: string;
  /** Row of the front and its names, in words; empty on a blind page. */
  readonly label: string;
  readonly duration: number;
  /** Samples per second, Hz; the last sample is at the end. */
  readonly rate: number;
  readonly positions: Packed;
  readonly quaternions: Packed;
  /** Seven columns for each link of the robot: x, y, z and the quaternion; empty if no link is drawn. */
  readonly links: Packed;
  readonly rates: Rates | null;
  /** Visits of a tour's stops in order of time; absent or empty without a tour, and on a blind page. */
  readonly visits?: readonly Visit[];
  /** Cost of each criterion, as on the front, with the unit. */
  readonly costs: readonly string[];
}

export interface Criterion {
  readonly name: string;
  /** Unit of the rate, in words: "m a second", "m at the time". */
  readonly unit: string;
  readonly group: string;
}

/** The scene round the viewer, and the camera's field of view. */
export interface Surroundings {
  readonly scene: Scene;
  readonly solids: readonly Mesh[];
  /** Shapes of the links, each in its own frame. */
  readonly links: readonly Mesh[];
  /** rad, horizontal and vertical, or null for all round. */
  readonly field_of_view: Point | null;
}

export interface Ride extends Surroundings {
  /** Whether numbers and names of criteria were left out of the file. */
  readonly blind: boolean;
  readonly criteria: readonly Criterion[];
  readonly tracks: readonly TrackData[];
  /** Positions of a tour's stops, m, whose numbers the map shows; null for a stop without one. */
  readonly stops: readonly (Point | null)[];
  readonly notes: readonly string[];
  /** Licence of three.js, which draws the view. */
  readonly licence: string;
}

/** Position and yaw of a person at a time; null while the person is absent. */
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

export interface Shown {
  /** s by which the view lags */
  readonly latency: number;
  /** Degrees of view while it turns at a radian a second or more; null if the view is not restricted. */
  readonly restrictor: number | null;
  /** Announcements of turns: when one appears, when the turn begins, s, and the side. */
  readonly cues: readonly (readonly [number, number, "left" | "right"])[];
  /** Address of a video that is played in place of the scene. */
  readonly video: string | null;
}

/** A stimulus of a study, `hpop-stimulus` version 1: hpop/study/page.py writes it. It holds no name but its letter. */
export interface Stimulus extends Surroundings {
  readonly name: string;
  /** Whether nothing moves: the view from the start, at rest. */
  readonly still: boolean;
  readonly track: TrackData;
  /** How the ride is shown, by the factors of the study; null or absent for the still view. */
  readonly shown?: Shown | null;
  /** Texts of the page, by name; placeholders are written {seconds}. */
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
