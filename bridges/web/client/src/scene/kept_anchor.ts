/** The anchor of the last alignment that this browser remembers; the headset knows its position by the handle. */

import type { Vec3 } from "../geometry/vec";

export interface KeptAnchor {
  /** Name of the map. */
  readonly map: string;
  readonly handle: string;
  /** Position, {W}, m, and azimuth of its x axis, rad. */
  readonly at: Vec3;
  readonly yaw: number;
}

const NAME = "pointit-anchor";

/** Store `anchor`, or remove what is stored. */
export function keepAnchor(anchor: KeptAnchor | null): void {
  try {
    if (anchor) localStorage.setItem(NAME, JSON.stringify(anchor));
    else localStorage.removeItem(NAME);
  } catch {
    // storage may be forbidden: then the alignment lasts as long as the session
  }
}

/** The stored anchor, or null if none is stored or it is invalid. */
export function keptAnchor(): KeptAnchor | null {
  try {
    const { map, handle, at, yaw } = JSON.parse(localStorage.getItem(NAME) ?? "") as Partial<KeptAnchor>;
    const isValid =
      typeof map === "string" &&
      typeof handle === "string" &&
      handle !== "" &&
      Array.isArray(at) &&
      at.length === 3 &&
      [...at, yaw].every(Number.isFinite);
    return isValid ? { map, handle, at: at as Vec3, yaw: yaw! } : null;
  } catch {
    return null;
  }
}
