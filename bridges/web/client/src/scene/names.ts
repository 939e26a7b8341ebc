/** Names of what stands still: of what the mouse is over, and of all lamps while a person is localized by them. */

import * as THREE from "three";
import type { Environment } from "../messages";
import type { Read3, Vec3 } from "../geometry/vec";
import { isOfThing, type Site } from "../site/site";
import { placeName } from "../words";

/** Maximum distance of the mouse from a lamp or strip, px. */
const REACH_PX = 22;

/** Something with a name: a line, or a place with a radius. */
interface Named {
  readonly key: string;
  readonly text: string;
  readonly line_m: readonly Read3[];
  readonly radius_m: number;
  /** The name stands so far above it, m. */
  readonly up: number;
}

export interface ShownName extends Pick<Named, "key" | "text" | "up"> {
  readonly at: Read3;
}

export class Names {
  private readonly lamps: readonly Named[];
  private readonly all: readonly Named[];
  private readonly point = new THREE.Vector3();

  constructor(map: Environment) {
    const named = (
      noun: string,
      id: string,
      line_m: readonly Read3[],
      radius_m: number,
      up: number,
    ): Named => ({ key: `${noun} ${id}`, text: placeName(id, noun), line_m, radius_m, up });
    this.lamps = map.lamps
      .filter(({ id }) => !isOfThing(map, id))
      .map(({ id, position_m }) => named("lamp", id, [position_m], 0, 0.16));
    this.all = [
      ...this.lamps,
      ...map.strips.map(({ id, line_m }) => named("strip", id, line_m, 0, 0.08)),
      ...map.boxes.map(({ id, center_m, size_m }) =>
        named("box", id, [center_m], Math.hypot(size_m[0], size_m[1]) / 2, size_m[2] / 2 + 0.05),
      ),
      ...map.spheres.map(({ id, center_m, radius_m }) =>
        named("ball", id, [center_m], radius_m, radius_m + 0.05),
      ),
      ...map.cylinders.map(({ id, center_m, radius_m, height_m }) =>
        named("tank", id, [center_m], radius_m, height_m + 0.05),
      ),
    ];
  }

  /** Names to be shown; `pointer`: of the mouse, px from the picture's upper left corner, or null; `all`: of all lamps. */
  shown(
    site: Site,
    pointer: Read2 | null,
    camera: THREE.PerspectiveCamera,
    width: number,
    height: number,
    all = false,
  ): ShownName[] {
    const isLocalizing = [...site.people.values()].some(
      ({ localization }) => localization?.phase === "sampling",
    );
    const shown: ShownName[] =
      all || isLocalizing ? this.lamps.map((each) => ({ ...each, at: each.line_m[0]! })) : [];
    const hovered = pointer && this.hovered(pointer, camera, width, height);
    return hovered && !shown.some(({ key }) => key === hovered.key) ? [...shown, hovered] : shown;
  }

  /** What is nearest to the mouse; small things before large ones about them. */
  hovered(pointer: Read2, camera: THREE.PerspectiveCamera, width: number, height: number): ShownName | null {
    let best: ShownName | null = null;
    let least = Infinity;
    for (const each of this.all) {
      const ends = each.line_m.map((at) => this.seen(at, camera, width, height));
      for (let i = 0; i < ends.length; i++) {
        const from = ends[Math.max(i - 1, 0)];
        const to = ends[i];
        if (!from || !to) continue;
        const share = nearestShare(pointer, from, to);
        const away = Math.hypot(
          from.x + share * (to.x - from.x) - pointer[0],
          from.y + share * (to.y - from.y) - pointer[1],
        );
        const reach = Math.max(REACH_PX, each.radius_m * to.perM);
        const rank = away / reach + (each.radius_m ? 1 : 0);
        if (away > reach || rank >= least) continue;
        least = rank;
        best = { ...each, at: mixed(each.line_m[Math.max(i - 1, 0)]!, each.line_m[i]!, share) };
      }
    }
    return best;
  }

  /** Where the camera sees a place, px, and the size of a metre there; null behind it. */
  private seen(
    at: Read3,
    camera: THREE.PerspectiveCamera,
    width: number,
    height: number,
  ): { x: number; y: number; perM: number } | null {
    const away = -this.point.set(...at).applyMatrix4(camera.matrixWorldInverse).z;
    if (away <= camera.near) return null;
    const { x, y } = this.point.applyMatrix4(camera.projectionMatrix);
    return {
      x: ((x + 1) * width) / 2,
      y: ((1 - y) * height) / 2,
      perM: height / (2 * away * Math.tan((camera.fov * Math.PI) / 360)),
    };
  }
}

type Read2 = readonly [number, number];

/** Share of the way from `a` to `b` at which the line is nearest to `point`. */
function nearestShare([x, y]: Read2, a: { x: number; y: number }, b: { x: number; y: number }): number {
  const dx = b.x - a.x;
  const dy = b.y - a.y;
  const length = dx * dx + dy * dy;
  return length ? Math.max(0, Math.min(1, ((x - a.x) * dx + (y - a.y) * dy) / length)) : 0;
}

const mixed = (a: Read3, b: Read3, share: number): Vec3 =>
  [0, 1, 2].map((i) => a[i]! + (b[i]! - a[i]!) * share) as Vec3;
