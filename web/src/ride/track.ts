// An executed trajectory: the pose of the camera at any time, and the share of the path that is done.
import { Quaternion, Vector3 } from "three";
import type { Packed, TrackData } from "./model";

/** Distance, m, that counts as equal to turning by a radian, so that a turn in place is progress too. */
const LEVER = 0.5;
/** s before and after a moment over which its angular speed is measured */
const HALF = 0.05;

/** Columns of floats from whole numbers that were differenced twice. */
export function unpacked({ scale, columns }: Packed): Float64Array[] {
  return columns.map((twice) => {
    const values = new Float64Array(twice.length);
    let step = 0;
    let sum = 0;
    for (let i = 0; i < twice.length; i++) {
      step += twice[i]!;
      sum += step;
      values[i] = sum * scale;
    }
    return values;
  });
}

/** Index of the interval of ascending `edges` that holds a value, and where in it, 0 to 1. */
export function placed(edges: Float64Array, value: number): [number, number] {
  let low = 0;
  let high = edges.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (edges[middle]! <= value) low = middle;
    else high = middle;
  }
  const width = (edges[low + 1] ?? edges[low]!) - edges[low]!;
  return [low, width > 0 ? Math.min(Math.max((value - edges[low]!) / width, 0), 1) : 0];
}

/** A moving body: seven columns, position and quaternion x, y, z, w, at times in common. */
class Body {
  private readonly from = new Quaternion();
  private readonly to = new Quaternion();

  constructor(private readonly columns: readonly Float64Array[]) {}

  get size(): number {
    return this.columns[0]!.length;
  }

  at(i: number, share: number, position: Vector3, turned: Quaternion): void {
    const [x, y, z, qx, qy, qz, qw] = this.columns as [
      Float64Array, Float64Array, Float64Array, Float64Array, Float64Array, Float64Array, Float64Array,
    ];
    const j = Math.min(i + 1, x.length - 1);
    const mixed = (c: Float64Array): number => c[i]! + share * (c[j]! - c[i]!);
    position.set(mixed(x), mixed(y), mixed(z));
    this.from.set(qx[i]!, qy[i]!, qz[i]!, qw[i]!).normalize();
    this.to.set(qx[j]!, qy[j]!, qz[j]!, qw[j]!).normalize();
    turned.copy(this.from).slerp(this.to, share);
  }
}

export class Track {
  readonly name: string;
  readonly label: string;
  readonly duration: number;
  /** (n,) s */
  readonly times: Float64Array;
  /** (n,) m, of the camera: x and y, for maps. */
  readonly x: Float64Array;
  readonly y: Float64Array;
  private readonly camera: Body;
  private readonly links: Body[];
  /** (n,) share of the path done, from 0 to 1, never falling. */
  private readonly progress: Float64Array;
  /** (n - 1,) m and rad a second, between samples. */
  private readonly paces: Float64Array;

  constructor(readonly data: TrackData) {
    this.name = data.name;
    this.label = data.label;
    this.duration = data.duration;
    const columns = [...unpacked(data.positions), ...unpacked(data.quaternions)];
    this.camera = new Body(columns);
    const count = this.camera.size;
    this.times = Float64Array.from({ length: count }, (_, i) => Math.min(i / data.rate, data.duration));
    this.x = columns[0]!;
    this.y = columns[1]!;
    const links = unpacked(data.links);
    this.links = Array.from({ length: links.length / 7 }, (_, k) => new Body(links.slice(7 * k, 7 * k + 7)));
    this.progress = new Float64Array(count);
    this.paces = new Float64Array(Math.max(count - 1, 0));
    this.measure();
  }

  /** Pose of the camera at a time, world axes. */
  pose(t: number, position: Vector3, turned: Quaternion): void {
    const [i, share] = placed(this.times, t);
    this.camera.at(i, share, position, turned);
  }

  /** Pose of a link of the robot at a time, world axes. */
  link(k: number, t: number, position: Vector3, turned: Quaternion): void {
    const [i, share] = placed(this.times, t);
    this.links[k]!.at(i, share, position, turned);
  }

  /** Share of the path done at a time: metres moved, plus half a metre for each radian turned. */
  progressAt(t: number): number {
    const [i, share] = placed(this.times, t);
    const next = this.progress[i + 1] ?? this.progress[i]!;
    return this.progress[i]! + share * (next - this.progress[i]!);
  }

  /** The first time at which a share of the path is done. */
  timeAt(progress: number): number {
    if (progress >= 1) return this.duration;
    let i = this.progress.findIndex((done) => done >= progress);
    if (i <= 0) i = Math.min(1, this.times.length - 1);
    const before = this.progress[Math.max(i - 1, 0)]!;
    const step = this.progress[i]! - before;
    const share = step > 0 ? (progress - before) / step : 0;
    return this.times[Math.max(i - 1, 0)]! + share * (this.times[i]! - this.times[Math.max(i - 1, 0)]!);
  }

  /** Speed of the camera at a time, m/s, with half a metre for each radian of turning. */
  pace(t: number): number {
    return this.paces[Math.min(placed(this.times, t)[0], this.paces.length - 1)] ?? 0;
  }

  /** Angular speed of the camera, rad/s, about a time. */
  turning(t: number): number {
    const [a, b] = [new Vector3(), new Vector3()];
    const [p, q] = [new Quaternion(), new Quaternion()];
    const [from, to] = [Math.max(t - HALF, 0), Math.min(t + HALF, this.duration)];
    this.pose(from, a, p);
    this.pose(to, b, q);
    return to > from ? p.angleTo(q) / (to - from) : 0;
  }

  private measure(): void {
    const [a, b] = [new Vector3(), new Vector3()];
    const [p, q] = [new Quaternion(), new Quaternion()];
    for (let i = 1; i < this.times.length; i++) {
      this.camera.at(i - 1, 0, a, p);
      this.camera.at(i, 0, b, q);
      const way = a.distanceTo(b) + LEVER * p.angleTo(q);
      this.progress[i] = this.progress[i - 1]! + way;
      const step = this.times[i]! - this.times[i - 1]!;
      this.paces[i - 1] = step > 0 ? way / step : 0;
    }
    const all = this.progress.at(-1)!;
    for (let i = 0; i < this.progress.length; i++) {
      this.progress[i] = all > 0 ? this.progress[i]! / all : this.times[i]! / Math.max(this.duration, 1e-9);
    }
  }
}
