import assert from "node:assert/strict";
import { test } from "node:test";
import type { Vec3 } from "../geometry/vec";
import type { Arm } from "../view";
import { HeadsetInput } from "./headset_input";

test("a pinch does not move the ray, and every frame of a fast headset is sent", () => {
  const tips: (Vec3 | null | undefined)[] = [];
  const arm = {
    pointing: "ada",
    move: ({ tip_m }: { tip_m?: Vec3 | null }) => tips.push(tip_m),
  } as unknown as Arm;
  const input = new HeadsetInput(arm);
  const hand = { handedness: "right" } as XRInputSource;
  const presses = new Map<XRInputSource, { at: Vec3 | null; since: number }>();
  let tip: Vec3 | null = [0.5, 0, 1.5];
  let now = 0;
  const frame = (): void =>
    input.update((now += 1000 / 90), [hand], presses, [0, 0, 1.6], () => tip, { yaw: 0, origin: [0, 0, 0] });
  frame();
  presses.set(hand, { at: [0.5, 0, 1.5], since: now });
  tip = [0.48, 0.04, 1.47];
  frame();
  presses.set(hand, { at: null, since: now }); // it was not tracked then
  frame();
  presses.set(hand, { at: [0.5, 0, 1.5], since: now - 2000 }); // its release was never seen
  frame();
  presses.clear();
  tip = null;
  frame();
  assert.deepEqual(tips, [
    [0.5, 0, 1.5],
    [0.5, 0, 1.5],
    [0.48, 0.04, 1.47],
    [0.48, 0.04, 1.47],
    [0.48, 0.04, 1.47],
  ]);
});

test("a thumbstick steps once for each deflection, beside or to the row above or below", () => {
  const steps: unknown[] = [];
  const axes = [0, 0, 0, 0];
  const input = new HeadsetInput({
    pointing: "ada",
    move() {},
    step: (...step: unknown[]) => steps.push(step),
  } as unknown as Arm);
  const hand = { handedness: "right", gamepad: { axes } } as unknown as XRInputSource;
  for (const [right, down] of [
    [0.9, 0.2],
    [1, 0.3],
    [0, 0],
    [0.3, -0.8],
    [0.1, -0.5],
    [0.1, 0.9],
    [0, 0],
    [-0.2, 0.9],
  ] as const) {
    axes.splice(2, 2, right, down);
    input.update(0, [hand], new Map(), [0, 0, 1.6], () => null, { yaw: 0, origin: [0, 0, 0] });
  }
  assert.deepEqual(steps, [
    [1, "beside"],
    [-1, "row"],
    [1, "row"],
  ]);
});
