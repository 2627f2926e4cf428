// The view from the robot: the ride's scene at the robot's live pose, the ways on its floor, and what lies under a pointer.
import { Euler, type Object3D, Plane, Quaternion, Raycaster, Vector2, Vector3 } from "three";
import { Looking } from "../ride/looking";
import type { Landmark, Point, Vector } from "../ride/model";
import { Stage } from "../ride/stage";
import type { Drawn } from "./colours";
import { Floor } from "./floor";
import type { LiveScene } from "./messages";

/** m: farthest place of the floor that may be chosen. */
const FAR = 60;
/** Moves of a pointer, pixels, up to which it clicks and does not drag; ms in which a second click is none. */
const STILL = 6;
const TWICE = 350;
const UP = new Vector3(0, 0, 1);
/** Pictures over which the pace is measured; s a picture above which fewer pixels are drawn, and below which more are. */
const MEASURED = 10;
const SLOW = 1 / 40;
const FAST = 1 / 55;
const COARSEST = 0.4;
/** Measurements in a row that must be fast at first; twice as many after each loss, so that the picture seldom changes. */
const PATIENCE = 6;
const TURN = 0.15;

/** What the viewer points at: a place of the floor, a landmark, or something in the way. */
export type Pointed = { readonly floor: Point } | { readonly landmark: Landmark } | { readonly blocked: Point | null };

export class View {
  readonly stage: Stage;
  readonly looking: Looking;
  readonly floor = new Floor();
  private readonly ray = new Raycaster();
  private readonly ground = new Plane(new Vector3(0, 1, 0), 0);
  private readonly eye = new Vector3();
  private readonly turned = new Quaternion();
  private readonly euler = new Euler();
  /** Where the mouse is, and whether it has moved since the last picture. */
  private pointer: PointerEvent | null = null;
  private pointedAnew = false;
  private pictures = 0;
  private seconds = 0;
  private fast = 0;
  private patience = PATIENCE;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly scene: LiveScene,
    private readonly chosen: (pointed: Pointed) => void,
  ) {
    this.stage = new Stage(canvas, scene, scene.video !== "");
    this.stage.scene.add(this.floor.root);
    this.looking = new Looking(this.stage.head, canvas, () => { this.stage.stale = true; });
    if (scene.video !== "") this.stage.scenery.root.visible = !(this.looking.fixed = true);
    this.listen();
  }

  /** Moves the camera to the robot's pose, and the people to theirs. */
  place([x, y, yaw]: Vector, people: readonly Vector[]): void {
    const { camera } = this.scene;
    this.eye.set(x + camera.x * Math.cos(yaw), y + camera.x * Math.sin(yaw), camera.z);
    this.stage.stand(this.eye, this.turned.setFromAxisAngle(UP, yaw));
    this.stage.scenery.showPeople(people);
    this.stage.scenery.face(this.stage.rig.position);
  }

  /** Draws, if there is anything new, `seconds` after the last time; with fewer pixels if that takes too long. */
  draw(seconds: number): void {
    const { stage } = this;
    [this.pictures, this.seconds] = stage.stale ? [this.pictures + 1, this.seconds + seconds] : [0, 0];
    if (this.pictures === MEASURED) {
      this.adapt(this.seconds / MEASURED);
      [this.pictures, this.seconds] = [0, 0];
    }
    stage.draw(seconds);
  }

  /** Draws fewer pixels where a picture takes long, and more again once pictures are fast for a while. */
  private adapt(seconds: number): void {
    const most = Math.min(window.devicePixelRatio, 2);
    const before = Math.min(most, this.stage.sharpness);
    let sharpness = before;
    this.fast = seconds < FAST ? this.fast + 1 : 0;
    if (seconds > SLOW) {
      sharpness = Math.max(0.7 * before, COARSEST);
      this.patience *= 2;
    } else if (this.fast > this.patience) {
      sharpness = Math.min(before / 0.7, most);
      this.fast = 0;
    }
    if (sharpness === before) return;
    this.stage.sharpness = sharpness;
    this.stage.resize();
  }

  showWays(ways: readonly Drawn[], goals: readonly Point[]): void {
    this.floor.showWays(ways);
    this.floor.showGoals(goals);
    this.stage.stale = true;
  }

  /** Directions of the viewer's head from the robot's ahead, rad: left and up positive. */
  get head(): [number, number] {
    this.euler.setFromQuaternion(this.stage.head.quaternion, "YXZ");
    return [this.euler.y, this.euler.x];
  }

  /** Turns the head by keys: W, A, S, D. */
  turn(left: number, up: number): void {
    this.looking.turn(left * TURN, up * TURN);
  }

  /** Chooses what lies in the middle of the view, for keys and headsets. */
  chooseMiddle(): void {
    this.ray.setFromCamera(new Vector2(0, 0), this.stage.head);
    this.chosen(this.pointed());
  }

  /** Chooses what a headset's controller points at. */
  chooseAlong(controller: Object3D): void {
    this.aimAlong(controller);
    this.chosen(this.pointed());
  }

  /** Shows on the floor where the mouse points, or the middle of the view, or a headset's controller; once a picture. */
  aim(middle: boolean, controller: Object3D | null): void {
    if (!this.pointedAnew && !middle && controller === null) return;
    this.pointedAnew = false;
    if (controller !== null) this.aimAlong(controller);
    else if (this.pointer !== null) this.aimAt(this.pointer);
    else if (middle) this.ray.setFromCamera(new Vector2(0, 0), this.stage.head);
    this.hover(controller !== null || this.pointer !== null || middle ? this.pointed() : null);
  }

  private listen(): void {
    const { canvas } = this;
    let from: [number, number] | null = null;
    let last = -TWICE;
    canvas.addEventListener("pointerdown", (event) => {
      from = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
    });
    canvas.addEventListener("pointerup", (event) => {
      if (from === null || Math.hypot(event.clientX - from[0], event.clientY - from[1]) > STILL) return;
      if (event.timeStamp - last < TWICE) return;
      last = event.timeStamp;
      this.aimAt(event);
      this.chosen(this.pointed());
    });
    canvas.addEventListener("pointermove", (event) => {
      this.pointer = event.pointerType === "mouse" && event.buttons === 0 ? event : null;
      this.pointedAnew = true;
    });
    canvas.addEventListener("pointerleave", () => {
      this.pointer = null;
      this.pointedAnew = true;
    });
  }

  private aimAt(event: PointerEvent): void {
    const box = this.canvas.getBoundingClientRect();
    const [u, v] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    this.ray.setFromCamera(new Vector2(2 * u - 1, 1 - 2 * v), this.stage.head);
  }

  /** A controller points along its -z. */
  private aimAlong(controller: Object3D): void {
    this.ray.set(controller.getWorldPosition(new Vector3()), controller.getWorldDirection(new Vector3()).negate());
  }

  private hover(pointed: Pointed | null): void {
    if (pointed !== null && "floor" in pointed) this.floor.point(pointed.floor, true);
    else if (pointed !== null && "blocked" in pointed) this.floor.point(pointed.blocked, false);
    else this.floor.point(null, true);
    this.canvas.style.cursor = pointed !== null && "landmark" in pointed ? "pointer" : "";
    this.stage.stale = true;
  }

  /** What the ray meets first: obstacles hide what is behind them. */
  private pointed(): Pointed {
    const { scenery, scene } = this.stage;
    scene.updateMatrixWorld();
    const plates = scenery.plates.map(({ object }) => object);
    const hit = this.ray.intersectObjects(scenery.root.visible ? [scenery.obstacles, ...plates] : plates, false)[0];
    const place = this.ray.ray.intersectPlane(this.ground, new Vector3());
    const away = place === null ? Infinity : place.distanceTo(this.ray.ray.origin);
    if (hit !== undefined && hit.distance < away) {
      const plate = scenery.plates.find(({ object }) => object === hit.object);
      return plate === undefined ? { blocked: [hit.point.x, -hit.point.z] } : { landmark: plate.mark };
    }
    return place === null || away > FAR ? { blocked: null } : { floor: [place.x, -place.z] };
  }
}
