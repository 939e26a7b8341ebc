/** Fences of the map: where robots must stay (outline), and where they may not go (hatched). */

import * as THREE from "three";
import type { Environment } from "../messages";
import { FENCE_COLORS } from "../geometry/appearance";
import type { MeshFactory } from "./mesh_factory";

type Fence = Environment["fences"][number];

/** A fence without an upper end is drawn so high above its foot, m. */
const HIGH_M = 2;
/** Just above the floor, so that both are seen, m. */
const ABOVE_M = 0.006;

/** Put the fences of `map` into the scene. */
export function drawFences(factory: MeshFactory, map: Environment): void {
  for (const fence of map.fences) draw(factory, fence);
}

function draw(factory: MeshFactory, { kind, outline_m: outline, low_m, high_m }: Fence): void {
  const low = Math.max(low_m ?? 0, 0) + ABOVE_M;
  const high = high_m ?? low + HIGH_M;
  const isOut = kind === "keep_out";
  const color = FENCE_COLORS[kind][factory.theme.dark ? "dark" : "light"];
  const around = outline.map((at, i) => [at, outline[(i + 1) % outline.length]!] as const);
  const edges = around.flatMap(([[ax, ay], [bx, by]]) => [
    [ax, ay, low],
    [bx, by, low],
    [ax, ay, low],
    [ax, ay, high],
    ...(high_m === null
      ? []
      : [
          [ax, ay, high],
          [bx, by, high],
        ]),
  ]);
  const lines = new THREE.LineSegments(
    factory.own(positions(edges)),
    factory.own(new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.9 })),
  );
  factory.group.add(lines);
  const look = { color, transparent: true, depthWrite: false, side: THREE.DoubleSide };
  const walls = positions(
    around.flatMap(([[ax, ay], [bx, by]]) => [
      [ax, ay, low],
      [bx, by, low],
      [bx, by, high],
      [ax, ay, low],
      [bx, by, high],
      [ax, ay, high],
    ]),
  );
  factory.mesh(walls, factory.plain(color, { ...look, opacity: isOut ? 0.1 : 0.04 }), "");
  if (!isOut) return;
  const hatched = factory.texture(
    64,
    64,
    (c) => {
      c.strokeStyle = "#ffffff";
      c.lineWidth = 10;
      for (const from of [-64, 0, 64]) {
        c.moveTo(from - 8, 72);
        c.lineTo(from + 72, -8);
      }
      c.stroke();
    },
    true,
  );
  hatched.repeat.set(3, 3);
  const ground = new THREE.ShapeGeometry(new THREE.Shape(outline.map(([x, y]) => new THREE.Vector2(x, y))));
  factory.mesh(ground, factory.plain(color, { ...look, map: hatched, opacity: 0.6 }), "").position.z = low;
}

function positions(points: readonly (readonly number[])[]): THREE.BufferGeometry {
  return new THREE.BufferGeometry().setAttribute(
    "position",
    new THREE.Float32BufferAttribute(points.flat(), 3),
  );
}
