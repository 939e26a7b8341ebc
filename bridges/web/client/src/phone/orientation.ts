/** How a phone is turned, as a unit quaternion xyzw that rotates vectors of the device into a frame whose z is up. */

export type Quaternion = [number, number, number, number];

/**
 * From angles of a `deviceorientation` event, degrees.
 *
 * W3C Device Orientation: intrinsic rotations about z (alpha), then the new x (beta), then the new y (gamma); the
 * device's x is to the right of the screen, y to its top, whichever way the screen shows its picture.
 */
export function fromAngles(alpha: number, beta: number, gamma: number): Quaternion {
  const half = Math.PI / 360;
  const cz = Math.cos(alpha * half);
  const sz = Math.sin(alpha * half);
  const cx = Math.cos(beta * half);
  const sx = Math.sin(beta * half);
  const cy = Math.cos(gamma * half);
  const sy = Math.sin(gamma * half);
  return [
    cz * sx * cy - sz * cx * sy,
    cz * cx * sy + sz * sx * cy,
    sz * cx * cy + cz * sx * sy,
    cz * cx * cy - sz * sx * sy,
  ];
}

/** Largest deviation of a quaternion's norm from 1 at which it is normalized: NORM_TOLERANCE of pointit/schemas/base.py. */
const NORM_TOLERANCE = 0.05;

/** The quaternion with norm 1; null if its norm is beyond the tolerance: the sensor has not begun, or is broken. */
export function normalized(q: ArrayLike<number> | null | undefined): Quaternion | null {
  if (!q || q.length !== 4) return null;
  const [x, y, z, w] = [q[0]!, q[1]!, q[2]!, q[3]!];
  const norm = Math.hypot(x, y, z, w);
  return Math.abs(norm - 1) <= NORM_TOLERANCE ? [x / norm, y / norm, z / norm, w / norm] : null;
}
