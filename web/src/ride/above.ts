// The world from above, on a canvas: floor, zones, obstacles and landmarks are drawn once, and what moves on top of them.
import type { Point, Ring, Scene } from "./model";
import { fitted } from "./sheets";

/** Margin round the points that a map must show, m. */
const ROUND = 4;
const PERSON = "#a5443a";

export class Above {
  /** Pixels a metre. */
  scale = 1;
  private ground: HTMLCanvasElement | null = null;
  private x0 = 0;
  private y1 = 0;

  /** A map of the surroundings of `xs` and `ys`; `more` adds to what never moves. */
  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly scene: Scene,
    private readonly xs: readonly number[],
    private readonly ys: readonly number[],
    private readonly more: (pen: CanvasRenderingContext2D) => void = () => undefined,
  ) {}

  /** Draws what never moves; returns the pen for the rest, or null where the canvas is not shown. */
  draw(): CanvasRenderingContext2D | null {
    const pen = fitted(this.canvas);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (pen === null) return null;
    if (this.ground?.width !== this.canvas.width || this.ground.height !== this.canvas.height) this.prepare(width, height);
    pen.save();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.ground!, 0, 0);
    pen.restore();
    return pen;
  }

  /** Pixels of a place in the world. */
  at(x: number, y: number): [number, number] {
    return [(x - this.x0) * this.scale, (this.y1 - y) * this.scale];
  }

  /** The place in the world at pixels. */
  placeAt(u: number, v: number): [number, number] {
    return [this.x0 + u / this.scale, this.y1 - v / this.scale];
  }

  /** A person at a place, who looks or walks in a direction. */
  person(pen: CanvasRenderingContext2D, [x, y]: Point, yaw: number, radius: number): void {
    const [u, v] = this.at(x, y);
    const r = Math.max(radius * this.scale, 3);
    pen.beginPath();
    pen.arc(u, v, r, 0, 2 * Math.PI);
    pen.fillStyle = PERSON;
    pen.fill();
    pen.beginPath();
    pen.moveTo(u, v);
    pen.lineTo(u + 1.7 * r * Math.cos(yaw), v - 1.7 * r * Math.sin(yaw));
    pen.strokeStyle = PERSON;
    pen.lineWidth = 2;
    pen.stroke();
  }

  /** A disc with a number or a letter. */
  badge(pen: CanvasRenderingContext2D, [x, y]: Point, text: string, colour: string, ink: string): void {
    const [u, v] = this.at(x, y);
    pen.beginPath();
    pen.arc(u, v, 8, 0, 2 * Math.PI);
    pen.setLineDash([]);
    pen.fillStyle = colour;
    pen.fill();
    pen.font = "bold 11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillStyle = ink;
    pen.fillText(text, u, v + 0.5);
  }

  /** A line through points, with a dark edge, so that it is seen on every ground. */
  line(pen: CanvasRenderingContext2D, points: Iterable<Point>, colour: string, dashes: readonly number[], width: number): void {
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(...this.at(x, y));
    pen.setLineDash([]);
    pen.strokeStyle = "#1b1e21";
    pen.lineWidth = width + 1.8;
    pen.stroke();
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.globalAlpha = 0.45; // between dashes too, the line has its colour
    pen.stroke();
    pen.globalAlpha = 1;
    pen.setLineDash([...dashes]);
    pen.stroke();
    pen.setLineDash([]);
  }

  fill(pen: CanvasRenderingContext2D, rings: readonly Ring[], style: string): void {
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

  private prepare(width: number, height: number): void {
    const { scene, xs, ys } = this;
    const corners = scene.floor.flat(2);
    const least = (values: readonly number[], from: number[]): number => Math.max(min(values) - ROUND, min(from) - 0.3);
    const most = (values: readonly number[], from: number[]): number => Math.min(max(values) + ROUND, max(from) + 0.3);
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
    this.more(pen);
    this.ground = ground;
  }

  private cells(pen: CanvasRenderingContext2D): void {
    const cells = this.scene.cells;
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
