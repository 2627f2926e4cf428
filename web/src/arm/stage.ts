// The arm among the obstacles, seen from a camera that goes round it, or through the arm's own camera.
import {
  type BufferAttribute,
  AxesHelper,
  Box3,
  BufferGeometry,
  EdgesGeometry,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh as Drawn,
  MeshBasicMaterial,
  PerspectiveCamera,
  Raycaster,
  Scene,
  SphereGeometry,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Colour, Mesh, Point } from "../ride/model";
import { type Look, Triangles } from "../ride/shapes";
import { Materials } from "../ride/surfaces";
import type { Flat } from "./gjk";
import type { Arm, Body } from "./model";
import type { Posture, Verdict } from "./posture";

const RED: Colour = [222, 52, 46];
/** Faces that meet at more than this angle, degrees, have an edge between them. */
const CREASE = 12;
/** Bodies longer than this, m, such as walls without an upper end, do not decide where the ground is drawn. */
const ENDLESS = 10;
const GROUND = 60;
/** Angle of view, rad, of a camera that sees all round, where a picture must end. */
const WIDE = 1.2;
/** Length of the drawn cone of the arm's camera, m. */
const CONE = 0.12;
const MARK = 0.012;
/** Directions of a first view: angles round the vertical axis, rad, the preferred first, and the height of the eye. */
const AROUND = [0.7, -0.7, 1.2, -1.2, 0.2, -0.2, 2, -2, 2.7, -2.7] as const;
const HEIGHT = 0.45;

interface Piece {
  readonly mesh: Drawn;
  readonly hidden: LineSegments;
  readonly paint: Float32Array;
}

/** The matrix of three for a pose in the world, for objects whose corners are in the axes of three. */
function matrixOf(p: Flat): Matrix4 {
  const row = (r: number, sign: number): [number, number, number, number] => [
    sign * p[4 * r]!, sign * p[4 * r + 2]!, -sign * p[4 * r + 1]!, sign * p[4 * r + 3]!,
  ];
  return new Matrix4().set(...row(0, 1), ...row(2, 1), ...row(1, -1), 0, 0, 0, 1);
}

export class Stage {
  readonly eye = new PerspectiveCamera(45, 1, 0.01, 500);
  /** Whether the view is that of the arm's camera. */
  through = false;
  stale = true;
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly hand = new PerspectiveCamera(45, 1, 0.01, 500);
  private readonly orbit: OrbitControls;
  private readonly materials: Materials;
  private readonly pieces: Piece[];
  private readonly cone: LineSegments;
  private readonly axes = new AxesHelper(0.1);
  private readonly middle = new Vector3();
  private size = 1;

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly arm: Arm,
    private readonly posture: Posture,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.materials = new Materials(arm.surfaces);
    const sky = new Drawn(new SphereGeometry(1, 32, 16), this.materials.sky);
    sky.frustumCulled = false;
    sky.renderOrder = -10;
    this.scene.add(sky);
    this.pieces = arm.shapes.map((shape) => this.piece(shape));
    this.cone = new LineSegments(this.coneLines(), new LineBasicMaterial({ color: 0xf2c14e }));
    for (const object of [this.cone, this.axes]) object.matrixAutoUpdate = false;
    this.scene.add(this.cone, this.axes, this.targets());
    this.place();
    this.scene.add(this.ground());
    this.orbit = new OrbitControls(this.eye, canvas);
    this.orbit.zoomToCursor = true;
    this.orbit.addEventListener("change", () => { this.stale = true; });
    this.reset();
  }

  /** Looks at the whole arm from where the obstacles hide it least. */
  reset(): void {
    const whole = new Box3();
    this.arm.bodies.forEach((body) => { if (body.link) whole.union(this.boxOf(body)); });
    whole.getCenter(this.middle);
    this.size = 1.25 * Math.max(whole.getSize(new Vector3()).length() / 2, 0.1);
    const away = (2.6 * this.size) / Math.min(this.eye.aspect, 1);
    const eyes = AROUND.map((angle) => new Vector3(Math.cos(angle), HEIGHT, Math.sin(angle)).normalize().multiplyScalar(away).add(this.middle));
    const hidden = eyes.map((eye) => this.hiddenFrom(eye));
    this.orbit.target.copy(this.middle);
    this.eye.position.copy(eyes[hidden.indexOf(Math.min(...hidden))]!);
    this.orbit.update();
    this.stale = true;
  }

  /** Number of bodies of the arm whose centres an obstacle hides from an eye. */
  private hiddenFrom(eye: Vector3): number {
    const obstacles = this.pieces.flatMap(({ mesh }, i) => (this.arm.bodies[i]!.link ? [] : [mesh]));
    const links = this.arm.bodies.filter(({ link }) => link);
    return links.filter(({ centre: [x, y, z], frame }) => {
      const along = new Vector3(x, z, -y).applyMatrix4(matrixOf(this.posture.frames[frame]!)).sub(eye);
      const far = along.length();
      return new Raycaster(eye, along.normalize(), 0, far).intersectObjects(obstacles, false).length > 0;
    }).length;
  }

  /** Turns the view, rad, or comes nearer by a factor. */
  turn(left: number, up: number, nearer = 1): void {
    const from = this.eye.position.clone().sub(this.orbit.target);
    const polar = Math.min(Math.max(Math.acos(from.y / from.length()) - up, 0.05), Math.PI - 0.05);
    const around = Math.atan2(from.x, from.z) + left;
    from.setFromSphericalCoords(from.length() / nearer, polar, around);
    this.eye.position.copy(this.orbit.target).add(from);
    this.orbit.update();
    this.stale = true;
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.eye.aspect = this.hand.aspect = width / height;
    this.eye.updateProjectionMatrix();
    const [h, v] = this.fieldOfView();
    const tall = Math.max(Math.tan(v / 2), Math.tan(h / 2) / this.hand.aspect);
    this.hand.fov = (360 / Math.PI) * Math.atan(tall);
    this.hand.updateProjectionMatrix();
    this.stale = true;
  }

  /** Moves everything to the posture. */
  place(): void {
    for (const body of this.arm.bodies) {
      const { mesh, hidden } = this.pieces[body.shown]!;
      mesh.matrix = hidden.matrix = matrixOf(this.posture.frames[body.frame]!);
    }
    const camera = matrixOf(this.posture.pose(this.arm.camera));
    this.cone.matrix = camera;
    this.axes.matrix = matrixOf(this.posture.pose(this.arm.tool)).multiply(new Matrix4().makeRotationX(-Math.PI / 2));
    // A camera of three looks along its -z, with y up; here x is ahead and, in the axes of three, y up.
    this.hand.matrixAutoUpdate = false;
    this.hand.matrix = camera.clone().multiply(new Matrix4().makeRotationY(-Math.PI / 2));
    this.hand.matrixWorldNeedsUpdate = true;
    this.stale = true;
  }

  /** Makes obstacles glass, or solid again. */
  set glass(on: boolean) {
    this.pieces.forEach(({ mesh }, i) => {
      if (!this.arm.bodies[i]!.link) mesh.material = on ? this.materials.glass : this.materials.people;
    });
    this.stale = true;
  }

  /** Colours the bodies that collide; the edges of these shine through what hides them. */
  colour({ collisions }: Verdict): void {
    const hit = new Set(collisions.flatMap(({ one, other }) => [one.name, other.name]));
    const red = new Set(this.arm.bodies.filter(({ name }) => hit.has(name)).map(({ shown }) => shown));
    this.pieces.forEach(({ mesh, hidden, paint }, i) => {
      const attribute = mesh.geometry.getAttribute("paint") as BufferAttribute;
      if (red.has(i)) for (let k = 0; k < paint.length; k++) attribute.array[k] = RED[(k % 3) as 0 | 1 | 2] / 255;
      else attribute.array.set(paint);
      attribute.needsUpdate = true;
      hidden.visible = red.has(i);
    });
    this.stale = true;
  }

  /** Name of what is at a point of the canvas, CSS pixels; null for nothing. */
  named([x, y]: Point): string | null {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2((2 * x) / width - 1, 1 - (2 * y) / height), this.through ? this.hand : this.eye);
    const first = ray.intersectObjects(this.pieces.map(({ mesh }) => mesh), false)[0];
    const at = this.pieces.findIndex(({ mesh }) => mesh === first?.object);
    return this.arm.bodies[at]?.name ?? null;
  }

  /** For tests: bounds of each drawn shape in the world, and whether it is red. */
  drawn(): { low: number[]; high: number[]; red: boolean }[] {
    this.scene.updateMatrixWorld();
    return this.pieces.map(({ mesh, hidden }) => {
      const { min, max } = new Box3().setFromObject(mesh, true);
      const paint = mesh.geometry.getAttribute("paint") as BufferAttribute;
      const red = hidden.visible && Math.abs(paint.getX(0) - RED[0] / 255) < 1e-6;
      return { low: [min.x, -max.z, min.y], high: [max.x, -min.z, max.y], red };
    });
  }

  draw(): void {
    if (!this.stale) return;
    this.cone.visible = this.axes.visible = !this.through;
    this.orbit.enabled = !this.through;
    this.renderer.render(this.scene, this.through ? this.hand : this.eye);
    this.stale = false;
  }

  private fieldOfView(): Point {
    const [h, v] = this.arm.field_of_view ?? [WIDE, WIDE];
    return [Math.min(h, 2.6), Math.min(v, 2.6)];
  }

  private piece(shape: Mesh): Piece {
    const body = new Triangles();
    body.mesh(shape);
    const mesh = new Drawn(body.geometry(), this.materials.people);
    const edges = new EdgesGeometry(mesh.geometry, CREASE);
    mesh.add(new LineSegments(edges, new LineBasicMaterial({ color: 0x20262c, transparent: true, opacity: 0.45 })));
    const hidden = new LineSegments(edges, new LineBasicMaterial({ color: 0xff3b30, depthTest: false, transparent: true }));
    hidden.renderOrder = 5;
    hidden.visible = false;
    for (const object of [mesh, hidden]) object.matrixAutoUpdate = false;
    this.scene.add(mesh, hidden);
    return { mesh, hidden, paint: Float32Array.from((mesh.geometry.getAttribute("paint") as BufferAttribute).array) };
  }

  /** Edges of the pyramid that the arm's camera sees, in its own axes, as x, z, -y. */
  private coneLines(): BufferGeometry {
    const [h, v] = this.fieldOfView().map((angle) => CONE * Math.tan(Math.min(angle, 1.6) / 2)) as [number, number];
    const rim = ([[1, 1], [-1, 1], [-1, -1], [1, -1]] as const).map(([y, z]) => [CONE, z * v, -y * h]);
    const lines = rim.flatMap((corner, i) => [0, 0, 0, ...corner, ...corner, ...rim[(i + 1) % 4]!]);
    return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(lines, 3));
  }

  private targets(): Group {
    const group = new Group();
    for (const { place: [x, y, z] } of this.arm.targets) {
      const mark = new Drawn(new SphereGeometry(MARK), new MeshBasicMaterial({ color: 0xf2c14e, depthTest: false, transparent: true }));
      mark.position.set(x, z, -y);
      mark.renderOrder = 6;
      group.add(mark);
    }
    return group;
  }

  private boxOf({ shown, frame }: Body): Box3 {
    const { geometry } = this.pieces[shown]!.mesh;
    if (geometry.boundingBox === null) geometry.computeBoundingBox();
    return geometry.boundingBox!.clone().applyMatrix4(matrixOf(this.posture.frames[frame]!));
  }

  /** A floor below all, on which nothing collides. */
  private ground(): Group {
    const boxes = this.arm.bodies.map((body) => this.boxOf(body)).filter(({ min, max }) => max.y - min.y < ENDLESS);
    const bottom = Math.min(...boxes.map(({ min }) => min.y));
    const made = new Triangles();
    const { floor, outside, grid } = this.arm.surfaces;
    const look: Look = { contrast: 0, grid: grid.floor, skirting: false };
    const square = (side: number): Point[] => [[-side, -side], [side, -side], [side, side], [-side, side]];
    made.level([square(8 * GROUND)], 0, true, outside, { ...look, grid: 0 }, 0);
    made.level([square(3)], 0, true, floor, look, 0);
    const plane = new Drawn(made.geometry(), this.materials.floor);
    plane.renderOrder = -2;
    const group = new Group();
    group.position.y = Number.isFinite(bottom) ? bottom : 0;
    group.add(plane);
    return group;
  }
}
