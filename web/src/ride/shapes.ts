// Builder of triangles: upright things as walls and tops, in three's axes, one mesh for each material.
import { BufferAttribute, BufferGeometry, ShapeUtils, Vector2, Vector3 } from "three";
import type { Colour, Mesh, Part, Point, Ring } from "./model";

/** Appearance of a surface: contrast of the waves, darkness of the grid, whether it has a skirting. */
export interface Look {
  readonly contrast: number;
  readonly grid: number;
  readonly skirting: boolean;
}

export const PLAIN: Look = { contrast: 0, grid: 0, skirting: false };

export class Triangles {
  private readonly positions: number[] = [];
  private readonly normals: number[] = [];
  private readonly places: number[] = [];
  private readonly paints: number[] = [];
  private readonly looks: number[] = [];

  /** Adds a corner in world axes, and its position on the tile, m. */
  private corner(p: Vector3, normal: Vector3, u: number, v: number, colour: Colour, look: Look, number: number): void {
    this.positions.push(p.x, p.z, -p.y);
    this.normals.push(normal.x, normal.z, -normal.y);
    this.places.push(u, v);
    this.paints.push(colour[0] / 255, colour[1] / 255, colour[2] / 255);
    this.looks.push(look.contrast, look.grid, look.skirting ? 1 : 0, number);
  }

  /** The wall over each edge of rings, the outer one counter-clockwise and holes clockwise. */
  walls(rings: readonly Ring[], low: number, high: number, colour: Colour, look: Look, number: number): void {
    const normal = new Vector3();
    const corners = [new Vector3(), new Vector3(), new Vector3(), new Vector3()] as const;
    for (const ring of rings) {
      ring.forEach(([ax, ay], i) => {
        const [bx, by] = ring[(i + 1) % ring.length]!;
        const length = Math.hypot(bx - ax, by - ay);
        if (length === 0) return;
        const [dx, dy] = [(bx - ax) / length, (by - ay) / length];
        normal.set(dy, -dx, 0);
        corners[0].set(ax, ay, low);
        corners[1].set(bx, by, low);
        corners[2].set(bx, by, high);
        corners[3].set(ax, ay, high);
        for (const k of [0, 1, 2, 0, 2, 3] as const) {
          const p = corners[k];
          this.corner(p, normal, p.x * dx + p.y * dy, p.z, colour, look, number);
        }
      });
    }
  }

  /** A flat area of rings at a height, seen from above or from below. */
  level(rings: readonly Ring[], z: number, up: boolean, colour: Colour, look: Look, number: number): void {
    const [outer, ...holes] = rings.map((ring) => ring.map(([x, y]) => new Vector2(x, y)));
    if (outer === undefined) return;
    const points = [outer, ...holes].flat();
    const normal = new Vector3(0, 0, up ? 1 : -1);
    for (const triangle of ShapeUtils.triangulateShape(outer, holes)) {
      const [a, b, c] = triangle.map((k) => points[k]!) as [Vector2, Vector2, Vector2];
      const leftwards = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x) > 0;
      for (const p of leftwards === up ? [a, b, c] : [a, c, b]) {
        this.corner(new Vector3(p.x, p.y, z), normal, p.x, p.y, colour, look, number);
      }
    }
  }

  /** A convex body, flat-shaded. */
  mesh(mesh: Mesh): void {
    const normal = new Vector3();
    const along = new Vector3();
    for (const triangle of mesh.triangles) {
      const [a, b, c] = triangle.map((k) => new Vector3(...mesh.points[k]!)) as [Vector3, Vector3, Vector3];
      normal.subVectors(b, a).cross(along.subVectors(c, a)).normalize();
      for (const p of [a, b, c]) this.corner(p, normal, 0, 0, mesh.colour, PLAIN, mesh.number);
    }
  }

  /** A part of a person who looks along x, round the origin: a cylinder or an ellipsoid. */
  part({ shape, radius, low, high, colour, back }: Part, number: number): void {
    const [middle, half] = [(low + high) / 2, (high - low) / 2];
    const rim = (k: number): Point => [Math.cos((2 * Math.PI * k) / AROUND), Math.sin((2 * Math.PI * k) / AROUND)];
    const rows = shape === "cylinder" ? [0, Math.PI] : Array.from({ length: UPWARD + 1 }, (_, j) => (Math.PI * j) / UPWARD);
    const corner = (k: number, polar: number, paint: Colour): void => {
      const [x, y] = rim(k);
      const upright = shape === "cylinder";
      const wide = upright ? 1 : Math.sin(polar);
      const tall = upright ? (polar > 0 ? 1 : -1) : -Math.cos(polar);
      const normal = upright ? new Vector3(x, y, 0) : new Vector3((x * wide) / radius, (y * wide) / radius, tall / half);
      this.corner(new Vector3(radius * wide * x, radius * wide * y, middle + half * tall), normal.normalize(), 0, 0, paint, PLAIN, number);
    };
    for (let k = 0; k < AROUND; k++) {
      const paint = rim(k + 0.5)[0] > 0 ? colour : back;
      for (let j = 0; j + 1 < rows.length; j++) {
        const [p, q] = [rows[j]!, rows[j + 1]!];
        for (const [column, row] of [[k, p], [k + 1, p], [k + 1, q], [k, p], [k + 1, q], [k, q]] as const) {
          corner(column, row, paint);
        }
      }
    }
    if (shape === "cylinder") {
      this.level([Array.from({ length: AROUND }, (_, k) => rim(k).map((c) => radius * c) as unknown as Point)], high, true, colour, PLAIN, number);
    }
  }

  geometry(): BufferGeometry {
    const geometry = new BufferGeometry();
    const attributes: [string, number[], number][] = [
      ["position", this.positions, 3],
      ["normal", this.normals, 3],
      ["place", this.places, 2],
      ["paint", this.paints, 3],
      ["look", this.looks, 4],
    ];
    for (const [name, values, size] of attributes) {
      geometry.setAttribute(name, new BufferAttribute(new Float32Array(values), size));
    }
    return geometry;
  }
}

/** Number of sides of round bodies; a multiple of 4, so that front and back of a person meet at an edge. */
const AROUND = 32;
const UPWARD = 16;
