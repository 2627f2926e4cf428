// Buttons in a headset: they are below the view, and are pressed by looking at them for a while, or by a controller.
import { type Camera, CanvasTexture, Group, Mesh, MeshBasicMaterial, PlaneGeometry, Raycaster, RingGeometry, Vector3 } from "three";

/** s of looking at a button that press it. */
const DWELL = 1.2;
const AWAY = 1.4;
const BELOW = 0.75;
const WIDTH = 0.34;
const HEIGHT = 0.16;

export interface Button {
  readonly label: () => string;
  readonly press: () => void;
}

interface Hung {
  readonly button: Button;
  readonly plane: Mesh<PlaneGeometry, MeshBasicMaterial>;
  readonly picture: HTMLCanvasElement;
  shown: string;
}

export class GazeButtons {
  readonly root = new Group();
  private readonly hung: Hung[];
  private readonly ring: Mesh<RingGeometry, MeshBasicMaterial>;
  private readonly ray = new Raycaster();
  private readonly from = new Vector3();
  private readonly along = new Vector3();
  private watched: Hung | null = null;
  private seconds = 0;

  constructor(buttons: readonly Button[]) {
    this.hung = buttons.map((button, i) => {
      const picture = document.createElement("canvas");
      picture.width = 256;
      picture.height = 120;
      const material = new MeshBasicMaterial({ map: new CanvasTexture(picture), depthTest: false, transparent: true });
      const plane = new Mesh(new PlaneGeometry(WIDTH, HEIGHT), material);
      plane.position.set((i - (buttons.length - 1) / 2) * 1.15 * WIDTH, -BELOW, -AWAY);
      plane.lookAt(0, 0, 0);
      plane.renderOrder = 110;
      this.root.add(plane);
      return { button, plane, picture, shown: "" };
    });
    this.ring = new Mesh(
      new RingGeometry(0.012, 0.02, 24),
      new MeshBasicMaterial({ color: 0xffffff, depthTest: false, transparent: true }),
    );
    this.ring.renderOrder = 111;
    this.root.add(this.ring);
    this.root.visible = false;
  }

  /** Follows the direction of the head for some seconds; presses a button that was looked at long enough. */
  look(head: Camera, seconds: number): void {
    for (const hung of this.hung) this.write(hung);
    head.getWorldPosition(this.from);
    head.getWorldDirection(this.along);
    this.ray.set(this.from, this.along);
    const met = this.ray.intersectObjects(this.hung.map((hung) => hung.plane))[0];
    const at = this.hung.find((hung) => hung.plane === met?.object) ?? null;
    if (at !== this.watched) {
      this.watched = at;
      this.seconds = 0;
    }
    this.ring.visible = at !== null;
    if (at === null || met === undefined) return;
    this.ring.position.copy(this.root.worldToLocal(met.point.clone()));
    this.ring.quaternion.copy(at.plane.quaternion);
    this.seconds += seconds;
    this.ring.scale.setScalar(Math.max(0.3, 2 - (2 * this.seconds) / DWELL));
    if (this.seconds >= DWELL) this.press();
  }

  /** Presses the button that is looked at; returns whether there is one. */
  press(): boolean {
    const at = this.watched;
    this.seconds = -DWELL; // to press it again one looks longer
    at?.button.press();
    return at !== null;
  }

  private write(hung: Hung): void {
    const label = hung.button.label();
    if (label === hung.shown) return;
    hung.shown = label;
    const pen = hung.picture.getContext("2d")!;
    pen.clearRect(0, 0, 256, 120);
    pen.fillStyle = "rgba(16, 20, 24, 0.85)";
    pen.beginPath();
    pen.roundRect(4, 4, 248, 112, 24);
    pen.fill();
    pen.fillStyle = "#fff";
    pen.font = "600 44px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(label, 128, 60, 236);
    hung.plane.material.map!.needsUpdate = true;
  }
}
