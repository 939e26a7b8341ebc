/** The direction of gravity in the frame of a phone's main camera. */

import type { Quaternion } from "../phone/orientation";

/**
 * Return the unit vector of "down" with x right, y down and z ahead in the picture.
 *
 * `q` rotates vectors of the device (x right, y to its top edge, z out of the screen) into a frame whose z is up.
 * `angle`: by how much the picture on the screen is rotated, degrees, as `screen.orientation.angle`.
 */
export function gravity(q: Quaternion, angle: number): [number, number, number] {
  const [x, y, z, w] = q;
  const up = [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z] as const;
  const [sine, cosine] = [Math.sin((angle * Math.PI) / 180), Math.cos((angle * Math.PI) / 180)];
  return [-(cosine * up[0] - sine * up[1]), sine * up[0] + cosine * up[1], up[2]];
}
