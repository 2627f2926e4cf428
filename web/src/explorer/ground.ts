// What a map shows besides trajectories: floor, walls, zones under them; people, landmarks, start and goals above.
import type { Area, End, Landmark, MeasuredField, Obstacle, Person, Tour, World, Zone } from "./payload";
import type { Theme } from "./theme";
import type { Viewport } from "./viewport";

const START = "#ffffff"; // as in hpop/view/style.py
const GOAL = "#f0e442";
const EDGE = "#111111"; // of both, on either paper
const LEAST_PERSON = 4; // CSS pixels, radius
const LANDMARK = 5; // CSS pixels, radius
const END = 6; // CSS pixels, radius
const LOWER = 0.4; // opacity of obstacles that do not reach the camera's height
const TARGET = 5; // CSS pixels, radius
const ARROW = 1; // s of walking that the arrow of a person shows
const MOST_NAMES = 24; // most landmarks and people in view whose names are written
const HATCH = 7; // CSS pixels between the hatch lines of closed areas
const PITCH = 48; // CSS pixels from one arrow of a one-way zone to the next
const STOP = 8; // CSS pixels, radius of the disc with a stop's number
const STOP_COLOUR = "#7a0177"; // as in hpop/view/marks.py
const SHADE: readonly [number, number, number] = [184, 143, 56]; // sand, as in hpop/view/ground.py, but darker
const MOST_SHADE = 150; // opacity of the greatest value of a measured field, of 255
const FONT = "11px system-ui, sans-serif";

/** Size of a canvas, CSS pixels. */
interface Size {
  readonly width: number;
  readonly height: number;
}

/** Areas as paths in metres, made once. */
export class Ground {
  private readonly floor: Path2D;
  private readonly walls: Path2D;
  /** Obstacles that end below the camera or begin above it: it sees over them. */
  private readonly others: Path2D;
  private readonly closed: Path2D;
  private readonly zones: readonly { readonly zone: Zone; readonly path: Path2D }[];
  /** Picture of the measured field, the greatest y on top. */
  private readonly shade: HTMLCanvasElement | null;

  constructor(private readonly world: World, private readonly tour: Tour | null) {
    const seen = (one: Obstacle) => isSeen(one, world);
    this.floor = pathOf(world.extent);
    this.walls = pathOf(...world.obstacles.filter(seen).map(({ area }) => area));
    this.others = pathOf(...world.obstacles.filter((one) => !seen(one)).map(({ area }) => area));
    this.closed = pathOf(world.closed);
    this.shade = world.field && shadeOf(world.field);
    this.zones = world.zones.map((zone) => ({ zone, path: pathOf(zone.area) }));
  }

  /** Draws what lies under trajectories, over the whole canvas; `ratio` canvas pixels to a CSS pixel. */
  draw(context: CanvasRenderingContext2D, viewport: Viewport, theme: Theme, ratio: number): void {
    const { width, height } = context.canvas;
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = theme.paper;
    context.fillRect(0, 0, width, height);
    context.globalAlpha = 0.45;
    context.fillStyle = theme.line;
    context.fillRect(0, 0, width, height);
    context.globalAlpha = 1;
    viewport.transform(context, ratio);
    context.lineWidth = 1 / viewport.scale;
    context.fillStyle = theme.paper;
    context.strokeStyle = theme.quiet;
    context.fill(this.floor);
    if (this.shade !== null) this.drawShade(context, this.shade, this.world.field!);
    context.stroke(this.floor);
    for (const { zone, path } of this.zones) drawZone(context, zone, path, viewport, theme);
    this.hatch(context, viewport, theme, ratio);
    context.fillStyle = theme.wall;
    context.globalAlpha = LOWER;
    context.fill(this.others);
    context.globalAlpha = 1;
    context.fill(this.walls);
    context.restore();
  }

  /** Draws what lies above trajectories. */
  drawSymbols(context: CanvasRenderingContext2D, viewport: Viewport, theme: Theme, size: Size): void {
    const { people, groups, landmarks, targets, zones, start, goals } = this.world;
    context.save();
    context.font = FONT;
    for (const zone of zones) if (zone.path !== null) drawWay(context, zone.path, viewport, theme);
    for (const group of groups) drawTalk(context, group.map((i) => people[i]!), viewport, theme);
    for (const landmark of landmarks) drawLandmark(context, landmark, viewport, theme);
    for (const person of people) drawPerson(context, person, viewport, theme);
    for (const { x, y } of targets) drawTarget(context, viewport.px(x), viewport.py(y), theme);
    for (const { place, within } of this.tour?.stops ?? []) {
      if (place !== null && within !== null) drawDisc(context, viewport.px(place[0]), viewport.py(place[1]), within * viewport.scale);
    }
    for (const goal of goals) drawEnd(context, goal, viewport, GOAL, true);
    drawEnd(context, start, viewport, START, false);
    this.tour?.stops.forEach(({ place }, i) => {
      if (place !== null) drawStop(context, viewport.px(place[0]) - 2 * STOP, viewport.py(place[1]), String(i + 1));
    });
    const named = [...people, ...landmarks, ...targets].filter(({ x, y, name }) => {
      const [px, py] = [viewport.px(x), viewport.py(y)];
      return name !== "" && px >= 0 && py >= 0 && px <= size.width && py <= size.height;
    });
    if (named.length <= MOST_NAMES) {
      for (const { x, y, name } of named) write(context, name, viewport.px(x) + 8, viewport.py(y), theme, "left");
    }
    for (const zone of zones) {
      const [x, y] = middleOf(zone.area);
      const words = zoneWords(zone);
      if (words !== "") write(context, words, viewport.px(x), viewport.py(y), theme, "center");
    }
    context.restore();
  }

  /** Shades the floor by the measured field; the context is in metres, y upwards. */
  private drawShade(context: CanvasRenderingContext2D, shade: HTMLCanvasElement, { box }: MeasuredField): void {
    const [left, low, right, high] = box;
    context.save();
    context.clip(this.floor);
    context.translate(left, high);
    context.scale((right - left) / shade.width, (low - high) / shade.height);
    context.drawImage(shade, 0, 0);
    context.restore();
  }

  /** Hatches the areas that are closed to the robot. */
  private hatch(context: CanvasRenderingContext2D, viewport: Viewport, theme: Theme, ratio: number): void {
    if (this.world.closed.length === 0) return;
    const { width, height } = context.canvas;
    context.save();
    context.clip(this.closed);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.strokeStyle = theme.quiet;
    context.globalAlpha = 0.6;
    context.lineWidth = ratio;
    context.beginPath();
    for (let x = -height; x < width; x += HATCH * ratio) {
      context.moveTo(x, height);
      context.lineTo(x + height, 0);
    }
    context.stroke();
    viewport.transform(context, ratio);
    context.restore();
  }
}

/** A picture of a field: sand, the more opaque the greater the value. */
function shadeOf({ width, shares }: MeasuredField): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = shares.length / width;
  const context = canvas.getContext("2d")!;
  const image = context.createImageData(canvas.width, canvas.height);
  shares.forEach((share, i) => {
    const row = canvas.height - 1 - Math.floor(i / width);
    image.data.set([...SHADE, Math.round(MOST_SHADE * share)], 4 * (row * width + (i % width)));
  });
  context.putImageData(image, 0, 0);
  return canvas;
}

/** A symbol and what it means. */
interface Entry {
  readonly words: string;
  /** Draws the symbol in the middle of 16 by 16 CSS pixels. */
  readonly draw: (context: CanvasRenderingContext2D, theme: Theme) => void;
}

/** Legend of the symbols that occur in this world. */
export function legendOf(world: World, tour: Tour | null): Entry[] {
  const middle: Places = { px: () => 8, py: () => 8, scale: 0 };
  const person: Person = { x: 0, y: 0, yaw: 0, velocity: [0, 0], radius: 0, name: "" };
  const landmark: Landmark = { x: 0, y: 0, z: 0, facing: null, name: "" };
  const end: End = { x: 0, y: 0, yaw: null };
  const entries: (Entry & { here: boolean })[] = [
    {
      words: "start",
      here: true,
      draw: (context) => {
        drawEnd(context, end, middle, START, false);
      },
    },
    {
      words: "goal",
      here: world.goals.length > 0,
      draw: (context) => {
        drawEnd(context, end, middle, GOAL, true);
      },
    },
    {
      words: "person, tick: heading",
      here: world.people.length > 0,
      draw: (context, theme) => {
        drawPerson(context, person, middle, theme);
      },
    },
    {
      words: "landmark",
      here: world.landmarks.length > 0,
      draw: (context, theme) => {
        drawLandmark(context, landmark, middle, theme);
      },
    },
    {
      words: "the camera sees over or under",
      here: world.obstacles.some((one) => !isSeen(one, world)),
      draw: (context, theme) => {
        context.globalAlpha = LOWER;
        context.fillStyle = theme.wall;
        context.fillRect(2, 3, 12, 10);
      },
    },
    ...(tour?.stops ?? []).map(({ name }, i) => ({
      words: `stop: ${name}`,
      here: true,
      draw: (context: CanvasRenderingContext2D) => {
        drawStop(context, 8, 8, String(i + 1));
      },
    })),
    {
      words: world.field === null ? "" : fieldWords(world.field),
      here: world.field !== null,
      draw: (context) => {
        const ramp = context.createLinearGradient(2, 0, 14, 0);
        ramp.addColorStop(0, `rgb(${SHADE.join(" ")} / 0)`);
        ramp.addColorStop(1, `rgb(${SHADE.join(" ")} / ${MOST_SHADE / 255})`);
        context.fillStyle = ramp;
        context.fillRect(2, 3, 12, 10);
      },
    },
    {
      words: "to be looked at",
      here: world.targets.length > 0,
      draw: (context, theme) => {
        drawTarget(context, 8, 8, theme);
      },
    },
  ];
  return entries.filter(({ here }) => here);
}

/** "wifi: -80 (clear) to -40 dBm (dark)". */
function fieldWords({ name, unit, low, high }: MeasuredField): string {
  const said = (value: number): string => String(Number(value.toPrecision(3)));
  return `${name}: ${said(low)} (clear) to ${said(high)} ${unit} (dark)`;
}

/** The part of a viewport that symbols need. */
type Places = Pick<Viewport, "px" | "py" | "scale">;

/** Whether an obstacle reaches the height of the camera. */
function isSeen({ low, high }: Obstacle, { heights }: World): boolean {
  return low <= heights[1] && high >= heights[0];
}

function pathOf(...areas: readonly Area[]): Path2D {
  const path = new Path2D();
  for (const area of areas) {
    for (const ring of area) {
      for (let at = 0; at < ring.length; at += 2) {
        if (at === 0) path.moveTo(ring[0]!, ring[1]!);
        else path.lineTo(ring[at]!, ring[at + 1]!);
      }
      path.closePath();
    }
  }
  return path;
}

function drawZone(
  context: CanvasRenderingContext2D,
  { kind }: Zone,
  path: Path2D,
  { scale }: Viewport,
  theme: Theme,
): void {
  context.save();
  context.fillStyle = kind === "keep-out" ? theme.wall : theme.zone;
  context.globalAlpha = kind === "keep-out" ? 0.35 : 1;
  context.fill(path);
  context.globalAlpha = 1;
  context.strokeStyle = theme.quiet;
  context.setLineDash([4 / scale, 3 / scale]);
  context.stroke(path);
  context.restore();
}

/** Arrow heads along a line, in the direction that is allowed. */
function drawWay(context: CanvasRenderingContext2D, line: Float64Array, viewport: Viewport, theme: Theme): void {
  context.save();
  context.strokeStyle = theme.quiet;
  context.lineWidth = 1.5;
  context.beginPath();
  let rest = PITCH / 2;
  for (let at = 2; at < line.length; at += 2) {
    const [x0, y0] = [viewport.px(line[at - 2]!), viewport.py(line[at - 1]!)];
    const [x1, y1] = [viewport.px(line[at]!), viewport.py(line[at + 1]!)];
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    const length = Math.hypot(x1 - x0, y1 - y0);
    const turn = Math.atan2(y1 - y0, x1 - x0);
    for (; rest < length; rest += PITCH) {
      const [x, y] = [x0 + (rest / length) * (x1 - x0), y0 + (rest / length) * (y1 - y0)];
      for (const side of [2.6, -2.6]) {
        context.moveTo(x, y);
        context.lineTo(x + 7 * Math.cos(turn + side), y + 7 * Math.sin(turn + side));
      }
    }
    rest -= length;
  }
  context.stroke();
  context.restore();
}

/** A disc with a tick for the person's heading, and an arrow along the path of the next second. */
function drawPerson(context: CanvasRenderingContext2D, person: Person, places: Places, theme: Theme): void {
  const [x, y] = [places.px(person.x), places.py(person.y)];
  const radius = Math.max(person.radius * places.scale, LEAST_PERSON);
  const [vx, vy] = person.velocity;
  context.lineWidth = 1.5;
  context.strokeStyle = theme.ink;
  if (vx !== 0 || vy !== 0) {
    drawArrow(context, x, y, x + ARROW * vx * places.scale, y - ARROW * vy * places.scale);
  }
  disc(context, x, y, radius, theme.person, theme.ink);
  const reach = 1.7 * radius;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(x + 0.3 * radius * Math.cos(person.yaw), y - 0.3 * radius * Math.sin(person.yaw));
  context.lineTo(x + reach * Math.cos(person.yaw), y - reach * Math.sin(person.yaw));
  context.stroke();
}

function drawArrow(context: CanvasRenderingContext2D, x0: number, y0: number, x1: number, y1: number): void {
  const turn = Math.atan2(y1 - y0, x1 - x0);
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  for (const side of [2.6, -2.6]) {
    context.moveTo(x1, y1);
    context.lineTo(x1 + 6 * Math.cos(turn + side), y1 + 6 * Math.sin(turn + side));
  }
  context.stroke();
}

/** A line between two who talk, round three or more. */
function drawTalk(context: CanvasRenderingContext2D, talk: readonly Person[], viewport: Viewport, theme: Theme): void {
  const x = talk.reduce((sum, person) => sum + person.x, 0) / talk.length;
  const y = talk.reduce((sum, person) => sum + person.y, 0) / talk.length;
  const round = [...talk].sort((a, b) => Math.atan2(a.y - y, a.x - x) - Math.atan2(b.y - y, b.x - x));
  context.save();
  context.strokeStyle = theme.person;
  context.lineWidth = 2;
  context.setLineDash([2, 3]);
  context.beginPath();
  round.forEach((person, i) => {
    if (i === 0) context.moveTo(viewport.px(person.x), viewport.py(person.y));
    else context.lineTo(viewport.px(person.x), viewport.py(person.y));
  });
  if (talk.length > 2) context.closePath();
  context.stroke();
  context.restore();
}

/** A diamond; a tick where its front looks, if it has one. */
function drawLandmark(context: CanvasRenderingContext2D, { x, y, facing }: Landmark, places: Places, theme: Theme): void {
  const [px, py] = [places.px(x), places.py(y)];
  context.lineWidth = 2;
  context.strokeStyle = theme.ink;
  if (facing !== null) {
    context.beginPath();
    context.moveTo(px, py);
    context.lineTo(px + 2.2 * LANDMARK * Math.cos(facing), py - 2.2 * LANDMARK * Math.sin(facing));
    context.stroke();
  }
  context.lineWidth = 1;
  context.fillStyle = theme.landmark;
  context.beginPath();
  context.moveTo(px, py - LANDMARK);
  context.lineTo(px + LANDMARK, py);
  context.lineTo(px, py + LANDMARK);
  context.lineTo(px - LANDMARK, py);
  context.closePath();
  context.fill();
  context.stroke();
}

/** A cross in a ring: a target of the camera. */
function drawTarget(context: CanvasRenderingContext2D, x: number, y: number, theme: Theme): void {
  for (const [colour, width] of [[theme.halo, 4], [theme.ink, 1.5]] as const) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, TARGET, 0, 2 * Math.PI);
    context.moveTo(x - TARGET - 2, y);
    context.lineTo(x + TARGET + 2, y);
    context.moveTo(x, y - TARGET - 2);
    context.lineTo(x, y + TARGET + 2);
    context.stroke();
  }
}

/** The number of a stop of a tour. */
function drawStop(context: CanvasRenderingContext2D, x: number, y: number, number: string): void {
  context.save();
  context.lineWidth = 1;
  disc(context, x, y, STOP - 1, STOP_COLOUR, "#ffffff");
  context.font = `bold ${FONT}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = "#ffffff";
  context.fillText(number, x, y + 0.5);
  context.restore();
}

/** The disc in which a stop is visited. */
function drawDisc(context: CanvasRenderingContext2D, x: number, y: number, radius: number): void {
  context.save();
  context.strokeStyle = STOP_COLOUR;
  context.lineWidth = 1;
  context.setLineDash([2, 2]);
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.stroke();
  context.restore();
}

/** Start and goals: a disc and a square, each with a tick along its heading if it has one. */
function drawEnd(context: CanvasRenderingContext2D, { x, y, yaw }: End, places: Places, fill: string, square: boolean): void {
  const [px, py] = [places.px(x), places.py(y)];
  if (yaw !== null) {
    context.lineWidth = 2.5;
    context.strokeStyle = fill;
    for (const [colour, width] of [[EDGE, 5], [fill, 2.5]] as const) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(px, py);
      context.lineTo(px + 2.2 * END * Math.cos(yaw), py - 2.2 * END * Math.sin(yaw));
      context.stroke();
    }
  }
  context.lineWidth = 1.5;
  if (!square) disc(context, px, py, END, fill, EDGE);
  else {
    context.fillStyle = fill;
    context.strokeStyle = EDGE;
    context.fillRect(px - END, py - END, 2 * END, 2 * END);
    context.strokeRect(px - END, py - END, 2 * END, 2 * END);
  }
}

function disc(context: CanvasRenderingContext2D, x: number, y: number, radius: number, fill: string, edge: string): void {
  context.fillStyle = fill;
  context.strokeStyle = edge;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
}

/** Writes a word with a halo. */
function write(
  context: CanvasRenderingContext2D,
  words: string,
  x: number,
  y: number,
  theme: Theme,
  align: CanvasTextAlign,
): void {
  context.textAlign = align;
  context.textBaseline = "middle";
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = theme.halo;
  context.fillStyle = theme.ink;
  context.strokeText(words, x, y);
  context.fillText(words, x, y);
}

function zoneWords({ kind, limit, name }: Zone): string {
  const rule = kind === "speed" && limit !== null ? `${limit} m/s at most` : kind === "one-way" ? "one way" : "keep out";
  return name === "" ? rule : `${name}: ${rule}`;
}

/** The middle of the box round an area. */
function middleOf(area: Area): [number, number] {
  let [xMin, yMin, xMax, yMax] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const ring of area) {
    for (let at = 0; at < ring.length; at += 2) {
      xMin = Math.min(xMin, ring[at]!);
      xMax = Math.max(xMax, ring[at]!);
      yMin = Math.min(yMin, ring[at + 1]!);
      yMax = Math.max(yMax, ring[at + 1]!);
    }
  }
  return [(xMin + xMax) / 2, (yMin + yMax) / 2];
}
