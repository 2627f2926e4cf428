// A 360 degree video on a sphere round the viewer, and which part of it was played.
import { Mesh, MeshBasicMaterial, SphereGeometry, SRGBColorSpace, VideoTexture } from "three";

/** m, radius of the sphere */
const RADIUS = 50;

export interface WatchedValue {
  readonly [name: string]: number | [number, number][];
  /** Share of the video's seconds that were played, each counted once. */
  readonly share: number;
  readonly seconds: number;
  readonly pauses: number;
  readonly skips: number;
  /** Played parts, s. */
  readonly samples: [number, number][];
}

export class Film {
  readonly player = document.createElement("video");
  readonly sphere: Mesh;
  private pauses = 0;
  private skips = 0;
  private last = 0;

  constructor(address: string, private readonly seconds: number, private readonly tell: (what: "paused" | "continued" | "skipped") => void) {
    const { player } = this;
    player.muted = true;
    player.playsInline = true;
    player.preload = "auto";
    player.disablePictureInPicture = true;
    player.src = address;
    const shape = new SphereGeometry(RADIUS, 96, 48);
    shape.scale(-1, 1, 1); // seen from inside, not mirrored
    shape.rotateY(-Math.PI / 2); // the middle of the picture is ahead
    const texture = new VideoTexture(player);
    texture.colorSpace = SRGBColorSpace;
    this.sphere = new Mesh(shape, new MeshBasicMaterial({ map: texture, toneMapped: false }));
    player.addEventListener("ratechange", () => { if (player.playbackRate !== 1) player.playbackRate = 1; });
    player.addEventListener("timeupdate", () => { if (!player.seeking) this.last = player.currentTime; });
    player.addEventListener("seeking", () => {
      if (Math.abs(player.currentTime - this.last) < 0.3) return;
      this.skips += 1;
      this.tell("skipped");
    });
    player.addEventListener("pause", () => {
      if (player.ended) return;
      this.pauses += 1;
      this.tell("paused");
    });
    player.addEventListener("play", () => { if (this.pauses > 0) this.tell("continued"); });
  }

  /** Share of the video that was played; its length is that of the file, or of the design if this is longer. */
  get watched(): WatchedValue {
    const { played, duration } = this.player;
    const samples = Array.from({ length: played.length }, (_, i): [number, number] => [rounded(played.start(i)), rounded(played.end(i))]);
    const seconds = samples.reduce((sum, [from, to]) => sum + to - from, 0);
    const share = Math.min(seconds / Math.max(duration || 0, this.seconds), 1);
    return { share: rounded(share), seconds: rounded(seconds), pauses: this.pauses, skips: this.skips, samples: samples.slice(0, 100) };
  }
}

function rounded(value: number): number {
  return Math.round(1000 * value) / 1000;
}
