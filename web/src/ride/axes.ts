// From the world's axes, x right, y up in the plane, z height, to those of three: x right, y height, z towards the viewer.
// A camera here looks along its x, its left is y and its up z; one of three looks along -z, its right is x and its up y.
import { Matrix4, Quaternion, Vector3 } from "three";

/** World axes to those of three: (x, y, z) becomes (x, z, -y). */
export const TO_THREE = new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), -Math.PI / 2);
/** A camera of three in the axes of the camera here. */
const OPTICAL = new Quaternion().setFromRotationMatrix(
  new Matrix4().makeBasis(new Vector3(0, -1, 0), new Vector3(0, 0, 1), new Vector3(-1, 0, 0)),
);

/** Turns a position of the world into one of three, in place. */
export function positionToThree(p: Vector3): Vector3 {
  return p.set(p.x, p.z, -p.y);
}

const FROM_THREE = TO_THREE.clone().invert();

/** The orientation of a body of the world, as one of an object whose corners are in the axes of three, in place. */
export function bodyToThree(q: Quaternion): Quaternion {
  return q.premultiply(TO_THREE).multiply(FROM_THREE);
}

/** The orientation of a camera of the world, as one of a camera of three, in place. */
export function cameraToThree(q: Quaternion): Quaternion {
  return q.premultiply(TO_THREE).multiply(OPTICAL);
}

/** Leaves of a camera of three only its heading, in place: upright, with a level view. */
export function levelled(q: Quaternion): Quaternion {
  const ahead = new Vector3(0, 0, -1).applyQuaternion(q);
  return q.setFromAxisAngle(new Vector3(0, 1, 0), Math.atan2(-ahead.x, -ahead.z));
}
