/** The floor, coloured where things cannot be told apart by pointing. */

import * as THREE from "three";
import { confusion, type Separability } from "../geometry/separability";
import { INSEPARABLE_COLORS } from "../geometry/appearance";
import type { MeshFactory } from "./mesh_factory";
import type { Picture } from "./picture";

/** Just above the floor and below fences, m. */
const ABOVE_M = 0.003;
/** The grid's lines are on the floor: from aside, some of their pixels are nearer than those of the squares. */
const OVER_LINES = { polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -2 };
const UP = new THREE.Plane(new THREE.Vector3(0, 0, 1));

/** Put the squares into the scene, and a line around them. */
export function drawSeparability(factory: MeshFactory, separability: Separability): void {
  const { x_m, y_m, told_apart: rows } = separability;
  const columns = x_m.length - 1;
  const color = INSEPARABLE_COLORS[factory.theme.dark ? "dark" : "light"];
  const squares = factory.texture(columns, rows.length, (c) => {
    c.fillStyle = color;
    rows.forEach((row, j) =>
      row.forEach((told, i) => {
        c.globalAlpha = confusion(separability, told);
        c.fillRect(i, rows.length - 1 - j, 1, 1);
      }),
    );
  });
  squares.magFilter = squares.minFilter = THREE.NearestFilter;
  squares.generateMipmaps = false;
  const [left, right, low, high] = [x_m[0]!, x_m[columns]!, y_m[0]!, y_m[rows.length]!];
  const floor = new THREE.PlaneGeometry(right - left, high - low);
  const mesh = factory.mesh(
    floor,
    factory.plain(0xffffff, { map: squares, transparent: true, depthWrite: false, ...OVER_LINES }),
    "",
  );
  mesh.position.set((left + right) / 2, (low + high) / 2, ABOVE_M);
  mesh.add(
    new THREE.LineSegments(
      factory.own(new THREE.EdgesGeometry(floor)),
      factory.own(new THREE.LineBasicMaterial({ color })),
    ),
  );
}

/** Place on the floor below the page's (x, y), {W}, or null above the horizon. */
export function floorAt({ canvas, camera }: Picture, x: number, y: number): [number, number] | null {
  const { left, top, width, height } = canvas.getBoundingClientRect();
  const caster = new THREE.Raycaster();
  caster.setFromCamera(new THREE.Vector2((2 * (x - left)) / width - 1, 1 - (2 * (y - top)) / height), camera);
  const at = caster.ray.intersectPlane(UP, new THREE.Vector3());
  return at && [at.x, at.y];
}
