// The minimap: where the robot is, who walks round it, the ways and the destination; one clicks on it or walks on it by keys.
import { Above } from "../ride/above";
import type { Point, Vector } from "../ride/model";
import { type Drawn, GOAL, WHY } from "./colours";
import { along } from "./floor";
import type { LiveScene } from "./messages";

const SIGHT = 1.1; // rad: a wedge that shows where the camera looks
const RADIUS = 0.25;
/** m that the cross moves by a key: with and without Shift. */
const STEPS = [0.25, 1] as const;

export interface Shown {
  readonly pose: Vector | null;
  readonly people: readonly Vector[];
  readonly ways: readonly Drawn[];
  readonly goals: readonly Point[];
  /** Place about which the viewer asked why the robot does not go there. */
  readonly asked: Point | null;
  readonly closed: readonly (readonly Point[])[];
  /** Where the viewer looks from the robot's ahead, rad. */
  readonly look: number;
}

export class Minimap {
  private readonly above: Above;
  private cross: Point | null = null;
  private shown: Shown | null = null;

  constructor(
    canvas: HTMLCanvasElement,
    private readonly scene: LiveScene,
    private readonly chosen: (place: Point) => void,
    private readonly moved: (place: Point) => void,
  ) {
    const corners = scene.scene.floor.flat(2);
    this.above = new Above(canvas, scene.scene, corners.map(([x]) => x), corners.map(([, y]) => y));
    canvas.addEventListener("mousedown", (event) => { event.preventDefault(); }); // arrow keys go on steering
    canvas.addEventListener("click", (event) => {
      const box = canvas.getBoundingClientRect();
      this.cross = null;
      this.chosen(this.above.placeAt(event.clientX - box.left, event.clientY - box.top));
    });
    canvas.addEventListener("keydown", (event) => { this.key(event); });
    canvas.addEventListener("blur", () => {
      this.cross = null;
      this.redraw();
    });
  }

  draw(shown: Shown): void {
    this.shown = shown;
    this.redraw();
  }

  private redraw(): void {
    const pen = this.above.draw();
    const { shown } = this;
    if (pen === null || shown === null) return;
    for (const ring of shown.closed) this.above.fill(pen, [ring], "rgb(179 38 30 / 0.55)");
    for (const way of shown.ways) this.above.line(pen, way.line, way.colour, way.dashes, way.strong ? 4 : 2);
    shown.ways.forEach((way, i) => {
      if (way.mark !== "" && way.line.length > 1) this.above.badge(pen, along(way.line, 3 + 0.7 * i), way.mark, way.colour, "#111");
    });
    this.names(pen);
    for (const [px, py, yaw] of shown.people) this.above.person(pen, [px, py], yaw, RADIUS);
    shown.goals.forEach((place, i) => {
      if (shown.goals.length > 1) this.above.badge(pen, place, String.fromCharCode(65 + i), GOAL, "#111");
      else this.pin(pen, place);
    });
    if (shown.asked !== null) this.above.badge(pen, shown.asked, "?", WHY, "#111");
    if (shown.pose !== null) this.robot(pen, shown.pose, shown.look);
    if (this.cross !== null) this.drawCross(pen, this.cross);
  }

  private names(pen: CanvasRenderingContext2D): void {
    const { landmarks } = this.scene.scene;
    if (landmarks.length > 12) return;
    pen.font = "600 11px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    const width = this.above.canvas.clientWidth;
    for (const { x, y, name } of landmarks) {
      const [u, v] = this.above.at(x, y);
      const text = name.length > 18 ? `${name.slice(0, 17)}…` : name;
      const leftwards = u + 8 + pen.measureText(text).width > width;
      pen.textAlign = leftwards ? "right" : "left";
      pen.lineWidth = 3;
      pen.strokeStyle = "rgb(255 255 255 / 0.8)";
      pen.strokeText(text, u + (leftwards ? -6 : 6), v);
      pen.fillStyle = "#3d2600";
      pen.fillText(text, u + (leftwards ? -6 : 6), v);
    }
  }

  private robot(pen: CanvasRenderingContext2D, [x, y, yaw]: Vector, look: number): void {
    const [u, v] = this.above.at(x, y);
    pen.beginPath();
    pen.moveTo(u, v);
    pen.arc(u, v, 30, -yaw - look - SIGHT / 2, -yaw - look + SIGHT / 2);
    pen.closePath();
    pen.fillStyle = "rgb(255 255 255 / 0.6)";
    pen.fill();
    const { outline } = this.scene;
    pen.beginPath();
    if (outline.length > 2 && this.above.scale > 18) {
      for (const [a, b] of outline) {
        pen.lineTo(...this.above.at(x + a * Math.cos(yaw) - b * Math.sin(yaw), y + a * Math.sin(yaw) + b * Math.cos(yaw)));
      }
      pen.closePath();
    } else pen.arc(u, v, Math.max(5, 0.3 * this.above.scale), 0, 2 * Math.PI);
    pen.fillStyle = "#0072b2";
    pen.fill();
    pen.strokeStyle = "#fff";
    pen.lineWidth = 1.5;
    pen.stroke();
    pen.beginPath();
    pen.moveTo(u, v);
    pen.lineTo(u + 10 * Math.cos(yaw), v - 10 * Math.sin(yaw));
    pen.stroke();
  }

  private pin(pen: CanvasRenderingContext2D, place: Point): void {
    const [u, v] = this.above.at(...place);
    pen.beginPath();
    pen.moveTo(u, v);
    pen.lineTo(u - 6, v - 13);
    pen.arc(u, v - 15, 6.5, Math.PI - 0.35, 0.35);
    pen.closePath();
    pen.fillStyle = GOAL;
    pen.fill();
    pen.strokeStyle = "#111";
    pen.lineWidth = 1.5;
    pen.stroke();
  }

  private drawCross(pen: CanvasRenderingContext2D, place: Point): void {
    const [u, v] = this.above.at(...place);
    for (const [colour, width] of [["#111", 4], ["#fff", 2]] as const) {
      pen.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
        pen.moveTo(u + 4 * dx, v + 4 * dy);
        pen.lineTo(u + 12 * dx, v + 12 * dy);
      }
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.stroke();
    }
  }

  /** Arrow keys move a cross on the map, Enter chooses its place. */
  private key(event: KeyboardEvent): void {
    const directions: Record<string, Point> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const direction = directions[event.key];
    if (event.key === "Enter" && this.cross !== null) this.chosen(this.cross);
    else if (direction !== undefined) {
      const step = STEPS[event.shiftKey ? 1 : 0];
      const [x, y] = this.cross ?? this.shown?.goals.at(-1) ?? (this.shown?.pose?.slice(0, 2) as Point | undefined) ?? [0, 0];
      this.cross = [x + step * direction[0], y + step * direction[1]];
      this.moved(this.cross);
    } else return;
    event.preventDefault();
    event.stopPropagation();
    this.redraw();
  }
}
