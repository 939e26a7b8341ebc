/** A person's body from their measures, and their arm: the finger lies on the ray. */

import type { BodyMeasures } from "../messages";
import { add, dot, norm, scale, subtract, turn, unit, type Read3, type Vec3 } from "./vec";

/** Default body measures (as in `schemas`): eyes at 1.64 m. */
export const DEFAULT_BODY: BodyMeasures = {
  footprint_to_neck_m: 1.43,
  neck_to_eyes_m: 0.21,
  neck_to_shoulder_m: 0,
  shoulder_to_wrist_m: 0.55,
  wrist_to_finger_m: 0.18,
};
export type Hand = "left" | "right";

/** Of the length from shoulder to wrist (Drillis and Contini 1966). */
const UPPER_ARM_SHARE = 0.56;
/** The pointing model may have the shoulder in the midst of the neck, which looks wrong. */
const LEAST_SHOULDER_M = 0.18;
/** Shoulders lie lower than the neck's root. */
const SHOULDER_DROP_M = 0.07;
/** A pointing arm is not quite straight. */
const STRETCHED = 0.97;

/** Places of an arm in {W}. */
export interface Arm {
  shoulder: Vec3;
  elbow: Vec3;
  wrist: Vec3;
  finger: Vec3;
}

/** The eyes in {W} of who stands at `feet`; where the pointing model has them. */
export function eyesOf(body: BodyMeasures, feet: Read3): Vec3 {
  return [feet[0], feet[1], feet[2] + body.footprint_to_neck_m + body.neck_to_eyes_m];
}

/** A shoulder in {W}, as it is drawn, of who stands at `feet` and looks along azimuth `facing` (rad). */
export function shoulderOf(body: BodyMeasures, side: Hand, feet: Read3, facing: number): Vec3 {
  const out = Math.max(body.neck_to_shoulder_m, LEAST_SHOULDER_M) * (side === "left" ? 1 : -1);
  return add(feet, turn([0, out, body.footprint_to_neck_m - SHOULDER_DROP_M], facing));
}

/** The place on the ray (`origin`, unit `direction`) that is `reach` m from `center`; nearest where none is. */
export function onRay(origin: Read3, direction: Read3, center: Read3, reach: number): Vec3 {
  const to = subtract(center, origin);
  const half = dot(direction, to);
  const rest = half * half - dot(to, to) + reach * reach;
  return add(origin, scale(direction, Math.max(half + Math.sqrt(Math.max(rest, 0)), 0)));
}

/**
 * The arm that points along a ray: the finger lies on it, the elbow hangs a little.
 *
 * @param origin where the ray begins, {W}: eyes, shoulder or elbow, as the person's model has it
 */
export function pointingArm(
  body: BodyMeasures,
  hand: Hand,
  feet: Read3,
  facing: number,
  origin: Read3,
  direction: Read3,
): Arm {
  const shoulder = shoulderOf(body, hand, feet, facing);
  const length = body.shoulder_to_wrist_m + body.wrist_to_finger_m;
  const finger = onRay(origin, direction, shoulder, length * STRETCHED);
  return bent(body, shoulder, finger, turn([0, hand === "left" ? 0.5 : -0.5, -1], facing));
}

/** The arm that hangs. */
export function hangingArm(body: BodyMeasures, hand: Hand, feet: Read3, facing: number): Arm {
  const shoulder = shoulderOf(body, hand, feet, facing);
  const length = body.shoulder_to_wrist_m + body.wrist_to_finger_m;
  const out = hand === "left" ? 0.06 : -0.06;
  const finger = add(shoulder, turn([0.07, out, -0.985 * length], facing));
  return bent(body, shoulder, finger, turn([-1, 2 * out, 0], facing));
}

/** Elbow and wrist between `shoulder` and `finger`; the elbow lies towards `hint`. A short arm is stretched. */
function bent(body: BodyMeasures, shoulder: Vec3, finger: Vec3, hint: Read3): Arm {
  const upper = UPPER_ARM_SHARE * body.shoulder_to_wrist_m;
  const fore = body.shoulder_to_wrist_m - upper + body.wrist_to_finger_m;
  const reach = subtract(finger, shoulder);
  const apart = Math.max(norm(reach), 1e-6);
  const along = unit(reach);
  const stretch = Math.max(apart / (upper + fore), 1);
  const a = upper * stretch;
  const b = fore * stretch;
  const at = Math.min(Math.max((apart * apart + a * a - b * b) / (2 * apart), -a), a);
  const aside = unit(subtract(hint, scale(along, dot(hint, along))), [0, 0, -1]);
  const elbow = add(add(shoulder, scale(along, at)), scale(aside, Math.sqrt(Math.max(a * a - at * at, 0))));
  const wrist = add(
    elbow,
    scale(subtract(finger, elbow), 1 - (body.wrist_to_finger_m * stretch) / Math.max(b, 1e-6)),
  );
  return { shoulder, elbow, wrist, finger };
}
