// Pictures on the plates of landmarks, as in panoramas (hpop/view/ride/tiles.py): the name; a painting
// where a plate has a front and no name; a star where it has neither.
import type { Colour, Landmark } from "./model";

const WIDTH = 512;
const HEIGHT = 320;
const INK = "#2b2b2b";
const FRAME = "#6b5d49";
const GOLD = "#b08d3e";
const SKIES: readonly Colour[] = [[196, 216, 232], [240, 214, 176], [206, 222, 204], [226, 206, 220]];
const HILLS: readonly Colour[] = [[96, 122, 92], [112, 96, 120], [70, 104, 124], [140, 104, 76]];

export function plateOf(mark: Landmark): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH;
  canvas.height = HEIGHT;
  const pen = canvas.getContext("2d")!;
  pen.fillStyle = css(mark.colour);
  pen.fillRect(0, 0, WIDTH, HEIGHT);
  const name = mark.name.trim();
  if (name === "" && mark.facing !== null) {
    paint(pen, mark.number);
    return canvas;
  }
  pen.strokeStyle = FRAME;
  pen.lineWidth = 14;
  pen.strokeRect(7, 7, WIDTH - 14, HEIGHT - 14);
  write(pen, name === "" ? "\u2605" : name);
  return canvas;
}

function css(colour: Colour): string {
  return `rgb(${colour.join(",")})`;
}

/** A text in the largest letters in which it fits. */
function write(pen: CanvasRenderingContext2D, name: string): void {
  const room = WIDTH - 60;
  let size = 116;
  let lines: string[] = [];
  do {
    size -= 6;
    pen.font = `600 ${size}px system-ui, sans-serif`;
    lines = [];
    for (const word of name.split(/\s+/)) {
      const longer = lines.length > 0 ? `${lines.at(-1)!} ${word}` : word;
      if (lines.length > 0 && pen.measureText(longer).width <= room) lines[lines.length - 1] = longer;
      else lines.push(word);
    }
  } while (size > 32 && (lines.length * 1.15 * size > HEIGHT - 40 || lines.some((line) => pen.measureText(line).width > room)));
  lines = lines.slice(0, 6);
  pen.fillStyle = INK;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  lines.forEach((line, i) => {
    pen.fillText(line, WIDTH / 2, HEIGHT / 2 + (i - (lines.length - 1) / 2) * 1.15 * size, room + 10);
  });
}

/** A landscape: sky, sun, two ranges of hills, in hues that differ from one number to the next. */
function paint(pen: CanvasRenderingContext2D, number: number): void {
  const turn = (number * 0.618034) % 1;
  const [sky, hill] = [SKIES[number % SKIES.length]!, HILLS[number % HILLS.length]!];
  pen.fillStyle = css(sky);
  pen.fillRect(0, 0, WIDTH, HEIGHT);
  pen.fillStyle = "#faf0ce";
  pen.beginPath();
  pen.arc(WIDTH * (0.25 + 0.5 * turn), 0.36 * HEIGHT, 26, 0, 2 * Math.PI);
  pen.fill();
  for (const [depth, lift] of [[0, 0.42], [1, 0.66]] as const) {
    pen.fillStyle = css(hill.map((c, k) => Math.floor((c * (1 + depth) + sky[k]! * (1 - depth)) / 2)) as unknown as Colour);
    pen.beginPath();
    pen.moveTo(0, HEIGHT);
    for (let x = 0; x <= WIDTH; x += 8) {
      pen.lineTo(x, HEIGHT * (lift + 0.1 * Math.sin(x / 47 + 6.3 * turn + 2 * depth) + 0.05 * Math.sin(x / 19)));
    }
    pen.lineTo(WIDTH, HEIGHT);
    pen.fill();
  }
  pen.strokeStyle = GOLD;
  pen.lineWidth = 22;
  pen.strokeRect(11, 11, WIDTH - 22, HEIGHT - 22);
}
