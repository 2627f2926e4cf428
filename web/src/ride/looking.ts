// How the viewer's head turns within the rig: by dragging, by keys, or with the phone. The rig carries the camera's pose.
import { Euler, MathUtils, type PerspectiveCamera, Quaternion, Vector3 } from "three";

/** rad a CSS pixel */
const DRAG = 0.004;
const STEEPEST = 1.45;
/** The screen of a phone held upright looks to the horizon, not to the ground. */
const UPRIGHT = new Quaternion(-Math.SQRT1_2, 0, 0, Math.SQRT1_2);

interface Asking {
  requestPermission?: () => Promise<"granted" | "denied">;
}

export class Looking {
  private yaw = 0;
  private pitch = 0;
  /** Heading of the phone that counts as ahead, once it is known. */
  private ahead: number | null = null;
  private followed = false;
  /** Whether the head stays as it is, as over a picture that does not turn with it. */
  fixed = false;
  private readonly orient = (event: DeviceOrientationEvent): void => {
    this.followPhone(event);
  };

  constructor(
    private readonly head: PerspectiveCamera,
    view: HTMLElement,
    private readonly changed: () => void,
  ) {
    let from: [number, number] | null = null;
    view.addEventListener("pointerdown", (event) => {
      from = [event.clientX, event.clientY];
      view.setPointerCapture(event.pointerId);
    });
    view.addEventListener("pointermove", (event) => {
      if (from === null) return;
      this.turn(DRAG * (event.clientX - from[0]), DRAG * (event.clientY - from[1]));
      from = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"] as const) view.addEventListener(end, () => (from = null));
    view.addEventListener("dblclick", () => {
      this.recentre();
    });
  }

  /** Whether the head follows the phone. */
  get isFollowing(): boolean {
    return this.followed;
  }

  turn(yaw: number, pitch: number): void {
    if (this.fixed) return;
    this.yaw += yaw;
    this.pitch = MathUtils.clamp(this.pitch + pitch, -STEEPEST, STEEPEST);
    if (!this.followed) this.apply();
  }

  /** Looks straight ahead again. */
  recentre(): void {
    this.yaw = this.pitch = 0;
    this.ahead = null;
    this.apply();
  }

  apply(): void {
    if (!this.followed) this.head.quaternion.setFromEuler(new Euler(this.pitch, this.yaw, 0, "YXZ"));
    this.head.position.set(0, 0, 0);
    this.changed();
  }

  /** Starts or stops following the phone; an iPhone asks its user first. Returns whether the head follows. */
  async togglePhone(): Promise<boolean> {
    if (this.followed) {
      window.removeEventListener("deviceorientation", this.orient);
      this.followed = false;
    } else {
      const asking = DeviceOrientationEvent as unknown as Asking;
      if (asking.requestPermission !== undefined && (await asking.requestPermission()) !== "granted") return false;
      this.ahead = null;
      this.followed = true;
      window.addEventListener("deviceorientation", this.orient);
    }
    this.apply();
    return this.followed;
  }

  private followPhone({ alpha, beta, gamma }: DeviceOrientationEvent): void {
    if (alpha === null || beta === null || gamma === null) return;
    const radians = MathUtils.degToRad;
    const q = new Quaternion().setFromEuler(new Euler(radians(beta), radians(alpha), -radians(gamma), "YXZ"));
    q.multiply(UPRIGHT);
    const screen = radians(window.screen.orientation.angle);
    q.multiply(new Quaternion().setFromAxisAngle(new Vector3(0, 0, 1), -screen));
    const d = new Vector3(0, 0, -1).applyQuaternion(q);
    const heading = Math.atan2(-d.x, -d.z);
    this.ahead ??= heading;
    this.head.quaternion.copy(q.premultiply(new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), -this.ahead)));
    this.changed();
  }
}
