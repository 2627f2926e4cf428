// The small map: obstacles from above, the paths, and the camera's position and direction.
import { Quaternion, Vector3 } from "three";
import type { Clock } from "./clock";
import { colourOfTrack, dashesOfTrack } from "./colours";
import { type Ring, type Ride, whereIs } from "./model";
import { fitted } from "./sheets";

/** Margin round the paths, m, within the map. */
const ROUND = 4;
const SIGHT = 1.1; // rad: half of a wedge that shows where the camera looks

export class Plan {
  private ground: HTMLCanvasElement | null = null;
  private x0 = 0;
  private y1 = 0;
  private scale = 1;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly ride: Ride,
    private readonly clock: Clock,
  ) {}

  draw(): void {
    const pen = fitted(this.canvas);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (pen === null) return;
    if (this.ground?.width !== this.canvas.width || this.ground.height !== this.canvas.height) this.prepare(width, height);
    pen.save();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.ground!, 0, 0);
    pen.restore();
    this.people(pen);
    const { tracks, current } = this.clock;
    tracks.forEach((track, i) => {
      if (i !== current) this.camera(pen, i, this.clock.timeOf(i), track.x.length > 0 ? 3.5 : 0, false);
    });
    this.camera(pen, current, this.clock.t, 6, true);
  }

  private at(x: number, y: number): [number, number] {
    return [(x - this.x0) * this.scale, (this.y1 - y) * this.scale];
  }

  private prepare(width: number, height: number): void {
    const { scene } = this.ride;
    const xs = this.clock.tracks.flatMap((track) => [...track.x]);
    const ys = this.clock.tracks.flatMap((track) => [...track.y]);
    const corners = scene.floor.flat(2);
    const least = (values: number[], from: number[]): number => Math.max(min(values) - ROUND, min(from) - 0.3);
    const most = (values: number[], from: number[]): number => Math.min(max(values) + ROUND, max(from) + 0.3);
    const [floorX, floorY] = [corners.map(([x]) => x), corners.map(([, y]) => y)];
    let [left, right] = [least(xs, floorX), most(xs, floorX)];
    let [low, high] = [least(ys, floorY), most(ys, floorY)];
    if (!(right > left) || !(high > low)) [left, right, low, high] = [min(xs) - 1, max(xs) + 1, min(ys) - 1, max(ys) + 1];
    this.scale = Math.min(width / (right - left), height / (high - low));
    const [wide, tall] = [width / this.scale, height / this.scale];
    this.x0 = within((left + right - wide) / 2, wide, min(floorX), max(floorX));
    this.y1 = within((low + high - tall) / 2, tall, min(floorY), max(floorY)) + tall;
    const ground = document.createElement("canvas");
    ground.width = this.canvas.width;
    ground.height = this.canvas.height;
    const pen = ground.getContext("2d")!;
    pen.scale(ground.width / width, ground.height / height);
    pen.fillStyle = "#23282d";
    pen.fillRect(0, 0, width, height);
    for (const rings of scene.floor) this.fill(pen, rings, "#c9c3b8");
    for (const zone of scene.zones) {
      for (const rings of zone.polygons) this.fill(pen, rings, `rgb(${zone.colour.join(" ")} / 0.4)`);
    }
    for (const prism of scene.prisms) this.fill(pen, prism.rings, prism.is_wall ? "#4a4a4a" : `rgb(${prism.colour.join(" ")})`);
    this.cells(pen);
    pen.fillStyle = "#7a4b00";
    for (const mark of scene.landmarks) {
      const [x, y] = this.at(mark.x, mark.y);
      pen.fillRect(x - 2.5, y - 2.5, 5, 5);
    }
    this.clock.tracks.forEach((track, i) => {
      pen.beginPath();
      for (let k = 0; k < track.x.length; k++) pen.lineTo(...this.at(track.x[k]!, track.y[k]!));
      pen.setLineDash([]);
      pen.strokeStyle = "#1b1e21";
      pen.lineWidth = 4;
      pen.stroke();
      pen.setLineDash([...dashesOfTrack(i)]);
      pen.strokeStyle = colourOfTrack(i);
      pen.lineWidth = 2.2;
      pen.stroke();
    });
    this.ride.stops.forEach((place, i) => {
      if (place === null) return;
      const [u, v] = this.at(...place);
      pen.beginPath();
      pen.arc(u, v, 8, 0, 2 * Math.PI);
      pen.setLineDash([]);
      pen.fillStyle = "#7a0177"; // as in hpop/view/marks.py
      pen.fill();
      pen.font = "bold 11px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      pen.fillStyle = "#ffffff";
      pen.fillText(String(i + 1), u, v + 0.5);
    });
    this.ground = ground;
  }

  private fill(pen: CanvasRenderingContext2D, rings: readonly Ring[], style: string): void {
    pen.beginPath();
    for (const ring of rings) {
      ring.forEach(([x, y], i) => {
        const [u, v] = this.at(x, y);
        if (i === 0) pen.moveTo(u, v);
        else pen.lineTo(u, v);
      });
      pen.closePath();
    }
    pen.fillStyle = style;
    pen.fill("evenodd");
  }

  private cells(pen: CanvasRenderingContext2D): void {
    const cells = this.ride.scene.cells;
    if (cells === null) return;
    const [x, y, yaw] = cells.origin;
    const [u, v] = this.at(x, y);
    pen.save();
    pen.translate(u, v);
    pen.rotate(-yaw);
    pen.scale(this.scale * cells.resolution, -this.scale * cells.resolution);
    pen.fillStyle = "#4a4a4a";
    for (const [x0, y0, x1, y1] of cells.boxes) pen.fillRect(x0, y0, x1 - x0, y1 - y0);
    pen.restore();
  }

  private people(pen: CanvasRenderingContext2D): void {
    for (const person of this.ride.scene.people) {
      const place = whereIs(person, this.clock.t);
      if (place === null) continue;
      const [u, v] = this.at(place[0], place[1]);
      const yaw = place[2];
      const r = Math.max(person.radius * this.scale, 3);
      pen.beginPath();
      pen.arc(u, v, r, 0, 2 * Math.PI);
      pen.fillStyle = "#a5443a";
      pen.fill();
      pen.beginPath();
      pen.moveTo(u, v);
      pen.lineTo(u + 1.7 * r * Math.cos(yaw), v - 1.7 * r * Math.sin(yaw));
      pen.strokeStyle = "#a5443a";
      pen.lineWidth = 2;
      pen.stroke();
    }
  }

  /** A dot at a camera's position; for the current trajectory also a wedge in its direction. */
  private camera(pen: CanvasRenderingContext2D, i: number, t: number, size: number, looks: boolean): void {
    const [p, q] = [new Vector3(), new Quaternion()];
    this.clock.tracks[i]!.pose(t, p, q);
    const [u, v] = this.at(p.x, p.y);
    if (looks) {
      const ahead = new Vector3(1, 0, 0).applyQuaternion(q);
      const heading = Math.atan2(-ahead.y, ahead.x);
      const fov = this.ride.field_of_view;
      const half = fov === null ? SIGHT / 2 : Math.min(fov[0], 2 * Math.PI) / 2;
      pen.beginPath();
      pen.moveTo(u, v);
      pen.arc(u, v, 26, heading - half, heading + half);
      pen.closePath();
      pen.fillStyle = "rgb(255 255 255 / 0.55)";
      pen.fill();
    }
    pen.beginPath();
    pen.arc(u, v, size, 0, 2 * Math.PI);
    pen.fillStyle = colourOfTrack(i);
    pen.fill();
    pen.strokeStyle = "#111";
    pen.lineWidth = 1.5;
    pen.stroke();
  }
}

/** Beginning of a window of a length: as wanted, but inside an interval as far as possible. */
function within(begin: number, length: number, low: number, high: number): number {
  if (!(high > low)) return begin;
  return length >= high - low ? (low + high - length) / 2 : Math.min(Math.max(begin, low), high - length);
}

function min(values: readonly number[]): number {
  return values.reduce((a, b) => Math.min(a, b), Infinity);
}

function max(values: readonly number[]): number {
  return values.reduce((a, b) => Math.max(a, b), -Infinity);
}
