/** One person's body, in their colour; the arms are set in every frame. */

import * as THREE from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import type { BodyMeasures } from "../messages";
import type { Arm } from "../geometry/body";
import type { Read3 } from "../geometry/vec";
import type { MeshFactory } from "./mesh_factory";

const SKIN = 0xd7a586;
const HAIR = 0x3b2c24;
const TROUSERS = 0x39424f;
const SHOES = 0x20252c;
/** Radii, m: upper arm, forearm, hand, finger. */
const RADII = [0.052, 0.042, 0.034, 0.013] as const;
/** Height of the neck in the figure as it is modelled. */
const NECK_M = 1.43;

/** A figure that stands, faces somewhere, and has two arms. */
export class Figure {
  readonly root = new THREE.Group();
  private readonly limbs: THREE.InstancedMesh;
  private readonly joints: THREE.InstancedMesh;
  private readonly materials: THREE.Material[] = [];
  private opacity = 1;

  constructor(factory: MeshFactory, body: BodyMeasures, color: Read3) {
    const shirt = new THREE.Color().setRGB(
      color[0] / 255,
      color[1] / 255,
      color[2] / 255,
      THREE.SRGBColorSpace,
    );
    shirt.lerp(new THREE.Color(0x6d7682), 0.22);
    const painted = factory.matt(0xffffff, { vertexColors: true, roughness: 0.8 });
    const bare = factory.matt(0xffffff, { roughness: 0.8 });
    this.materials.push(painted, bare);
    const mesh = factory.mesh(trunk(body, shirt, factory.light), painted);
    this.root.add(mesh);
    factory.group.add(this.root);
    const around = factory.light ? 10 : 16;
    this.limbs = factory.many(
      new THREE.CylinderGeometry(0.86, 1, 1, around, 1, true).rotateX(Math.PI / 2),
      bare,
      8,
    );
    this.joints = factory.many(new THREE.SphereGeometry(1, around, around / 2), bare, 8);
    const skin = new THREE.Color(SKIN);
    for (let side = 0; side < 2; side++) {
      [shirt, skin, skin, skin].forEach((paint, i) => this.limbs.setColorAt(4 * side + i, paint));
      [shirt, shirt, skin, skin].forEach((paint, i) => this.joints.setColorAt(4 * side + i, paint));
    }
  }

  stand(feet: Read3, facing: number): void {
    this.root.position.set(feet[0], feet[1], feet[2]);
    this.root.rotation.z = facing;
  }

  /** Set the `side`-th arm (0, 1); seen from one's own eyes there is less of it, or nothing. */
  setArm(side: number, { shoulder, elbow, wrist, finger }: Arm, seen: "all" | "own" | "none" = "all"): void {
    const thick = seen === "none" ? 0 : 1;
    const near = seen === "all" ? 1 : 0;
    const palm: Read3 = [0, 1, 2].map((i) => wrist[i]! + (finger[i]! - wrist[i]!) * 0.5) as unknown as Read3;
    const limbs = this.limbs.instanceMatrix.array;
    const joints = this.joints.instanceMatrix.array;
    const first = 4 * side;
    segment(limbs, first, shoulder, elbow, RADII[0] * thick);
    segment(limbs, first + 1, elbow, wrist, RADII[1] * thick);
    segment(limbs, first + 2, wrist, palm, RADII[2] * thick);
    segment(limbs, first + 3, palm, finger, RADII[3] * thick);
    ball(joints, first, shoulder, RADII[0] * 1.06 * near);
    ball(joints, first + 1, elbow, RADII[0] * 0.86 * thick);
    ball(joints, first + 2, palm, RADII[2] * 1.12 * thick);
    ball(joints, first + 3, finger, RADII[3] * thick);
    this.limbs.instanceMatrix.needsUpdate = this.joints.instanceMatrix.needsUpdate = true;
  }

  /** See it thus far; of one's own there are only arms. */
  see(opacity: number, isOwn: boolean): void {
    this.root.visible = !isOwn;
    if (opacity === this.opacity) return;
    this.opacity = opacity;
    for (const material of this.materials) {
      material.transparent = opacity < 1;
      material.opacity = opacity;
      material.needsUpdate = true;
    }
  }
}

function trunk(body: BodyMeasures, shirt: THREE.Color, isLight: boolean): THREE.BufferGeometry {
  const parts: THREE.BufferGeometry[] = [];
  const around = isLight ? 12 : 24;
  const part = (geometry: THREE.BufferGeometry, color: THREE.Color | number) => {
    const paint = new THREE.Color(color).toArray();
    const { count } = geometry.getAttribute("position");
    const colors = new Float32Array(3 * count);
    for (let i = 0; i < count; i++) colors.set(paint, 3 * i);
    geometry.setAttribute("color", new THREE.BufferAttribute(colors, 3));
    parts.push(geometry);
  };
  const tube = (top: number, bottom: number, from: number, to: number) =>
    new THREE.CylinderGeometry(top, bottom, to - from, around, 1)
      .rotateX(Math.PI / 2)
      .translate(0, 0, (from + to) / 2);
  for (const y of [-0.095, 0.095]) {
    part(tube(0.088, 0.055, 0.06, 0.84).translate(0, y, 0), TROUSERS);
    part(new THREE.SphereGeometry(0.07, around, 8).scale(1.75, 0.8, 0.7).translate(0.045, y, 0.045), SHOES);
  }
  const turned = (profile: readonly (readonly [number, number])[]) =>
    new THREE.LatheGeometry(
      profile.map(([radius, z]) => new THREE.Vector2(radius, z)),
      around,
    )
      .rotateX(Math.PI / 2)
      .scale(0.66, 1, 1);
  part(
    turned([
      [0.001, 0.78],
      [0.12, 0.8],
      [0.165, 0.87],
      [0.155, 0.94],
    ]),
    TROUSERS,
  );
  part(
    turned([
      [0.157, 0.93],
      [0.147, 1.05],
      [0.168, 1.2],
      [0.188, 1.3],
      [0.185, 1.36],
      [0.15, 1.41],
      [0.085, 1.445],
      [0.05, 1.455],
    ]),
    shirt,
  );
  part(tube(0.048, 0.058, 1.4, 1.53), SKIN);
  for (const each of parts) each.scale(1, 1, body.footprint_to_neck_m / NECK_M);
  const eyes = body.footprint_to_neck_m + body.neck_to_eyes_m;
  part(new THREE.SphereGeometry(0.112, around, around).scale(1, 0.88, 1.14).translate(0, 0, eyes), SKIN);
  part(
    new THREE.SphereGeometry(0.122, around, around, 0, 2 * Math.PI, 0, 1.35)
      .rotateX(Math.PI / 2)
      .rotateY(-0.42)
      .scale(1, 0.9, 1.08)
      .translate(-0.008, 0, eyes + 0.012),
    HAIR,
  );
  part(new THREE.SphereGeometry(0.019, 8, 6).translate(0.115, 0, eyes - 0.02), SKIN);
  for (const y of [-0.042, 0.042])
    part(new THREE.SphereGeometry(0.013, 8, 6).translate(0.1, y, eyes + 0.012), SHOES);
  return mergeGeometries(parts);
}

/** A matrix that lays a tube of length 1 along z from `a` to `b`, `radius` thick. */
function segment(
  array: ArrayLike<number> & { [i: number]: number },
  i: number,
  a: Read3,
  b: Read3,
  radius: number,
): void {
  const dx = b[0] - a[0];
  const dy = b[1] - a[1];
  const dz = b[2] - a[2];
  const length = Math.max(Math.hypot(dx, dy, dz), 1e-6);
  const level = Math.hypot(dx, dy);
  const px = level > 1e-6 ? -dy / level : 0;
  const py = level > 1e-6 ? dx / level : 1;
  const at = 16 * i;
  const zx = dx / length;
  const zy = dy / length;
  const zz = dz / length;
  array[at] = px * radius;
  array[at + 1] = py * radius;
  array[at + 2] = array[at + 3] = array[at + 7] = array[at + 11] = 0;
  array[at + 4] = -py * zz * radius;
  array[at + 5] = px * zz * radius;
  array[at + 6] = (zx * py - zy * px) * radius;
  array[at + 8] = dx;
  array[at + 9] = dy;
  array[at + 10] = dz;
  array[at + 12] = (a[0] + b[0]) / 2;
  array[at + 13] = (a[1] + b[1]) / 2;
  array[at + 14] = (a[2] + b[2]) / 2;
  array[at + 15] = 1;
}

function ball(
  array: ArrayLike<number> & { [i: number]: number },
  i: number,
  at: Read3,
  radius: number,
): void {
  const first = 16 * i;
  for (let k = 0; k < 16; k++) array[first + k] = 0;
  array[first] = array[first + 5] = array[first + 10] = radius;
  array[first + 12] = at[0];
  array[first + 13] = at[1];
  array[first + 14] = at[2];
  array[first + 15] = 1;
}
