/** Where tracked objects are now: extrapolated along their surface, as the server does it. */

import type { TrackedObject } from "../messages";
import { isBox } from "./appearance";
import type { Polyline } from "./polyline";
import type { Vec3 } from "./vec";

/** Objects are carried on no longer than this after the newest news of them, s of the site. */
export const LONGEST_S = 0.5;

/** Where an object is and how it lies. */
export interface Placed {
  /** Its centre on the surface, {W}. */
  at: Vec3;
  /** Azimuth of its length or of its box, rad. */
  heading: number;
  /** Arc length on its surface, m; 0 when it is on none. */
  along: number;
}

/** Seconds of the site between `stamp_ns` and `now_ns` by which objects are carried on. */
export function elapsed(stamp_ns: number, now_ns: number): number {
  return Math.min(Math.max((now_ns - stamp_ns) / 1e9, 0), LONGEST_S);
}

/**
 * Where `object` is, `seconds` after it was where its message says.
 *
 * A box is where its centre is, not on the strip a part of which is its light.
 *
 * @param line of its strip or belt; null where it has none
 * @param out changed and returned, so that a frame allocates nothing
 */
export function carriedOn(
  object: TrackedObject,
  seconds: number,
  line: Polyline | null,
  out: Placed,
): Placed {
  const asBox = isBox(object);
  if (line && !asBox && (object.surface === "belt" || object.surface === "strip")) {
    out.along = object.surface_position_m + object.surface_speed_mps * seconds;
    line.pointAt(out.along, true, out.at);
    out.heading = line.headingAt(out.along, object.length_m);
    return out;
  }
  for (let axis = 0; axis < 3; axis++)
    out.at[axis] = object.position_m[axis]! + object.velocity_mps[axis]! * seconds;
  const [vx, vy] = object.velocity_mps;
  if (asBox) out.heading = object.yaw_rad ?? 0;
  else if (vx !== 0 || vy !== 0) out.heading = Math.atan2(vy, vx);
  out.along = 0;
  return out;
}
