/** Lines of a map by the surface that names them: for positions of objects and the pointer. */

import type { Environment, TrackedObject } from "../messages";
import { Polyline } from "../geometry/polyline";
import { carriedOn, elapsed, type Placed } from "../geometry/motion";

/** Centre lines of belts and strips; those without a length are left out. */
export class Lanes {
  private readonly lines = new Map<string, Polyline>();

  constructor(map: Environment | null) {
    for (const belt of map?.belts ?? []) this.add(`belt ${belt.id}`, belt.line_m);
    for (const strip of map?.strips ?? []) this.add(`strip ${strip.id}`, strip.line_m);
  }

  line(surface: string, id: string): Polyline | null {
    return this.lines.get(`${surface} ${id}`) ?? null;
  }

  /** Position of `object`, reported at `stamp_ns`, at `now_ns`. */
  placed(object: TrackedObject, stamp_ns: number, now_ns: number): Placed {
    const out: Placed = { at: [0, 0, 0], heading: 0, along: 0 };
    return carriedOn(object, elapsed(stamp_ns, now_ns), this.line(object.surface, object.surface_id), out);
  }

  private add(key: string, line: readonly [number, number, number][]): void {
    try {
      this.lines.set(key, new Polyline(line));
    } catch {
      // A line without a length has no place on it; there is nothing to draw.
    }
  }
}
