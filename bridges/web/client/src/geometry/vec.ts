/** Vectors in {W} (or any right-handed frame, z up), metres; plain arrays, no DOM, no WebGL. */

export type Vec3 = [number, number, number];
export type Read3 = readonly [number, number, number];

export const add = (a: Read3, b: Read3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Read3, b: Read3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Read3, by: number): Vec3 => [a[0] * by, a[1] * by, a[2] * by];
export const dot = (a: Read3, b: Read3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const norm = (a: Read3): number => Math.hypot(a[0], a[1], a[2]);
export const cross = (a: Read3, b: Read3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** `a` made one metre long; `otherwise` where it has no length. */
export function unit(a: Read3, otherwise: Read3 = [1, 0, 0]): Vec3 {
  const length = norm(a);
  return length > 1e-12 ? scale(a, 1 / length) : [...otherwise];
}

/** `a` turned about z by `yaw` rad. */
export function turn(a: Read3, yaw: number): Vec3 {
  const c = Math.cos(yaw);
  const s = Math.sin(yaw);
  return [c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]];
}

/** Angle `a` rad brought to -pi … pi. */
export const wrapped = (a: number): number => a - 2 * Math.PI * Math.round(a / (2 * Math.PI));
