/** Eyes, hand and thumbstick of a headset's wearer, as the input of an arm. */

import type { Alignment } from "../geometry/alignment";
import type { Vec3 } from "../geometry/vec";
import type { Arm } from "../view";

/** Minimum time between two messages, ms: nearly every frame of a headset with 120 a second. */
const LEAST_MS = 8;
/** Time for which a hand stays where it was tracked last, ms. Then the arm hangs. */
const LOST_MS = 400;
/** Longest time for which a press holds the tip, ms: a hand that is lost in a pinch may never release it. */
const HELD_MS = 1500;
/** Deflections of a thumbstick from which it steps, and below which it may step again. */
const STEP_AT = 0.7;
const REST_AT = 0.3;
/** Indices of the axes of a thumbstick from left to right and from up to down (WebXR Gamepads, `xr-standard`). */
const STICK_AXES = [2, 3] as const;

export class HeadsetInput {
  /** The hand that points. */
  hand: XRHandedness = "right";
  private sentAt = -Infinity;
  private tip: Vec3 | null = null;
  private trackedAt = -Infinity;
  private isDeflected = false;

  constructor(private readonly arm: Arm) {}

  /**
   * Send where the wearer points now, ms.
   *
   * @param presses buttons that are down, each with the position of the tip before, which counts: pinching moves the finger
   * @param eyes position of the eyes in the session's space, levelled
   * @param tipOf returns the same of the tip of a hand or controller, null if it is not tracked
   */
  update(
    now: number,
    sources: Iterable<XRInputSource>,
    presses: ReadonlyMap<XRInputSource, { readonly at: Vec3 | null; readonly since: number }>,
    eyes: Vec3,
    tipOf: (source: XRInputSource) => Vec3 | null,
    { yaw, origin }: Alignment,
  ): void {
    if (!this.arm.pointing) return;
    const source = [...sources].find(({ handedness }) => handedness === this.hand);
    const press = source && presses.get(source);
    const held = press && now - press.since < HELD_MS ? press.at : null;
    const tip = held ?? (source ? tipOf(source) : null);
    if (tip || now - this.trackedAt > LOST_MS) this.tip = tip;
    if (tip) this.trackedAt = now;
    this.steer(...(STICK_AXES.map((axis) => source?.gamepad?.axes[axis] ?? 0) as [number, number]));
    if (now - this.sentAt < LEAST_MS) return;
    this.sentAt = now;
    this.arm.move({ alignment: { yaw_rad: yaw, origin_m: [...origin] }, eyes_m: eyes, tip_m: this.tip });
  }

  /** Step once for each deflection. */
  private steer(right: number, down: number): void {
    const isAcross = Math.abs(right) >= Math.abs(down);
    const deflection = isAcross ? right : down;
    if (Math.abs(deflection) < REST_AT) this.isDeflected = false;
    if (this.isDeflected || Math.abs(deflection) <= STEP_AT) return;
    this.isDeflected = true;
    void this.arm.step(deflection < 0 ? -1 : 1, isAcross ? "beside" : "row");
  }
}
