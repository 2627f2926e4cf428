// A headset: the rig goes on carrying the camera's pose, the headset turns and moves the head within it.
import type { GazeButtons } from "./gaze";
import type { Stage } from "./stage";

export class Headset {
  private session: XRSession | null = null;

  constructor(
    private readonly stage: Stage,
    private readonly buttons: GazeButtons,
    private readonly changed: (on: boolean) => void,
    private readonly pressed: () => void,
  ) {
    stage.rig.add(buttons.root);
  }

  get isOn(): boolean {
    return this.session !== null;
  }

  /** Whether this browser says that it shows pages in a headset. */
  async isThere(): Promise<boolean> {
    try {
      return (await navigator.xr?.isSessionSupported("immersive-vr")) === true;
    } catch {
      return false;
    }
  }

  async enter(): Promise<void> {
    if (this.session !== null || navigator.xr === undefined) return;
    const session = await navigator.xr.requestSession("immersive-vr");
    this.session = session;
    session.addEventListener("end", () => {
      this.session = null;
      this.buttons.root.visible = false;
      this.changed(false);
    });
    session.addEventListener("select", () => {
      if (!this.buttons.press()) this.pressed();
    });
    session.addEventListener("squeeze", () => {
      this.leave();
    });
    await this.stage.renderer.xr.setSession(session);
    this.buttons.root.visible = true;
    this.changed(true);
  }

  /** Leaves at once. */
  leave(): void {
    this.stage.light();
    void this.session?.end();
  }
}
