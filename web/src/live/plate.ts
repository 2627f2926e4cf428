// A plate with words in a headset, above the buttons: what the page says elsewhere.
import { CanvasTexture, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";

export class Plate {
  readonly object: Mesh<PlaneGeometry, MeshBasicMaterial>;
  private readonly picture = document.createElement("canvas");
  private shown = "";

  constructor() {
    this.picture.width = 1024;
    this.picture.height = 160;
    const material = new MeshBasicMaterial({ map: new CanvasTexture(this.picture), depthTest: false, transparent: true });
    this.object = new Mesh(new PlaneGeometry(1.6, 0.25), material);
    this.object.position.set(0, -0.42, -1.5);
    this.object.lookAt(0, 0, 0);
    this.object.renderOrder = 110;
    this.object.visible = false;
  }

  write(words: string): void {
    if (words === this.shown) return;
    this.shown = words;
    const pen = this.picture.getContext("2d")!;
    pen.clearRect(0, 0, 1024, 160);
    if (words !== "") {
      pen.fillStyle = "rgba(16, 20, 24, 0.85)";
      pen.beginPath();
      pen.roundRect(4, 4, 1016, 152, 24);
      pen.fill();
      pen.fillStyle = "#fff";
      pen.font = "600 46px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      pen.fillText(words, 512, 80, 980);
    }
    this.object.material.map!.needsUpdate = true;
  }
}
