// Check mode of the page (`ride.html#check`): numbers about what is drawn and from where, for tests.
// Without this fragment in the address, none of it exists.
import {
  CubeCamera,
  Mesh,
  NearestFilter,
  OrthographicCamera,
  PlaneGeometry,
  Quaternion,
  Scene,
  ShaderMaterial,
  Vector3,
  WebGLCubeRenderTarget,
  WebGLRenderTarget,
} from "three";
import type { Clock } from "./clock";
import type { Stage } from "./stage";

// Cube maps that were rendered are sampled with directions as they are: nothing is mirrored.
const ALL_ROUND_VERTEX = /* glsl */ `
varying vec2 vUv;
void main() {
  vUv = uv;
  gl_Position = vec4(position.xy * 2.0, 0.0, 1.0);
}
`;
const ALL_ROUND = /* glsl */ `
uniform samplerCube cube;
uniform vec4 rig;
uniform vec2 rows;
varying vec2 vUv;
vec3 turned(vec3 d, vec4 q) {
  return d + 2.0 * cross(q.xyz, cross(q.xyz, d) + q.w * d);
}
void main() {
  float left = (0.5 - vUv.x) * 6.283185307179586;
  float up = mix(rows.x, rows.y, vUv.y);
  vec3 d = vec3(-sin(left) * cos(up), sin(up), -cos(left) * cos(up));
  gl_FragColor = textureCube(cube, turned(d, rig));
}
`;

export interface Checks {
  /** Pose of the rig in world axes: x, y, z in m, and the directions ahead, left and up. */
  pose(): { position: number[]; ahead: number[]; left: number[]; up: number[] };
  /** Rides to a time, s, of a track. */
  at(track: number, t: number): void;
  /** Numbers of the visible things all round, row by row from the top, the heading in the middle. `rows` 1: the horizon. */
  numbers(columns: number, rows: number, face: number): number[];
  /** Red, green and blue of each pixel of the same picture. */
  colours(columns: number, rows: number, face: number): number[];
  /** Where the robot's links are, in world axes: their origins, m, and the directions of their x and z. */
  links(): { position: number[]; ahead: number[]; up: number[] }[];
}

export function checks(clock: Clock, stage: Stage): Checks {
  const { renderer } = stage;

  const material = new ShaderMaterial({
    uniforms: { cube: { value: null }, rig: { value: [0, 0, 0, 1] }, rows: { value: [0, 0] } },
    vertexShader: ALL_ROUND_VERTEX,
    fragmentShader: ALL_ROUND,
    depthTest: false,
  });
  const screen = new Mesh(new PlaneGeometry(1, 1), material);
  screen.frustumCulled = false;
  const scene = new Scene();
  scene.add(screen);
  const eye = new OrthographicCamera();
  let target = new WebGLCubeRenderTarget(1);

  function allRound(columns: number, rows: number, face: number): Uint8Array {
    if (target.width !== face) {
      target.dispose();
      target = new WebGLCubeRenderTarget(face, { magFilter: NearestFilter, minFilter: NearestFilter });
    }
    const cube = new CubeCamera(0.02, 4000, target);
    cube.position.copy(stage.rig.position);
    const q = stage.rig.quaternion;
    // Of the horizon of a level camera only the middle rows of each face are needed.
    target.scissorTest = rows === 1 && new Vector3(0, 1, 0).applyQuaternion(q).y > 1 - 1e-12;
    if (target.scissorTest) target.scissor.set(0, face / 2 - 2, face, 4);
    else target.scissor.set(0, 0, face, face);
    const rigVisible = stage.rig.visible;
    stage.rig.visible = false; // the cover belongs to the viewer's camera
    cube.update(renderer, stage.scene);
    stage.rig.visible = rigVisible;
    const half = rows === 1 ? 0 : Math.PI / 2;
    material.uniforms["cube"]!.value = target.texture;
    material.uniforms["rig"]!.value = [q.x, q.y, q.z, q.w];
    material.uniforms["rows"]!.value = [-half, half];
    const flat = new WebGLRenderTarget(columns, rows);
    renderer.setRenderTarget(flat);
    renderer.render(scene, eye);
    renderer.setRenderTarget(null);
    const pixels = new Uint8Array(4 * columns * rows);
    renderer.readRenderTargetPixels(flat, 0, 0, columns, rows, pixels);
    flat.dispose();
    stage.stale = true;
    return pixels;
  }

  /** Pixels from the top row to the bottom one, each as `value` reads it. */
  function read<T>(columns: number, rows: number, value: (at: number) => T[]): T[] {
    return Array.from({ length: rows }, (_, row) =>
      Array.from({ length: columns }, (_, column) => value(4 * ((rows - 1 - row) * columns + column))).flat(),
    ).flat();
  }

  const world = (v: Vector3): number[] => [v.x, -v.z, v.y];
  return {
    links: () =>
      stage.scenery.links.map((link) => ({
        position: world(link.position),
        ahead: world(new Vector3(1, 0, 0).applyQuaternion(link.quaternion)),
        up: world(new Vector3(0, 1, 0).applyQuaternion(link.quaternion)),
      })),
    pose() {
      const q = stage.rig.getWorldQuaternion(new Quaternion());
      const p = stage.rig.getWorldPosition(new Vector3());
      return {
        position: world(p),
        ahead: world(new Vector3(0, 0, -1).applyQuaternion(q)),
        left: world(new Vector3(-1, 0, 0).applyQuaternion(q)),
        up: world(new Vector3(0, 1, 0).applyQuaternion(q)),
      };
    },
    at(track, t) {
      clock.playing = false;
      clock.current = track;
      clock.seek(t);
      stage.place(clock.track, clock.t);
    },
    numbers(columns, rows, face) {
      stage.scenery.materials.asNumbers.value = true;
      const zones = stage.scenery.materials.zones;
      zones.visible = false;
      const pixels = allRound(columns, rows, face);
      stage.scenery.materials.asNumbers.value = false;
      zones.visible = true;
      return read(columns, rows, (at) => [pixels[at]! + 256 * pixels[at + 1]! + 65536 * pixels[at + 2]!]);
    },
    colours(columns, rows, face) {
      const pixels = allRound(columns, rows, face);
      return read(columns, rows, (at) => [pixels[at]!, pixels[at + 1]!, pixels[at + 2]!]);
    },
  };
}
