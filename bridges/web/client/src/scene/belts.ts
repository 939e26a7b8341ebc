/** Belts: rubber that runs, frames, rollers at their ends, legs. */

import * as THREE from "three";
import type { Belt, ConveyorState, Environment } from "../messages";
import { Polyline } from "../geometry/polyline";
import { ribbon } from "../geometry/ribbon";
import { setMatrix, type MeshFactory } from "./mesh_factory";
import { Mesher } from "./mesher";

/** One repetition of the rubber's pattern, m. */
const PATTERN_M = 0.5;
const RAIL_M = 0.028;
const RAIL_BELOW_M = 0.007;
const DEEP_M = 0.11;
const LEG_M = 0.05;
const LEG_EVERY_M = 1.6;
/** Belts that cross lie so far above each other that they do not flicker. */
const LIFT_M = 0.0012;

interface Running {
  id: string;
  map: THREE.Texture;
  speed: number;
}

/** All belts of a map. */
export class Belts {
  readonly lines = new Map<string, Polyline>();
  /** What can be pointed at. */
  readonly targets: THREE.Object3D[] = [];
  private readonly running: Running[] = [];
  private state: ConveyorState | null = null;

  constructor(factory: MeshFactory, map: Environment) {
    const frames = new Mesher();
    const shade = new Mesher();
    const legs: number[][] = [];
    const rollers: number[][] = [];
    const rubber = this.rubber(factory);
    map.belts.forEach((belt, number) => {
      let line;
      try {
        line = new Polyline(belt.line_m);
      } catch {
        return;
      }
      this.lines.set(belt.id, line);
      const cuts = ribbon(line, belt.width_m);
      const lift = LIFT_M * (number % 12);
      const edge = (side: "left" | "right") => Mesher.edge(cuts, side, -RAIL_M / 2, lift, belt.width_m);
      const surface = new Mesher();
      surface.between(
        edge("left"),
        edge("right"),
        cuts.map((cut) => cut.at / PATTERN_M),
      );
      const own = rubber.clone();
      factory.own(own);
      const top = factory.mesh(
        surface.geometry(),
        factory.matt(0xffffff, { map: own, roughness: 0.9 }),
        "shows",
      );
      this.targets.push(top);
      this.running.push({ id: belt.id, map: own, speed: 0 });
      frames.beam(cuts, belt.width_m, RAIL_M, -RAIL_BELOW_M + lift / 2, -DEEP_M);
      const down = (side: "left" | "right") =>
        Mesher.edge(cuts, side, 0.04, 0, belt.width_m).map((p): [number, number, number] => [
          p[0] + 0.12,
          p[1] + 0.08,
          0.005,
        ]);
      shade.between(down("left"), down("right"));
      this.support(belt, line, legs, rollers);
    });
    if (!this.lines.size) return;
    this.targets.push(
      factory.mesh(frames.geometry(), factory.matt(factory.theme.frame, { roughness: 0.4, metalness: 0.35 })),
    );
    if (factory.light) {
      // what a shadow would be, laid on the floor once
      factory.mesh(
        shade.geometry(),
        factory.plain(0x000000, {
          transparent: true,
          opacity: factory.theme.dark ? 0.3 : 0.1,
          depthWrite: false,
        }),
        "",
      );
    }
    const posts = factory.many(new THREE.BoxGeometry(1, 1, 1), factory.matt(factory.theme.leg), legs.length);
    legs.forEach(([x, y, z, yaw, sx, sy, sz], i) =>
      setMatrix(posts.instanceMatrix.array, i, x!, y!, z!, yaw!, sx!, sy!, sz!),
    );
    const ends = factory.many(
      new THREE.CylinderGeometry(1, 1, 1, factory.light ? 10 : 20),
      factory.matt(factory.theme.leg, { roughness: 0.35, metalness: 0.5 }),
      rollers.length,
    );
    rollers.forEach(([x, y, z, yaw, radius, length], i) =>
      setMatrix(ends.instanceMatrix.array, i, x!, y!, z!, yaw!, radius!, length!, radius!),
    );
  }

  private rubber(factory: MeshFactory): THREE.CanvasTexture {
    return factory.texture(
      128,
      128,
      (c) => {
        c.fillStyle = factory.theme.rubber;
        c.fillRect(0, 0, 128, 128);
        c.fillStyle = "rgba(0,0,0,.16)";
        for (let y = 0; y < 128; y += 16) c.fillRect(0, y, 128, 3);
        c.strokeStyle = factory.theme.chevron;
        c.lineWidth = 9;
        c.lineJoin = "miter";
        c.beginPath();
        c.moveTo(34, 84);
        c.lineTo(64, 52);
        c.lineTo(94, 84);
        c.stroke();
      },
      true,
    );
  }

  private support(belt: Belt, line: Polyline, legs: number[][], rollers: number[][]): void {
    const pairs = Math.max(2, Math.ceil(line.length / LEG_EVERY_M) + 1);
    const inset = Math.min(0.22, line.length / 4);
    for (let i = 0; i < pairs; i++) {
      const at = inset + ((line.length - 2 * inset) * i) / (pairs - 1);
      const [x, y, z] = line.pointAt(at);
      const yaw = line.headingAt(at);
      const tall = z - DEEP_M;
      if (tall < 0.1) continue;
      const aside = belt.width_m / 2 - LEG_M / 2;
      const sin = Math.sin(yaw);
      const cos = Math.cos(yaw);
      for (const side of [aside, -aside])
        legs.push([x - sin * side, y + cos * side, tall / 2, yaw, LEG_M, LEG_M, tall]);
      legs.push([x, y, Math.min(0.3, tall / 2), yaw, LEG_M * 0.7, 2 * aside, LEG_M * 0.7]);
    }
    for (const at of [0, line.length]) {
      const [x, y, z] = line.pointAt(at);
      rollers.push([x, y, z - 0.052, line.headingAt(at), 0.046, belt.width_m - RAIL_M]);
    }
  }

  /** Take the belts' speeds. */
  set(state: ConveyorState | null): void {
    if (state === this.state) return;
    this.state = state;
    const own = new Map(state?.belts.map((belt) => [belt.id, belt.speed_mps]));
    for (const belt of this.running) belt.speed = own.get(belt.id) ?? state?.speed_mps ?? 0;
  }

  /** Let `seconds` of the site pass; returns whether anything runs. */
  run(seconds: number): boolean {
    let runs = false;
    for (const belt of this.running) {
      if (!belt.speed) continue;
      runs = true;
      belt.map.offset.y = (belt.map.offset.y - (belt.speed * seconds) / PATTERN_M) % 1;
    }
    return runs;
  }
}
