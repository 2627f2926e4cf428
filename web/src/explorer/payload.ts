// The page's data, `hpop-page` version 1, and their decoding to typed arrays in metres and seconds.
//
// hpop/view/explorer/__init__.py writes them. Long columns of numbers are in `data`: one zlib stream in base64, of
// which a `Packed` names a part. A part holds the lowest bytes of all its numbers, then the next ones, and so on
// (little-endian); `order` says how many times the numbers are to be summed up.

/** Criteria are of performance, comfort, the robot or others around it; a reported value has no class. */
export type Group = "P" | "C" | "R" | "O" | "";

export interface Column {
  readonly name: string;
  /** Name and unit as pictures have them: "length (m)", "turns (count)". */
  readonly label: string;
  /** "m", "rad", "1", ... */
  readonly unit: string;
  /** Meaning of the column, in a sentence or two; "" if unknown. */
  readonly about: string;
  readonly group: Group;
  /** Quantum at which values are compared, in the unit; 0 for reported values, which are compared exactly. */
  readonly quantum: number;
  /** Whether values are whole numbers by nature. */
  readonly counts: boolean;
  /** Reported beside the criteria, not minimised: drawn dashed. */
  readonly reported: boolean;
  /** Whether the criterion was only evaluated, not minimised: paths with lower values may exist. */
  readonly evaluated: boolean;
  /** Label of the column's trace, such as "m a second"; null if it cannot be traced. */
  readonly along: string | null;
  /** How the running value follows from the rates along a trajectory. */
  readonly adds: "sum" | "mean" | "max";
  /** (n,) in the unit: the floats that front.json holds, all finite. */
  readonly values: Float64Array;
  /** Least and greatest value; both 0 of a front without points. */
  readonly low: number;
  readonly high: number;
}

/** A row with its names, "knee", "least turns", and its look in all pictures of the front. */
export interface Mark {
  readonly names: readonly string[];
  readonly row: number;
  readonly colour: string;
  /** On-off pattern, points; empty of an unbroken line. */
  readonly dashes: readonly number[];
}

/** Paths of the camera from above: the corners of row i are entries offsets[i] .. offsets[i + 1] of point, x and y. */
export interface Paths {
  /** (n + 1,) */
  readonly offsets: Int32Array;
  /** Index of each corner among the distinct corners; paths share a segment if they share both of its ends. */
  readonly point: Int32Array;
  /** Number of distinct corners. */
  readonly points: number;
  /** m, of each corner. */
  readonly x: Float64Array;
  readonly y: Float64Array;
}

/** A closed polygon: x0, y0, x1, y1, ... in m; the first corner is not repeated. */
export type Ring = Float64Array;

/** An area of polygons: outlines counter-clockwise, holes clockwise. By the nonzero rule areas that overlap are one. */
export type Area = readonly Ring[];

export interface Obstacle {
  readonly area: Area;
  /** Height range, m; infinite if unlimited. */
  readonly low: number;
  readonly high: number;
}

export interface Person {
  readonly x: number;
  readonly y: number;
  /** rad */
  readonly yaw: number;
  /** m/s */
  readonly velocity: readonly [number, number];
  readonly radius: number;
  readonly name: string;
}

export interface Landmark {
  readonly x: number;
  readonly y: number;
  readonly z: number;
  /** rad; null for a landmark without a front. */
  readonly facing: number | null;
  readonly name: string;
}

export interface Zone {
  readonly kind: "speed" | "keep-out" | "one-way";
  readonly area: Area;
  /** m/s, of a speed zone. */
  readonly limit: number | null;
  /** Of a one-way zone: x0, y0, x1, y1, ... in m, in the direction that is allowed. */
  readonly path: Ring | null;
  readonly name: string;
}

/** m, m, rad; yaw is null if it is free or not visible. */
export interface End {
  readonly x: number;
  readonly y: number;
  readonly yaw: number | null;
}

export interface World {
  /** Where the robot must stay. */
  readonly extent: Area;
  /** x_min, y_min, x_max, y_max, m: of everything to draw, and of the part that is shown first. */
  readonly bounds: readonly [number, number, number, number];
  readonly view: readonly [number, number, number, number];
  readonly obstacles: readonly Obstacle[];
  /** Whether everything outside the extent is an obstacle. */
  readonly outside: boolean;
  /** Closed to the robot, invisible to the camera. */
  readonly closed: Area;
  readonly people: readonly Person[];
  /** Conversations: indices in `people`. */
  readonly groups: readonly (readonly number[])[];
  readonly landmarks: readonly Landmark[];
  readonly zones: readonly Zone[];
  /** Targets of criteria and goals, m, with the names of these. */
  readonly targets: readonly { readonly x: number; readonly y: number; readonly name: string }[];
  readonly start: End;
  readonly goals: readonly End[];
  /** Height range of the camera, m. */
  readonly heights: readonly [number, number];
  /** Caption: what the map shows and leaves out. */
  readonly caption: string;
  /** Measured field that shades the floor; null without a criterion of one. */
  readonly field: MeasuredField | null;
}

/** A measured field on a grid of points. */
export interface MeasuredField {
  readonly name: string;
  readonly unit: string;
  /** Least and greatest value in free space, in the unit. */
  readonly low: number;
  readonly high: number;
  /** x_min, y_min, x_max, y_max, m: of the grid. */
  readonly box: readonly [number, number, number, number];
  /** Points in a row; rows begin at the lowest y. */
  readonly width: number;
  /** Share of the range from low to high at each point, 0 to 1. */
  readonly shares: Float64Array;
}

/** A stop of a tour. */
export interface Stop {
  readonly name: string;
  /** m, where maps show its number; null if it has no position. */
  readonly place: readonly [number, number] | null;
  /** m, radius of the disc in which it is visited; null for other stops. */
  readonly within: number | null;
}

/** A tour: its stops, and the order in which each trajectory visits them. */
export interface Tour {
  readonly stops: readonly Stop[];
  /** Distinct orders, such as "2 1 3": numbers of stops, from 1; "-" if none is visited. */
  readonly orders: readonly string[];
  /** (n,) index of each row's order. */
  readonly order: ArrayLike<number>;
}

/** A visit: number of the stop from 1, its name, and from when to when, s. */
export type Visit = readonly [number: number, name: string, begin: number, end: number];

/** Values along one planned trajectory, in m pieces. */
export interface Trace {
  readonly visits: readonly Visit[];
  /** (m + 1,) s: ends of the pieces. */
  readonly t: Float64Array;
  /** (m + 1,) Position, m, and yaw, rad, continuous, of the camera at these times. */
  readonly x: Float64Array;
  readonly y: Float64Array;
  readonly yaw: Float64Array;
  /** One entry for each column, in order; null if it cannot be traced. */
  readonly along: readonly ({
    /** (m,) Value in each piece: growth per second, or mean, or worst value, as `Column.along` says. */
    readonly rate: Float64Array;
    /** (m + 1,) Running value at each time; the last one is the cost. */
    readonly running: Float64Array;
  } | null)[];
}

export interface Model {
  readonly title: string;
  readonly status: string;
  /** Whether the search was completed. */
  readonly complete: boolean;
  /** A paragraph for each claim. */
  readonly certificate: readonly string[];
  readonly notes: readonly string[];
  /** Number of rows. */
  readonly n: number;
  /** The criteria in the front's order, then the reported values. */
  readonly columns: readonly Column[];
  /** Number of columns that are criteria. */
  readonly criteria: number;
  readonly marks: readonly Mark[];
  readonly paths: Paths;
  readonly world: World;
  /** null without a tour. */
  readonly tour: Tour | null;
  /** Traces by row; not every row has one. */
  readonly traces: ReadonlyMap<number, Trace>;
  /** Path of the front's file, for Python code and commands; null if unknown. */
  readonly saved: string | null;
}

/** A packed column: type, first byte, number of values, and how many times the values must be summed up. */
type Packed = readonly [type: "int32" | "int16" | "float64", at: number, count: number, order: number];

/** An area: rings first .. first + count of the world. */
interface PackedArea {
  readonly first: number;
  readonly count: number;
}

/** The data as packed. Lengths are whole millimetres from the origin, angles milliradians, times whole ticks. */
interface Payload {
  readonly schema: "hpop-page";
  readonly version: 1;
  readonly title: string;
  readonly status: string;
  readonly complete: boolean;
  readonly certificate: readonly string[];
  readonly notes: readonly string[];
  readonly count: number;
  readonly columns: readonly (Omit<Column, "values" | "low" | "high"> & { readonly values: Packed })[];
  readonly marks: readonly Mark[];
  readonly saved: string | null;
  /** m */
  readonly origin: readonly [number, number];
  readonly paths: { readonly x: Packed; readonly y: Packed; readonly corners: Packed; readonly counts: Packed };
  readonly world: Omit<World, "extent" | "obstacles" | "closed" | "zones" | "field"> & {
    readonly field: (Omit<MeasuredField, "shares"> & { readonly values: Packed }) | null;
    readonly rings: { readonly x: Packed; readonly y: Packed; readonly counts: Packed };
    readonly extent: PackedArea;
    readonly obstacles: readonly (PackedArea & { readonly z: readonly [number | null, number | null] })[];
    readonly closed: PackedArea;
    readonly zones: readonly (Omit<Zone, "area" | "path"> & {
      readonly area: PackedArea;
      readonly path: readonly number[] | null;
    })[];
  };
  readonly tour: (Omit<Tour, "order"> & { readonly order: Packed }) | null;
  readonly traces: readonly {
    readonly row: number;
    readonly visits: readonly Visit[];
    /** s, duration of a tick of `t`. */
    readonly tick: number;
    readonly t: Packed;
    readonly x: Packed;
    readonly y: Packed;
    readonly yaw: Packed;
    /** Size of a step of `values`, for each column that can be traced. */
    readonly steps: readonly number[];
    /** (m,) for each of these columns: growth of a sum, or mean, or worst value in each piece, in steps. */
    readonly values: Packed;
  }[];
  readonly data: string;
}

export const SCHEMA = "hpop-page";
export const VERSION = 1;

const ARRAYS = { int32: Int32Array, int16: Int16Array, float64: Float64Array } as const;

/** Decodes a payload; rejects data that are no payload of this version. */
export async function decode(given: unknown): Promise<Model> {
  const payload = given as Payload;
  const { schema, version } = payload as { schema: unknown; version: unknown };
  if (schema !== SCHEMA || version !== VERSION) {
    throw new Error(`this page reads ${SCHEMA} version ${VERSION}; its data are something else`);
  }
  const bytes = await inflated(payload.data);
  const numbers = (packed: Packed): Float64Array | Int32Array | Int16Array => unpacked(bytes, packed);
  // Divided, not multiplied: 0.001 is no float, and 2500 mm are 2.5 m.
  const radians = (packed: Packed): Float64Array => Float64Array.from(numbers(packed), (value) => value / 1000);
  const metres = (packed: Packed, axis: 0 | 1): Float64Array =>
    Float64Array.from(numbers(packed), (value) => payload.origin[axis] + value / 1000);

  const columns = payload.columns.map((column) => {
    const values = numbers(column.values) as Float64Array;
    const [low, high] = rangeOf(values);
    return { ...column, values, low, high };
  });
  const traces = payload.traces.map(({ row, visits, tick, t, x, y, yaw, steps, values }): [number, Trace] => {
    const all = numbers(values);
    const times = Float64Array.from(numbers(t), (value) => value * tick);
    const pieces = times.length - 1;
    let place = 0;
    const along = columns.map((column) => {
      if (column.along === null) return null;
      const own = all.subarray(place * pieces, (place + 1) * pieces);
      const step = steps[place++]!;
      return alongOf(Float64Array.from(own, (value) => value * step), times, column.adds);
    });
    return [row, { visits, t: times, x: metres(x, 0), y: metres(y, 1), yaw: radians(yaw), along }];
  });
  return {
    title: payload.title,
    status: payload.status,
    complete: payload.complete,
    certificate: payload.certificate,
    notes: payload.notes,
    n: payload.count,
    columns,
    criteria: columns.filter((column) => !column.reported).length,
    marks: payload.marks,
    paths: pathsOf(payload, numbers, metres),
    world: worldOf(payload, numbers, metres),
    tour: payload.tour && { ...payload.tour, order: numbers(payload.tour.order) },
    traces: new Map(traces),
    saved: payload.saved,
  };
}

/** Rates (m,) and running values (m + 1,) of a criterion from its values in pieces (m,). */
function alongOf(
  values: Float64Array,
  t: Float64Array,
  adds: Column["adds"],
): { readonly rate: Float64Array; readonly running: Float64Array } {
  const running = new Float64Array(t.length);
  if (adds !== "sum") running[0] = values[0] ?? 0;
  let [total, time] = [0, 0];
  const rate = values.map((value, i) => {
    const lasts = t[i + 1]! - t[i]!;
    total += adds === "sum" ? value : value * lasts;
    time += lasts;
    running[i + 1] = adds === "sum" ? total : adds === "max" ? Math.max(running[i]!, value) : total / (time || 1);
    return adds === "sum" ? (lasts > 0 ? value / lasts : 0) : value;
  });
  return { rate, running };
}

function pathsOf(
  payload: Payload,
  numbers: (packed: Packed) => Float64Array | Int32Array | Int16Array,
  metres: (packed: Packed, axis: 0 | 1) => Float64Array,
): Paths {
  const x = metres(payload.paths.x, 0);
  const y = metres(payload.paths.y, 1);
  const point = numbers(payload.paths.corners) as Int32Array;
  return {
    offsets: sums(numbers(payload.paths.counts)),
    point,
    points: x.length,
    x: Float64Array.from(point, (i) => x[i]!),
    y: Float64Array.from(point, (i) => y[i]!),
  };
}

function worldOf(
  payload: Payload,
  numbers: (packed: Packed) => Float64Array | Int32Array | Int16Array,
  metres: (packed: Packed, axis: 0 | 1) => Float64Array,
): World {
  const { rings, field, ...world } = payload.world;
  const x = metres(rings.x, 0);
  const y = metres(rings.y, 1);
  const offsets = sums(numbers(rings.counts));
  const ring = (i: number): Ring => {
    const [begin, end] = [offsets[i]!, offsets[i + 1]!];
    return Float64Array.from({ length: 2 * (end - begin) }, (_, k) => (k % 2 ? y : x)[begin + (k >> 1)]!);
  };
  const area = ({ first, count }: PackedArea): Area => Array.from({ length: count }, (_, k) => ring(first + k));
  return {
    ...world,
    field: field && { ...field, shares: Float64Array.from(numbers(field.values), (value) => value / 1000) },
    extent: area(world.extent),
    closed: area(world.closed),
    obstacles: world.obstacles.map((one) => ({
      area: area(one),
      low: one.z[0] ?? -Infinity,
      high: one.z[1] ?? Infinity,
    })),
    zones: world.zones.map((zone) => ({
      ...zone,
      area: area(zone.area),
      path: zone.path && Float64Array.from(zone.path),
    })),
  };
}

async function inflated(base64: string): Promise<Uint8Array> {
  const packed = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unpacked(bytes: Uint8Array, [type, at, count, order]: Packed): Float64Array | Int32Array | Int16Array {
  const values = new ARRAYS[type](count);
  const size = values.BYTES_PER_ELEMENT;
  const raw = new Uint8Array(values.buffer);
  for (let plane = 0; plane < size; plane++) {
    const from = at + plane * count;
    for (let i = 0; i < count; i++) raw[i * size + plane] = bytes[from + i]!;
  }
  for (let sum = 0; sum < order; sum++) {
    for (let i = 1; i < count; i++) values[i]! += values[i - 1]!; // sums wrap at 32 bits, as the differences did
  }
  return values;
}

/** Running sums (n + 1,) of counts (n,), from 0. */
function sums(counts: ArrayLike<number>): Int32Array {
  const offsets = new Int32Array(counts.length + 1);
  for (let i = 0; i < counts.length; i++) offsets[i + 1] = offsets[i]! + counts[i]!;
  return offsets;
}

function rangeOf(values: Float64Array): [number, number] {
  if (values.length === 0) return [0, 0];
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}
