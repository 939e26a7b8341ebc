/** Lamps on poles, in their colours. */

import * as THREE from "three";
import type { Environment, LampColor } from "../messages";
import type { Vec3 } from "../geometry/vec";
import { setMatrix, type MeshFactory } from "./mesh_factory";
import type { Marks } from "./marks";

const BULB_M = 0.055;
/** A mouse meets a lamp within this radius. */
const REACH_M = 0.12;

interface Lamp {
  readonly id: string;
  readonly at: Vec3;
  color: Vec3;
}

/** All lamps of a map. */
export class Lamps {
  readonly places = new Map<string, Vec3>();
  readonly targets: THREE.Object3D[] = [];
  private readonly lamps: Lamp[];
  private readonly bulbs: THREE.InstancedMesh | null = null;
  private readonly paint = new THREE.Color();

  constructor(factory: MeshFactory, map: Environment) {
    this.lamps = map.lamps.map(({ id, position_m }) => ({ id, at: position_m, color: [-1, 0, 0] }));
    const { length } = this.lamps;
    if (!length) return;
    const around = factory.light ? 10 : 24;
    const metal = factory.matt(factory.theme.leg, { roughness: 0.4, metalness: 0.4 });
    const turned = (geometry: THREE.BufferGeometry) => geometry.rotateX(Math.PI / 2);
    const poles = factory.many(turned(new THREE.CylinderGeometry(0.016, 0.02, 1, around)), metal, length);
    const feet = factory.many(turned(new THREE.CylinderGeometry(0.13, 0.15, 0.025, around)), metal, length);
    const collars = factory.many(
      turned(new THREE.CylinderGeometry(0.036, 0.03, 0.05, around)),
      metal,
      length,
    );
    this.bulbs = factory.many(
      new THREE.SphereGeometry(BULB_M, around, around / 2),
      factory.plain(0xffffff),
      length,
      "casts",
    );
    const reach = factory.many(new THREE.SphereGeometry(REACH_M, 8, 6), factory.plain(0), length, "");
    reach.visible = false;
    this.targets.push(reach);
    this.lamps.forEach(({ id, at: [x, y, z] }, i) => {
      this.places.set(id, [x, y, z]);
      const tall = Math.max(z - BULB_M, 0.02);
      setMatrix(poles.instanceMatrix.array, i, x, y, tall / 2, 0, 1, 1, tall);
      setMatrix(feet.instanceMatrix.array, i, x, y, 0.0125, 0, 1, 1, 1);
      setMatrix(collars.instanceMatrix.array, i, x, y, z - BULB_M, 0, 1, 1, 1);
      setMatrix(this.bulbs!.instanceMatrix.array, i, x, y, z, 0, 1, 1, 1);
      setMatrix(reach.instanceMatrix.array, i, x, y, z, 0, 1, 1, 1);
    });
    this.set(new Map(), factory.theme.dark);
  }

  /** Show the commanded colours, but for lamps that are `closed`: whether these shine is not known. */
  set(colors: ReadonlyMap<string, LampColor>, dark: boolean, closed: ReadonlySet<string> = new Set()): void {
    const off = dark ? 0.2 : 0.5;
    this.lamps.forEach((lamp, i) => {
      const [r, g, b] = closed.has(lamp.id) ? [0, 0, 0] : (colors.get(lamp.id)?.color ?? [0, 0, 0]);
      if (r === lamp.color[0] && g === lamp.color[1] && b === lamp.color[2]) return;
      lamp.color = [r, g, b];
      const lit = Math.max(r, g, b) / 255;
      const rest = off * (1 - Math.min(lit * 2, 1));
      this.paint.setRGB(
        Math.max(r / 255, rest),
        Math.max(g / 255, rest),
        Math.max(b / 255, rest),
        THREE.SRGBColorSpace,
      );
      this.bulbs!.setColorAt(i, this.paint);
      if (this.bulbs!.instanceColor) this.bulbs!.instanceColor.needsUpdate = true;
    });
  }

  /** The glow about those that shine. */
  mark(marks: Marks): void {
    for (const { at, color } of this.lamps) {
      const lit = Math.max(...color) / 255;
      if (lit > 0.03) marks.add(at, 0.16 + 0.3 * lit, color, GLOW);
    }
  }
}

const GLOW = { pattern: "glow", faces: true, alpha: 0.85 } as const;
