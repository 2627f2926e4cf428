// A text in front of the viewer's head, on a screen as in a headset: an announcement, or a question.
import { type Camera, CanvasTexture, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";

const AWAY = 1.2;
const ABOVE = 0.26;
const SIZE = [0.6, 0.12] as const;
const PIXELS = [1024, 204] as const;

export class Sign {
  private readonly picture = document.createElement("canvas");
  private readonly plane: Mesh<PlaneGeometry, MeshBasicMaterial>;

  constructor(head: Camera, private readonly changed: () => void) {
    [this.picture.width, this.picture.height] = PIXELS;
    const map = new CanvasTexture(this.picture);
    this.plane = new Mesh(new PlaneGeometry(...SIZE), new MeshBasicMaterial({ map, depthTest: false, transparent: true }));
    this.plane.position.set(0, ABOVE, -AWAY);
    this.plane.renderOrder = 120;
    this.plane.visible = false;
    head.add(this.plane);
  }

  /** Shows a text; "" hides the sign. */
  show(text: string): void {
    this.plane.visible = text !== "";
    this.changed();
    if (text === "") return;
    const pen = this.picture.getContext("2d")!;
    const [width, height] = PIXELS;
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = "rgba(16, 20, 24, 0.85)";
    pen.beginPath();
    pen.roundRect(4, 4, width - 8, height - 8, 40);
    pen.fill();
    pen.fillStyle = "#fff";
    let size = 96;
    do pen.font = `600 ${size -= 8}px system-ui, sans-serif`;
    while (size > 40 && pen.measureText(text).width > width - 60);
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(text, width / 2, height / 2, width - 60);
    this.plane.material.map!.needsUpdate = true;
  }
}
