// A small map of one path: walls, the path, a ring at its start and a disc at its end.
import type { Plan, Point } from "./model";

const SVG = "http://www.w3.org/2000/svg";

function shape(tag: string, attributes: Readonly<Record<string, string | number>>): SVGElement {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  return made;
}

function line(points: readonly Point[], closed: boolean): string {
  return points.map(([x, y], i) => `${i === 0 ? "M" : "L"}${x} ${-y}`).join("") + (closed ? "Z" : "");
}

export function smallMap(plan: Plan, way: readonly Point[], label: string): SVGElement {
  const [x0, y0, x1, y1] = plan.extent;
  const size = Math.max(x1 - x0, y1 - y0);
  const svg = shape("svg", { viewBox: `${x0} ${-y1} ${x1 - x0} ${y1 - y0}`, role: "img", "aria-label": label });
  svg.append(
    shape("path", { class: "walls", d: plan.walls.map((ring) => line(ring, true)).join(""), "fill-rule": "evenodd" }),
    shape("path", { class: "way", d: line(way, false), fill: "none", "stroke-width": size / 70 }),
  );
  const first = way[0];
  const last = way.at(-1);
  if (first !== undefined && last !== undefined) {
    const r = size / 50;
    svg.append(
      shape("circle", { class: "from", cx: first[0], cy: -first[1], r, "stroke-width": size / 110 }),
      shape("circle", { class: "to", cx: last[0], cy: -last[1], r }),
    );
  }
  return svg;
}
