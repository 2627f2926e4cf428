// Rates of the criteria: one line for each trajectory, over time or over the share of the path, and a cursor.
import type { Clock } from "./clock";
import { colourOfTrack, dashesOfTrack } from "./colours";
import { element } from "../shared/dom";
import type { Criterion, Rates as Values } from "./model";
import { fitted } from "./sheets";
import { placed, type Track } from "./track";

/** Rate of a criterion at a time of a track. */
export function rateAt(values: Values, times: Float64Array, criterion: number, t: number): number {
  return values.values[criterion]![placed(times, t)[0]] ?? 0;
}

/** A value with at most four figures. */
export function figures(value: number): string {
  if (value === 0) return "0";
  return Math.abs(value) >= 1000 || Math.abs(value) < 1e-3 ? value.toExponential(1) : String(Number(value.toPrecision(3)));
}

interface Strip {
  readonly canvas: HTMLCanvasElement;
  readonly now: HTMLElement;
  readonly low: number;
  readonly high: number;
  lines: HTMLCanvasElement | null;
  drawn: string;
}

export class RatesPanel {
  private readonly strips: Strip[];
  private readonly times: Float64Array[];
  private readonly values: Values[];

  constructor(
    root: HTMLElement,
    criteria: readonly Criterion[],
    private readonly tracks: readonly Track[],
    private readonly clock: Clock,
    seek: (t: number) => void,
  ) {
    this.values = tracks.map((track) => track.data.rates ?? { times: [0], values: [] });
    this.times = this.values.map((values) => Float64Array.from(values.times));
    this.strips = criteria.map((criterion, k) => {
      const row = element("div", "rate");
      const now = element("span", "now");
      const title = element("div", "rate-title");
      title.append(element("span", "rate-name", criterion.name), now, element("span", "rate-unit", criterion.unit));
      const totals = element("div", "rate-totals");
      tracks.forEach((track, i) => {
        const total = element("span", "", `${track.name} ${track.data.costs[k] ?? ""}`);
        total.style.color = colourOfTrack(i);
        totals.append(total);
      });
      const canvas = document.createElement("canvas");
      row.append(title, canvas, totals);
      root.append(row);
      const all = this.values.flatMap((values) => [...(values.values[k] ?? [])]);
      const drag = (event: PointerEvent): void => {
        const box = canvas.getBoundingClientRect();
        seek(this.timeOf(Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1)));
      };
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        drag(event);
      });
      canvas.addEventListener("pointermove", (event) => {
        if (event.buttons > 0) drag(event);
      });
      const low = all.reduce((a, b) => Math.min(a, b), 0);
      const high = all.reduce((a, b) => Math.max(a, b), 0);
      return { canvas, now, low, high: high > low ? high : low + 1, lines: null, drawn: "" };
    });
  }

  draw(): void {
    this.strips.forEach((strip, k) => {
      const pen = fitted(strip.canvas);
      const { current, t } = this.clock;
      const values = this.values[current]!;
      if (values.values[k] !== undefined) strip.now.textContent = figures(rateAt(values, this.times[current]!, k, t));
      if (pen === null) return;
      const { clientWidth: width, clientHeight: height } = strip.canvas;
      const key = `${strip.canvas.width} ${strip.canvas.height} ${current} ${this.clock.together}`;
      if (strip.drawn !== key) {
        strip.lines = this.lines(strip, k);
        strip.drawn = key;
      }
      pen.drawImage(strip.lines!, 0, 0, width, height);
      const x = this.place(current, t) * width;
      pen.fillStyle = "#fff";
      pen.fillRect(x - 0.75, 0, 1.5, height);
    });
  }

  /** Position of a time of a track on the axis, 0 to 1. */
  private place(i: number, t: number): number {
    if (this.clock.together === "progress") return this.tracks[i]!.progressAt(t);
    return t / Math.max(...this.tracks.map((track) => track.duration), 1e-9);
  }

  /** The time of the current track at a position on the axis. */
  private timeOf(share: number): number {
    if (this.clock.together === "progress") return this.clock.track.timeAt(share);
    return share * Math.max(...this.tracks.map((track) => track.duration));
  }

  /** Lines of all tracks, the current one on top: drawn again only if it changes. */
  private lines(strip: Strip, k: number): HTMLCanvasElement {
    const sheet = document.createElement("canvas");
    sheet.width = strip.canvas.width;
    sheet.height = strip.canvas.height;
    const pen = sheet.getContext("2d")!;
    const ratio = sheet.width / strip.canvas.clientWidth;
    const [width, height] = [strip.canvas.clientWidth, strip.canvas.clientHeight];
    pen.scale(ratio, ratio);
    const y = (value: number): number => height - 2 - ((value - strip.low) / (strip.high - strip.low)) * (height - 4);
    pen.fillStyle = "#3a4046";
    pen.fillRect(0, y(0), width, 1);
    const order = this.tracks.map((_, i) => i).filter((i) => i !== this.clock.current);
    for (const i of [...order, this.clock.current]) {
      const { values, times } = this.values[i]!;
      const rates = values[k];
      if (rates === undefined) continue;
      pen.beginPath();
      rates.forEach((rate, piece) => {
        pen.lineTo(this.place(i, times[piece]!) * width, y(rate));
        pen.lineTo(this.place(i, times[piece + 1]!) * width, y(rate));
      });
      pen.strokeStyle = colourOfTrack(i);
      pen.setLineDash(i === this.clock.current ? [] : [...dashesOfTrack(i)]);
      pen.globalAlpha = i === this.clock.current ? 1 : 0.6;
      pen.lineWidth = i === this.clock.current ? 1.8 : 1.2;
      pen.stroke();
    }
    return sheet;
  }
}
