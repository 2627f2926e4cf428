// The data of the page of an arm, `hpop-arm` version 1, written by hpop/view/arm_page.py. Metres and radians; world axes
// x, y and z up (REP-103). Texts come from files: they are names, never markup.
import type { Mesh, Point, Surfaces, Vector } from "../ride/model";
import { payloadOf } from "../shared/payload";

/** Rows of a pose (3, 4). */
export type Pose = readonly (readonly number[])[];

export interface Joint {
  readonly name: string;
  readonly sliding: boolean;
  /** Whether it turns without limits. */
  readonly turning: boolean;
  readonly low: number;
  readonly high: number;
}

/** A convex body: the Minkowski sum of a hull of points, a disc and a ball, in its frame. */
export interface Body {
  readonly name: string;
  /** Whether it belongs to the arm; else it is an obstacle. */
  readonly link: boolean;
  /** Number of the shape that is drawn for it; an enlarged link is drawn as it is. */
  readonly shown: number;
  /** Frame that carries it: 0 is the world, k moves with the k-th joint. */
  readonly frame: number;
  readonly points: readonly Vector[];
  readonly disc: number;
  readonly plane: readonly [Vector, Vector];
  readonly ball: number;
  readonly centre: Vector;
  readonly reach: number;
}

export interface Mount {
  readonly frame: number;
  readonly pose: Pose;
}

/** An axis of a body that stays within angles of a direction. */
export interface Kept extends Mount {
  readonly axis: Vector;
  readonly direction: Vector;
  readonly angle: Point;
  readonly text: string;
}

export interface Arm {
  readonly title: string;
  readonly joints: readonly Joint[];
  readonly states: readonly { readonly name: string; readonly values: readonly number[] }[];
  /** Frame of each joint at value 0 in the frame before it; its z is the axis. */
  readonly origins: readonly Pose[];
  /** Number of the frame before the frame of each joint: 0, the world, for the first joint of each arm. */
  readonly parents: readonly number[];
  readonly bodies: readonly Body[];
  /** Numbers of the bodies that must not touch. */
  readonly pairs: readonly Point[];
  /** m, the least distance of bodies in a free state. */
  readonly kept_distance: number;
  readonly shapes: readonly Mesh[];
  readonly camera: Mount;
  readonly tool: Mount;
  readonly kept: Kept | null;
  readonly field_of_view: Point | null;
  readonly targets: readonly { readonly name: string; readonly place: Vector }[];
  readonly surfaces: Surfaces;
  readonly notes: readonly string[];
  readonly licence: string;
}

export function arm(): Arm {
  return payloadOf("hpop-arm", 1) as Arm;
}
