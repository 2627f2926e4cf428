// What is drawn and from where: the scene, a rig that carries the camera's pose, and in it the viewer's head, which the
// viewer alone turns. Over the view lie a fade and, where it is asked for, a vignette.
import {
  Group,
  Mesh,
  PerspectiveCamera,
  PlaneGeometry,
  Quaternion,
  Scene,
  ShaderMaterial,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { cameraToThree, levelled, positionToThree } from "./axes";
import type { Point, Surroundings } from "./model";
import { Scenery } from "./scenery";
import type { Track } from "./track";

const NEAR = 0.02;
const FAR = 4000;
/** Vertical angle of view, rad, if the robot's camera sees all round; also the least horizontal angle. */
const TALL = 1.2;
const LEAST_WIDE = 1.15;
/** s from black to the full view, and back. */
export const FADE = 0.5;
const OVERLAY = 0.05;
/** Angle of view, rad, at which a restrictor begins to narrow it, and rad/s at which it is narrowest. */
const WIDE = (110 / 180) * Math.PI;
const FAST = 1;

const COVER_VERTEX = /* glsl */ `
varying vec2 vUv;
void main() {
  vUv = uv - 0.5;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}
`;
const COVER = /* glsl */ `
uniform float dark;
uniform float narrow;
uniform vec2 rim;
varying vec2 vUv;
void main() {
  float edge = narrow * smoothstep(rim.x, rim.y, length(vUv));
  gl_FragColor = vec4(0.0, 0.0, 0.0, max(dark, edge));
}
`;

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly scene = new Scene();
  readonly rig = new Group();
  readonly head = new PerspectiveCamera(60, 1, NEAR, FAR);
  readonly scenery: Scenery;
  /** Whether the view stays upright when the camera tilts; this changes what is seen. */
  level = false;
  /** 0 to 1: how far the margins of the view are darkened. */
  narrow = 0;
  /** Pixels drawn for each pixel of the screen, at most: less where the device is slow. */
  sharpness = 2;
  /** Whether anything has changed since the last picture. */
  stale = true;
  private readonly cover: ShaderMaterial;
  private readonly eye = new Vector3();
  private readonly turned = new Quaternion();
  private dark = 0;
  private darker = 0;

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly ride: Surroundings,
    alpha = false,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha });
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType("local");
    this.scenery = new Scenery(ride);
    this.cover = new ShaderMaterial({
      uniforms: { dark: { value: 0 }, narrow: { value: 0 }, rim: { value: new Vector2(0.06, 0.16) } },
      vertexShader: COVER_VERTEX,
      fragmentShader: COVER,
      transparent: true,
      depthTest: false,
      depthWrite: false,
    });
    const cover = new Mesh(new PlaneGeometry(1, 1), this.cover);
    cover.position.z = -OVERLAY;
    cover.frustumCulled = false;
    cover.renderOrder = 100;
    this.head.add(cover);
    this.rig.add(this.head);
    this.scene.add(this.scenery.root, this.rig);
  }

  /** Fits the picture to the canvas; returns the camera's field of view as shares of it, or null. */
  resize(): Point | null {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0 || this.renderer.xr.isPresenting) return null;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, this.sharpness));
    this.renderer.setSize(width, height, false);
    const aspect = width / height;
    const fov = this.ride.field_of_view;
    const half = (angle: number): number => Math.tan(Math.min(angle, 2.6) / 2);
    let tall = Math.max(half(TALL), half(LEAST_WIDE) / aspect);
    if (fov !== null && fov[0] < Math.PI) tall = 1.06 * Math.max(half(fov[1]), half(fov[0]) / aspect);
    this.head.aspect = aspect;
    this.head.fov = (360 / Math.PI) * Math.atan(tall);
    this.head.updateProjectionMatrix();
    this.stale = true;
    return fov !== null && fov[0] < Math.PI ? [half(fov[0]) / (tall * aspect), half(fov[1]) / tall] : null;
  }

  /** Moves the rig to the camera's pose at a time of a track, and everything else to its position then. */
  place(track: Track, t: number): void {
    track.pose(t, this.eye, this.turned);
    this.stand(this.eye, this.turned);
    this.scenery.show(track, t, this.rig.position);
  }

  /** Moves the rig to a pose of the camera in the world; both values are changed. */
  stand(eye: Vector3, turned: Quaternion): void {
    this.rig.position.copy(positionToThree(eye));
    this.rig.quaternion.copy(cameraToThree(turned));
    if (this.level) levelled(this.rig.quaternion);
    this.stale = true;
  }

  /** Narrows the view to an angle of `least` rad while it turns; the angle falls evenly up to a rate of 1 rad/s. */
  restrict(least: number, rate: number): void {
    const share = Math.min(rate / FAST, 1);
    const edge = OVERLAY * Math.tan((WIDE - share * (WIDE - Math.min(least, WIDE))) / 2);
    (this.cover.uniforms["rim"]!.value as Vector2).set(0.85 * edge, edge);
    this.narrow = share > 0.02 ? 1 : 0;
    this.stale = true;
  }

  /** Begins to fade, to black or from it. */
  fade(to: "black" | "view", from?: "black"): void {
    if (from === "black") this.dark = 1;
    this.darker = to === "black" ? 1 : 0;
  }

  /** Shows the view at once. */
  light(): void {
    this.dark = this.darker = 0;
    this.stale = true;
  }

  /** Whether the view is black, or about to be. */
  get isDark(): boolean {
    return this.darker === 1;
  }

  /** Draws, if there is anything new to draw. */
  draw(seconds: number): void {
    if (this.dark !== this.darker) {
      const step = seconds / FADE;
      this.dark = this.darker > this.dark ? Math.min(this.dark + step, 1) : Math.max(this.dark - step, 0);
      this.stale = true;
    }
    if (!this.stale && !this.renderer.xr.isPresenting) return;
    this.cover.uniforms["dark"]!.value = this.dark;
    this.cover.uniforms["narrow"]!.value = this.narrow;
    this.cover.visible = this.dark > 0 || this.narrow > 0;
    this.renderer.render(this.scene, this.head);
    this.stale = false;
  }
}
