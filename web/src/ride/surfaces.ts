// Appearance of surfaces: the formulas of hpop/view/ride/surfaces.py, as shaders. Colours are sRGB as stored and shown; a
// colour times a factor is what is seen: nothing is converted to linear light and back.
//
// The waves of the texture are drawn once into a tile; the levels of it that the graphics card makes leave out what a pixel
// would not resolve, and of the grid's lines a pixel shows the share that lies on them: nothing shimmers at a distance.
import {
  Color,
  DataTexture,
  DoubleSide,
  FrontSide,
  LinearFilter,
  LinearMipmapLinearFilter,
  NoColorSpace,
  RedFormat,
  RepeatWrapping,
  ShaderMaterial,
  type Side,
  type Texture,
  Vector2,
  Vector3,
} from "three";
import type { Colour, Surfaces } from "./model";

/** Side of the tile, pixels, a power of two. */
const SIDE = 512;
/** Waves from -RANGE to RANGE are kept; their root mean square is 1. */
const RANGE = 4;
const BACK: Colour = [150, 140, 126];

export function colourOf(colour: Colour): Color {
  return new Color(colour[0] / 255, colour[1] / 255, colour[2] / 255);
}

/** The texture of waves, a square that repeats without a seam. */
function tile(look: Surfaces): DataTexture {
  const values = new Float32Array(SIDE * SIDE);
  for (const [i, j, amplitude, phase] of look.waves) {
    const cosines = Float32Array.from({ length: SIDE }, (_, k) => amplitude * Math.cos((2 * Math.PI * k) / SIDE + phase));
    for (let row = 0; row < SIDE; row++) {
      // Whole numbers of periods: the phase at a pixel is a whole number of pixels along one period.
      let at = (j * row) & (SIDE - 1);
      const base = row * SIDE;
      for (let column = 0; column < SIDE; column++) {
        values[base + column]! += cosines[at]!;
        at = (at + i) & (SIDE - 1);
      }
    }
  }
  const data = Uint8ClampedArray.from(values, (value) => 255 * (0.5 + value / (2 * RANGE)));
  const texture = new DataTexture(data, SIDE, SIDE, RedFormat);
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.magFilter = LinearFilter;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.colorSpace = NoColorSpace;
  texture.anisotropy = 8;
  texture.needsUpdate = true;
  return texture;
}

const SHADE = /* glsl */ `
uniform vec3 light;
uniform vec3 horizon;
uniform float ambient;
uniform float diffuse;
uniform float haze;
uniform bool asNumbers;
varying vec3 vPlace;

/** The number of a thing as a colour, exactly. */
vec4 numbered(float number) {
  float n = floor(number + 0.5);
  return vec4(mod(n, 256.0), mod(floor(n / 256.0), 256.0), floor(n / 65536.0), 255.0) / 255.0;
}

vec3 hazy(vec3 colour) {
  float away = length(vPlace.xz - cameraPosition.xz);
  return mix(colour, horizon, away / (away + haze));
}
`;

const VERTEX = /* glsl */ `
attribute vec2 place;
attribute vec3 paint;
attribute vec4 look;
varying vec3 vPlace;
varying vec3 vNormal;
varying vec2 vUv;
varying vec3 vPaint;
varying vec3 vLook;
varying float vNumber;

void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  vPlace = world.xyz;
  vNormal = mat3(modelMatrix) * normal;
  vUv = place;
  vPaint = paint;
  vLook = look.xyz;
  vNumber = look.w;
  gl_Position = projectionMatrix * viewMatrix * world;
}
`;

/** `look` holds contrast of the waves, darkness of the grid, and 1 where there is a skirting. */
const SURFACE = /* glsl */ `
uniform sampler2D tile;
uniform float period;
uniform vec2 skirting;
uniform vec2 pitch;
uniform float share;
uniform float boost;
varying vec3 vNormal;
varying vec2 vUv;
varying vec3 vPaint;
varying vec3 vLook;
varying float vNumber;

/** Share of an interval round x that lies on the lines of the grid; pitch holds their distance and width. */
vec2 lines(vec2 x, vec2 wide) {
  vec2 low = (x + 0.5 * (pitch.y - wide)) / pitch.x;
  vec2 high = (x + 0.5 * (pitch.y + wide)) / pitch.x;
  vec2 onLow = floor(low) * pitch.y + min(fract(low) * pitch.x, pitch.y);
  vec2 onHigh = floor(high) * pitch.y + min(fract(high) * pitch.x, pitch.y);
  return clamp((onHigh - onLow) / wide, 0.0, 1.0);
}

void main() {
  if (asNumbers) {
    gl_FragColor = numbered(vNumber);
    return;
  }
  vec3 n = normalize(vNormal);
  float factor = min(ambient + boost * diffuse * dot(vec3(n.x, -n.z, n.y), light), boost > 1.0 ? 1.1 : 1.0);
  if (vLook.x + vLook.y > 0.0) {
    vec2 on = lines(vUv, max(fwidth(vUv), 1e-5));
    float wave = (texture2D(tile, vUv / period).r - 0.5) * ${(2 * RANGE).toFixed(1)};
    factor *= (1.0 + vLook.x * wave) * (1.0 - vLook.y * (on.x + on.y - on.x * on.y));
  }
  if (vLook.z > 0.0) {
    float wide = max(fwidth(vUv.y), 1e-6);
    factor *= 1.0 - clamp((skirting.x - vUv.y) / wide + 0.5, 0.0, 1.0) * (1.0 - skirting.y);
  }
  gl_FragColor = vec4(hazy(vPaint * factor), share);
}
`;

const PLATE_VERTEX = /* glsl */ `
varying vec3 vPlace;
varying vec3 vNormal;
varying vec2 vUv;

void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  vPlace = world.xyz;
  vNormal = mat3(modelMatrix) * normal;
  vUv = uv;
  gl_Position = projectionMatrix * viewMatrix * world;
}
`;

const PLATE = /* glsl */ `
uniform sampler2D picture;
uniform vec3 back;
uniform float number;
varying vec3 vNormal;
varying vec2 vUv;

void main() {
  if (asNumbers) {
    gl_FragColor = numbered(number);
    return;
  }
  vec3 n = normalize(vNormal);
  float factor = min(ambient + diffuse * dot(vec3(n.x, -n.z, n.y), light), 1.0);
  gl_FragColor = gl_FrontFacing ? vec4(factor * texture2D(picture, vUv).rgb, 1.0) : vec4(hazy(back * factor), 1.0);
}
`;

const SKY_VERTEX = /* glsl */ `
varying vec3 vAlong;

void main() {
  vAlong = position;
  gl_Position = projectionMatrix * viewMatrix * vec4(cameraPosition + position, 1.0);
}
`;

const SKY = /* glsl */ `
uniform vec3 zenith;
uniform vec3 horizon;
uniform bool asNumbers;
varying vec3 vAlong;

void main() {
  vec3 d = normalize(vAlong);
  float up = clamp(asin(clamp(d.y, -1.0, 1.0)) / ${(Math.PI / 2).toFixed(9)}, 0.0, 1.0);
  gl_FragColor = asNumbers ? vec4(0.0, 0.0, 0.0, 1.0) : vec4(mix(horizon, zenith, up * (2.0 - up)), 1.0);
}
`;

/** The materials of a scene; all share the light, and whether numbers are drawn instead of colours. */
export class Materials {
  readonly asNumbers = { value: false };
  readonly floor: ShaderMaterial;
  readonly zones: ShaderMaterial;
  readonly solids: ShaderMaterial;
  readonly people: ShaderMaterial;
  /** Like people, but what is behind shines through. */
  readonly glass: ShaderMaterial;
  readonly sky: ShaderMaterial;
  private readonly shared: Record<string, { value: unknown }>;

  constructor(readonly surfaces: Surfaces) {
    const [x, y, z] = surfaces.light;
    this.shared = {
      asNumbers: this.asNumbers,
      light: { value: new Vector3(x, y, z) },
      ambient: { value: surfaces.ambient },
      diffuse: { value: surfaces.diffuse },
      haze: { value: surfaces.haze ?? 400 },
      horizon: { value: colourOf(surfaces.sky[0]) },
    };
    const pattern = tile(surfaces);
    this.floor = this.surface(pattern, { depthWrite: false });
    this.zones = this.surface(pattern, { depthWrite: false, share: surfaces.zone_share });
    this.solids = this.surface(pattern, {});
    this.people = this.surface(pattern, { boost: 1.6 });
    this.glass = this.surface(pattern, { boost: 1.6, share: 0.22, depthWrite: false });
    this.sky = new ShaderMaterial({
      uniforms: { ...this.shared, zenith: { value: colourOf(surfaces.sky[1]) } },
      vertexShader: SKY_VERTEX,
      fragmentShader: SKY,
      side: DoubleSide,
      depthWrite: false,
      depthTest: false,
    });
  }

  /** Material of a plate with a picture on its front. */
  plate(picture: Texture, number: number): ShaderMaterial {
    return new ShaderMaterial({
      uniforms: { ...this.shared, picture: { value: picture }, number: { value: number }, back: { value: colourOf(BACK) } },
      vertexShader: PLATE_VERTEX,
      fragmentShader: SHADE + PLATE,
      side: DoubleSide,
    });
  }

  private surface(
    pattern: Texture,
    how: { depthWrite?: boolean; share?: number; boost?: number; side?: Side },
  ): ShaderMaterial {
    const share = how.share ?? 1;
    return new ShaderMaterial({
      uniforms: {
        ...this.shared,
        tile: { value: pattern },
        period: { value: this.surfaces.period },
        skirting: { value: new Vector2(...this.surfaces.skirting) },
        pitch: { value: new Vector2(this.surfaces.pitch, this.surfaces.line) },
        share: { value: share },
        boost: { value: how.boost ?? 1 },
      },
      vertexShader: VERTEX,
      fragmentShader: SHADE + SURFACE,
      transparent: share < 1,
      depthWrite: how.depthWrite ?? true,
      side: how.side ?? FrontSide,
    });
  }
}
