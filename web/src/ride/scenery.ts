// Everything in the world as objects of three.js: ground, zones, obstacles, people, landmarks, the robot's links.
import {
  type BufferGeometry,
  CanvasTexture,
  Group,
  LinearFilter,
  LinearMipmapLinearFilter,
  Mesh as Drawn,
  NoColorSpace,
  type Object3D,
  PlaneGeometry,
  Quaternion,
  type ShaderMaterial,
  SphereGeometry,
  Vector3,
} from "three";
import { bodyToThree, positionToThree } from "./axes";
import { type Cells, type Landmark, type Part, type Point, type Prism, type Surroundings, type Vector, whereIs } from "./model";
import { plateOf } from "./plates";
import { type Look, Triangles } from "./shapes";
import { Materials } from "./surfaces";
import type { Track } from "./track";

/** Distance to which the ground extends beyond the map, m. */
const BEYOND = 2000;
/** Height below which a camera is not above the floor, m. */
const ON_FLOOR = 1e-3;
/** A person whom the scene does not know, as hpop/view/ride/scene.py draws people. */
const VISITOR: readonly Part[] = [
  { shape: "cylinder", radius: 0.14, low: 0, high: 0.92, colour: [70, 76, 92], back: [70, 76, 92] },
  { shape: "ellipsoid", radius: 0.25, low: 0.74, high: 1.5, colour: [72, 120, 152], back: [72, 120, 152] },
  { shape: "ellipsoid", radius: 0.1, low: 1.46, high: 1.73, colour: [224, 188, 160], back: [84, 64, 52] },
];

export class Scenery {
  readonly root = new Group();
  readonly materials: Materials;
  private readonly ground: Drawn[] = [];
  private readonly people: Drawn[] = [];
  private readonly turning: Object3D[] = [];
  /** Obstacles, and the plates of landmarks. */
  readonly obstacles: Drawn;
  readonly plates: { mark: Landmark; object: Drawn }[] = [];
  /** Links of the robot, in the order of the page's data. */
  readonly links: Drawn[] = [];
  private readonly from = new Vector3();
  private readonly turned = new Quaternion();

  constructor(private readonly ride: Surroundings) {
    const { scene } = ride;
    this.materials = new Materials(scene.surfaces);
    const { floor, zones, solids, people } = this.materials;
    const sky = this.add(new SphereGeometry(1, 32, 16), this.materials.sky, -10);
    sky.name = "sky";
    this.ground.push(this.add(outside(ride), floor, -3), this.add(floors(ride), floor, -2), this.add(areas(ride), zones, 1));
    this.obstacles = this.add(obstacles(ride), solids, 0);
    for (const person of scene.people) this.figure(person.parts, person.number);
    for (const mark of scene.landmarks) this.plate(mark);
    for (const link of ride.links) {
      const body = new Triangles();
      body.mesh(link);
      this.links.push(this.add(body.geometry(), people, 0));
    }
  }

  /** Moves everything to a time of a track; `eye` is the camera's position in three's axes. */
  show(track: Track, t: number, eye: Vector3): void {
    this.showPeople(this.ride.scene.people.map((person) => whereIs(person, t)));
    this.face(eye);
    this.links.forEach((object, k) => {
      track.link(k, t, this.from, this.turned);
      object.position.copy(positionToThree(this.from));
      object.quaternion.copy(bodyToThree(this.turned));
    });
  }

  /** Moves people to their positions and yaws; who is nowhere is hidden, and more people than the scene has are added. */
  showPeople(places: readonly (Vector | null)[]): void {
    const known = this.ride.scene.people;
    while (this.people.length < places.length) {
      const like = known[this.people.length % Math.max(known.length, 1)];
      this.figure(like?.parts ?? VISITOR, like?.number ?? 0);
    }
    this.people.forEach((object, i) => {
      const place = places[i] ?? null;
      object.visible = place !== null;
      if (place === null) return;
      object.position.set(place[0], 0, -place[1]);
      object.rotation.y = place[2];
    });
  }

  /** Turns plates without a front to the camera's position in three's axes; hides the ground from a camera on it. */
  face(eye: Vector3): void {
    for (const object of this.turning) {
      object.rotation.y = Math.atan2(eye.x - object.position.x, eye.z - object.position.z);
    }
    for (const object of this.ground) object.visible = eye.y > ON_FLOOR;
  }

  private figure(parts: readonly Part[], number: number): void {
    const body = new Triangles();
    for (const part of parts) body.part(part, number);
    this.people.push(this.add(body.geometry(), this.materials.people, 0));
  }

  private add(geometry: BufferGeometry, material: ShaderMaterial, order: number): Drawn {
    const object = new Drawn(geometry, material);
    object.frustumCulled = false;
    object.renderOrder = order;
    this.root.add(object);
    return object;
  }

  private plate(mark: Landmark): void {
    const picture = new CanvasTexture(plateOf(mark));
    picture.colorSpace = NoColorSpace;
    picture.minFilter = LinearMipmapLinearFilter;
    picture.magFilter = LinearFilter;
    picture.anisotropy = 8;
    const object = this.add(new PlaneGeometry(mark.width, mark.height), this.materials.plate(picture, mark.number), 0);
    object.position.set(mark.x, mark.z, -mark.y);
    this.plates.push({ mark, object });
    if (mark.facing === null) this.turning.push(object);
    else object.rotation.y = mark.facing + Math.PI / 2;
  }
}

function outside({ scene }: Surroundings): BufferGeometry {
  const far: readonly Point[] = [[-BEYOND, -BEYOND], [BEYOND, -BEYOND], [BEYOND, BEYOND], [-BEYOND, BEYOND]];
  const [x, y] = scene.floor[0]?.[0]?.[0] ?? [0, 0];
  const made = new Triangles();
  const look: Look = { contrast: scene.surfaces.contrast.floor, grid: 0, skirting: false };
  made.level([far.map(([dx, dy]): Point => [x + dx, y + dy])], 0, true, scene.surfaces.outside, look, 0);
  return made.geometry();
}

function floorLook({ scene }: Surroundings): Look {
  return { contrast: scene.surfaces.contrast.floor, grid: scene.surfaces.grid.floor, skirting: false };
}

function floors(ride: Surroundings): BufferGeometry {
  const made = new Triangles();
  for (const rings of ride.scene.floor) made.level(rings, 0, true, ride.scene.surfaces.floor, floorLook(ride), 0);
  return made.geometry();
}

function areas(ride: Surroundings): BufferGeometry {
  const made = new Triangles();
  for (const zone of ride.scene.zones) {
    for (const rings of zone.polygons) made.level(rings, 0, true, zone.colour, floorLook(ride), 0);
  }
  return made.geometry();
}

/** Prisms, cells and tilted solids as one geometry. */
function obstacles(ride: Surroundings): BufferGeometry {
  const made = new Triangles();
  const { contrast, grid } = ride.scene.surfaces;
  for (const prism of ride.scene.prisms) {
    if (prism.solid === undefined) upright(made, prism, { contrast: contrast.wall, grid: grid.wall, skirting: false });
  }
  if (ride.scene.cells !== null) {
    for (const ring of boxes(ride.scene.cells)) {
      const cells = { ...ride.scene.cells, rings: [ring], is_wall: true };
      upright(made, cells, { contrast: contrast.wall, grid: grid.wall, skirting: false });
    }
  }
  for (const solid of ride.solids) made.mesh(solid);
  return made.geometry();
}

function upright(made: Triangles, prism: Pick<Prism, "rings" | "z" | "colour" | "is_wall" | "number">, look: Look): void {
  const { rings, colour, number } = prism;
  const [low, high] = prism.z;
  // The ground hides what is under it, but keeps no depth of its own: of what goes on below it nothing is drawn.
  const foot = high > 0 ? Math.max(low, 0) : low;
  made.walls(rings, foot, high, colour, { ...look, skirting: prism.is_wall && low <= 0 }, number);
  made.level(rings, high, true, colour, { ...look, grid: 0 }, number);
  if (low > 0) made.level(rings, low, false, colour, { ...look, grid: 0 }, number);
}

/** Corners of boxes of cells, m, counter-clockwise. */
function boxes(cells: Cells): Point[][] {
  const [x, y, yaw] = cells.origin;
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const placed = (column: number, row: number): Point => {
    const [u, v] = [column * cells.resolution, row * cells.resolution];
    return [x + c * u - s * v, y + s * u + c * v];
  };
  return cells.boxes.map(([x0, y0, x1, y1]) => [placed(x0, y0), placed(x1, y0), placed(x1, y1), placed(x0, y1)]);
}
