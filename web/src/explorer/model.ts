// The front as the page holds it: decoded once, never changed. Columns are typed arrays, one number a row.

/** Criteria are of performance, comfort, the robot or others around it; a reported value has no class. */
export type Group = "P" | "C" | "R" | "O" | "";

export interface Column {
  readonly name: string;
  /** "m", "rad", "1", ... */
  readonly unit: string;
  readonly group: Group;
  /** Step in which values are compared, in the unit; 0 of reported values, which are compared as they are. */
  readonly quantum: number;
  /** Whether values are whole numbers by nature. */
  readonly counts: boolean;
  /** Reported beside the criteria, not minimised: drawn dashed. */
  readonly reported: boolean;
  /** (n,) in the unit. */
  readonly values: Float64Array;
  /** Least and greatest value; both 0 of a front without points. */
  readonly low: number;
  readonly high: number;
}

/** A row with a name: "knee", "least turns". */
export interface Mark {
  readonly name: string;
  readonly row: number;
}

/** Where each trajectory goes on the map: corners of row i are offsets[i] .. offsets[i + 1] of x and y, in m. */
export interface Paths {
  readonly offsets: Uint32Array;
  readonly x: Float64Array;
  readonly y: Float64Array;
}

/** A closed polygon: x0, y0, x1, y1, ... in m. */
export type Ring = Float64Array;

export interface Obstacle {
  readonly ring: Ring;
  readonly holes: readonly Ring[];
}

export interface World {
  /** Least x and y, greatest x and y, m. */
  readonly extent: readonly [number, number, number, number];
  readonly obstacles: readonly Obstacle[];
  /** Where people stand and look, m and rad. */
  readonly people: readonly { readonly x: number; readonly y: number; readonly yaw: number }[];
  readonly landmarks: readonly { readonly name: string; readonly x: number; readonly y: number }[];
  readonly zones: readonly { readonly name: string; readonly ring: Ring }[];
}

/** What happens along one trajectory. */
export interface Trace {
  /** (m,) s. */
  readonly t: Float64Array;
  /** (m,) m: where it is on the map at t. */
  readonly x: Float64Array;
  readonly y: Float64Array;
  /** Rates along time, each (m,). */
  readonly rates: readonly { readonly name: string; readonly unit: string; readonly values: Float64Array }[];
}

export interface Model {
  readonly title: string;
  readonly status: string;
  readonly certificate: string;
  readonly notes: readonly string[];
  /** Number of rows. */
  readonly n: number;
  /** The criteria in the front's order, then what is reported. */
  readonly columns: readonly Column[];
  /** How many of the columns are criteria. */
  readonly criteria: number;
  readonly marks: readonly Mark[];
  /** Absent where nothing moves in a plane. */
  readonly paths: Paths | null;
  readonly world: World | null;
  /** By row; not every row need have one. */
  readonly traces: ReadonlyMap<number, Trace>;
}
