// The small map: obstacles from above, the paths, and the camera's position and direction.
import { Quaternion, Vector3 } from "three";
import { Above } from "./above";
import type { Clock } from "./clock";
import { colourOfTrack, dashesOfTrack } from "./colours";
import { type Ride, whereIs } from "./model";

const SIGHT = 1.1; // rad: half of a wedge that shows where the camera looks

export class Plan {
  private readonly above: Above;

  constructor(
    canvas: HTMLCanvasElement,
    private readonly ride: Ride,
    private readonly clock: Clock,
  ) {
    const [xs, ys] = [clock.tracks.flatMap((track) => [...track.x]), clock.tracks.flatMap((track) => [...track.y])];
    this.above = new Above(canvas, ride.scene, xs, ys, (pen) => { this.paths(pen); });
  }

  draw(): void {
    const pen = this.above.draw();
    if (pen === null) return;
    for (const person of this.ride.scene.people) {
      const place = whereIs(person, this.clock.t);
      if (place !== null) this.above.person(pen, [place[0], place[1]], place[2], person.radius);
    }
    const { tracks, current } = this.clock;
    tracks.forEach((track, i) => {
      if (i !== current) this.camera(pen, i, this.clock.timeOf(i), track.x.length > 0 ? 3.5 : 0, false);
    });
    this.camera(pen, current, this.clock.t, 6, true);
  }

  /** The paths and the numbers of a tour's stops. */
  private paths(pen: CanvasRenderingContext2D): void {
    this.clock.tracks.forEach((track, i) => {
      const points = Array.from(track.x, (x, k): [number, number] => [x, track.y[k]!]);
      this.above.line(pen, points, colourOfTrack(i), dashesOfTrack(i), 2.2);
    });
    this.ride.stops.forEach((place, i) => {
      if (place !== null) this.above.badge(pen, place, String(i + 1), "#7a0177", "#ffffff"); // as in hpop/view/marks.py
    });
  }

  /** A dot at a camera's position; for the current trajectory also a wedge in its direction. */
  private camera(pen: CanvasRenderingContext2D, i: number, t: number, size: number, looks: boolean): void {
    const [p, q] = [new Vector3(), new Quaternion()];
    this.clock.tracks[i]!.pose(t, p, q);
    const [u, v] = this.above.at(p.x, p.y);
    if (looks) {
      const ahead = new Vector3(1, 0, 0).applyQuaternion(q);
      const heading = Math.atan2(-ahead.y, ahead.x);
      const fov = this.ride.field_of_view;
      const half = fov === null ? SIGHT / 2 : Math.min(fov[0], 2 * Math.PI) / 2;
      pen.beginPath();
      pen.moveTo(u, v);
      pen.arc(u, v, 26, heading - half, heading + half);
      pen.closePath();
      pen.fillStyle = "rgb(255 255 255 / 0.55)";
      pen.fill();
    }
    pen.beginPath();
    pen.arc(u, v, size, 0, 2 * Math.PI);
    pen.fillStyle = colourOfTrack(i);
    pen.fill();
    pen.strokeStyle = "#111";
    pen.lineWidth = 1.5;
    pen.stroke();
  }
}
