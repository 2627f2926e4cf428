// What is drawn on the floor of the view: the ways, the destination, and the place at which the viewer points.
import {
  BufferAttribute,
  BufferGeometry,
  CanvasTexture,
  CylinderGeometry,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  RingGeometry,
  Sprite,
  SpriteMaterial,
  SRGBColorSpace,
} from "three";
import type { Point } from "../ride/model";
import { type Drawn, GOAL } from "./colours";

/** m above the floor, and the widths of a way. */
const ABOVE = 0.015;
const WIDE = 0.16;
const NARROW = 0.08;
/** m along a way at which its number stands, and how large it is. */
const MARKED = 3;
const MARK = 0.32;

export class Floor {
  readonly root = new Group();
  private readonly ways = new Group();
  private readonly goals = new Group();
  private readonly pointer = new Mesh(new RingGeometry(0.16, 0.24, 32), flat("#ffffff", 0.95));
  private readonly marks = new Map<string, SpriteMaterial>();

  constructor() {
    this.pointer.rotation.x = -Math.PI / 2;
    this.pointer.renderOrder = 6;
    this.pointer.visible = false;
    this.root.add(this.ways, this.goals, this.pointer);
  }

  /** Draws ways; those that come later lie above. */
  showWays(ways: readonly Drawn[]): void {
    empty(this.ways);
    ways.forEach((way, i) => {
      if (way.line.length < 2) return;
      const geometry = ribbon(way.line, way.strong ? WIDE : NARROW, ABOVE + 0.002 * i);
      const strip = new Mesh(geometry, flat(way.colour, way.strong ? 0.95 : 0.75));
      strip.renderOrder = 3 + (way.strong ? 1 : 0);
      strip.frustumCulled = false;
      this.ways.add(strip);
      if (way.mark !== "") this.ways.add(this.mark(way, i));
    });
  }

  /** Draws a ring and a pole at each destination. */
  showGoals(places: readonly Point[]): void {
    empty(this.goals);
    for (const [x, y] of places) {
      const ring = new Mesh(new RingGeometry(0.28, 0.38, 40), flat(GOAL, 0.95));
      ring.rotation.x = -Math.PI / 2;
      ring.position.set(x, ABOVE + 0.02, -y);
      ring.renderOrder = 5;
      const pole = new Mesh(new CylinderGeometry(0.02, 0.02, 1.1, 8), new MeshBasicMaterial({ color: GOAL }));
      pole.position.set(x, 0.55, -y);
      this.goals.add(ring, pole);
    }
  }

  /** Shows at which place of the floor the viewer points, and whether it may be a destination; null for none. */
  point(place: Point | null, free: boolean): void {
    this.pointer.visible = place !== null;
    if (place === null) return;
    this.pointer.position.set(place[0], ABOVE + 0.03, -place[1]);
    this.pointer.material.color.set(free ? "#ffffff" : "#ff6f59");
  }

  private mark(way: Drawn, i: number): Sprite {
    const key = `${way.mark} ${way.colour}`;
    let material = this.marks.get(key);
    if (material === undefined) {
      material = new SpriteMaterial({ map: disc(way.mark, way.colour), depthTest: true, transparent: true });
      this.marks.set(key, material);
    }
    const sprite = new Sprite(material);
    const [x, y] = along(way.line, MARKED + 0.7 * i);
    sprite.position.set(x, MARK / 2 + 0.05, -y);
    sprite.scale.setScalar(MARK);
    sprite.renderOrder = 7;
    return sprite;
  }
}

/** The place on a line at a distance from its begin, or nearly at its end. */
export function along(line: readonly Point[], distance: number): Point {
  const lengths = line.slice(1).map(([x, y], i) => Math.hypot(x - line[i]![0], y - line[i]![1]));
  let rest = Math.min(distance, 0.7 * lengths.reduce((a, b) => a + b, 0));
  for (const [i, length] of lengths.entries()) {
    if (length > 0 && rest <= length) {
      const [a, b] = [line[i]!, line[i + 1]!];
      return [a[0] + (rest / length) * (b[0] - a[0]), a[1] + (rest / length) * (b[1] - a[1])];
    }
    rest -= length;
  }
  return line.at(-1) ?? [0, 0];
}

function flat(colour: string, opacity: number): MeshBasicMaterial {
  return new MeshBasicMaterial({ color: colour, opacity, transparent: true, depthWrite: false, side: DoubleSide });
}

/** A strip on the floor along a line: a rectangle for each piece, longer by half its width, so that corners are closed. */
function ribbon(line: readonly Point[], width: number, height: number): BufferGeometry {
  const corners: number[] = [];
  for (let i = 1; i < line.length; i++) {
    const [[ax, ay], [bx, by]] = [line[i - 1]!, line[i]!];
    const length = Math.hypot(bx - ax, by - ay);
    if (length === 0) continue;
    const [dx, dy] = [((bx - ax) / length) * (width / 2), ((by - ay) / length) * (width / 2)];
    const [x0, y0, x1, y1] = [ax - 0.5 * dx, ay - 0.5 * dy, bx + 0.5 * dx, by + 0.5 * dy];
    const ring = [[x0 - dy, y0 + dx], [x0 + dy, y0 - dx], [x1 + dy, y1 - dx], [x1 - dy, y1 + dx]] as const;
    for (const k of [0, 1, 2, 0, 2, 3] as const) corners.push(ring[k][0], height, -ring[k][1]);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
  return geometry;
}

function disc(text: string, colour: string): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const pen = canvas.getContext("2d")!;
  pen.beginPath();
  pen.arc(32, 32, 29, 0, 2 * Math.PI);
  pen.fillStyle = colour;
  pen.fill();
  pen.lineWidth = 4;
  pen.strokeStyle = "#111";
  pen.stroke();
  pen.font = "bold 40px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillStyle = "#111";
  pen.fillText(text, 32, 34);
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

function empty(group: Group): void {
  for (const object of group.children) {
    if (!(object instanceof Mesh)) continue;
    (object.geometry as BufferGeometry).dispose();
    (object.material as MeshBasicMaterial).dispose();
  }
  group.clear();
}
