import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { fromAngles } from "../phone/orientation";
import { blobsOf, followed, thresholdOf, type Blob } from "./blobs";
import type { Camera } from "./camera";
import { Capturer } from "./capture";
import { indexOf, stepsOf, wordOf, type Colour } from "./code";
import { gravity } from "./gravity";
import { PATIENCE_MS, Reader, type Verdict } from "./reader";

const WIDTH = 320;
const HEIGHT = 180;

/** Deterministic noise, -1 to 1. */
function noise(seed: number): () => number {
  return () => (seed = (seed * 1103515245 + 12345) & 0x7fffffff) / 0x3fffffff - 1;
}

type Light = readonly [u: number, v: number, colour: Colour];

/** A frame of a grey room with lights of some radius. */
function frame(
  lights: readonly Light[],
  { seed = 1, radius = 1.5, peak = 400, shift = 0 } = {},
): Uint8ClampedArray {
  const random = noise(seed);
  const level = new Float32Array(WIDTH * HEIGHT * 3).map(
    (_, i) => 40 + 20 * (Math.floor(i / 3) % WIDTH > 160 ? 1 : 0) + 4 * random(),
  );
  for (const [u, v, colour] of lights) {
    for (let y = Math.floor(v - 9); y <= v + 9; y++) {
      for (let x = Math.floor(u + shift - 9); x <= u + shift + 9; x++) {
        if (x < 0 || y < 0 || x >= WIDTH || y >= HEIGHT) continue;
        const light =
          peak * Math.exp(-((x + 0.5 - u - shift) ** 2 + (y + 0.5 - v) ** 2) / (2 * radius * radius));
        for (let c = 0; c < 3; c++) level[3 * (y * WIDTH + x) + c]! += c === colour ? light : 0.15 * light;
      }
    }
  }
  const pixels = new Uint8ClampedArray(WIDTH * HEIGHT * 4);
  for (let p = 0; p < WIDTH * HEIGHT; p++) for (let c = 0; c < 3; c++) pixels[4 * p + c] = level[3 * p + c]!;
  return pixels;
}

const PLACES: readonly (readonly [number, number])[] = Array.from({ length: 24 }, (_, i) => [
  20.3 + 12 * (i % 12),
  50.7 + 60 * Math.floor(i / 12),
]);

test("every light's colours give its number back", () => {
  for (const count of [1, 2, 3, 24, 220, 700]) {
    for (let index = 0; index < count; index++) assert.equal(indexOf(wordOf(index, count), count), index);
  }
  assert.deepEqual(wordOf(5, 24), [0, 1, 2, 0, 2, 0, 2, 0, 1]);
});

test("a wrong colour, an unknown one and one that did not change are no number, or the right one", () => {
  const count = 220;
  let wrong = 0;
  for (let index = 0; index < count; index++) {
    for (let step = 2; step < stepsOf(count); step++) {
      for (const turn of [1, 2]) {
        const word: (Colour | null)[] = wordOf(index, count);
        word[step] = ((word[step]! + turn) % 3) as Colour;
        const found = indexOf(word, count);
        if (found !== null && found !== index) wrong++;
      }
    }
    const hidden: (Colour | null)[] = wordOf(index, count);
    hidden[4] = null;
    assert.equal(indexOf(hidden, count), null);
  }
  assert.ok(wrong < 0.05 * count * (stepsOf(count) - 2) * 2, `${wrong}`);
});

test("spots are found to a tenth of a pixel in noise, and no others", () => {
  const dark = frame([], { seed: 5 });
  const threshold = thresholdOf(dark, frame([], { seed: 9 }));
  const lights = PLACES.map(([u, v], i) => [u, v, (i % 3) as Colour] as const);
  const blobs = blobsOf(frame(lights, { seed: 2 }), dark, WIDTH, HEIGHT, threshold)!;
  assert.equal(blobs.length, lights.length);
  for (const [u, v, colour] of lights) {
    const blob = blobs.find((each) => Math.hypot(each.u - u, each.v - v) < 0.2);
    assert.equal(blob?.colour, colour);
  }
});

test("spots are followed when all move together, and two that run into each other are lost", () => {
  const places = PLACES.map(([u, v]) => ({ u, v }));
  const moved: Blob[] = places.map(({ u, v }) => ({ u: u + 3.4, v: v - 2.1, area: 9, colour: 0 }));
  moved[1] = moved[0]!;
  const shift = { u: 0, v: 0 };
  const found = followed(places, moved, shift, 5);
  assert.ok(Math.abs(shift.u - 3.4) < 1e-9 && Math.abs(shift.v + 2.1) < 1e-9);
  assert.deepEqual(found.slice(1), [null, ...moved.slice(2)]);
});

interface World {
  /** Frames after a step until the lights show it. */
  delay?: number;
  radius?: number;
  peak?: number;
  /** Movement from step to step, pixels. */
  drift?: number;
  /** Colour that each colour is shown as. */
  order?: readonly Colour[];
  /** Lights hidden from a step on. */
  hidden?: { from: number; share: number };
  isDark?: boolean;
  /** Frames by which the first light changes later than the others, and the reader's patience for it, ms. */
  slow?: { frames: number; ms: number };
  /** Lights are dark in some frames, others in each, as those that a slow PWM dims. */
  flickers?: boolean;
}

/** Read a view of `PLACES`. */
function read({
  delay = 2,
  radius = 1.2,
  peak = 200,
  drift = 0.3,
  order = [0, 1, 2],
  hidden,
  isDark = false,
  slow = { frames: 0, ms: 0 },
  flickers = false,
}: World): Verdict {
  const reader = new Reader(PLACES.length, WIDTH, slow.ms);
  const dark = frame([]);
  const threshold = thresholdOf(dark, frame([], { seed: 3 }));
  let [shown, since, slowShown] = [-1, 0, -1];
  for (let n = 0; n < 2000; n++) {
    if (since++ >= delay) shown = reader.step;
    if (since > delay + slow.frames) slowShown = reader.step;
    const lights = isDark
      ? []
      : PLACES.flatMap(([u, v], i) => {
          const at = i ? shown : slowShown;
          return at < 0 ||
            (hidden && at >= hidden.from && i < hidden.share * PLACES.length) ||
            (flickers && at > 1 && (i + n) % 4 === 0)
            ? []
            : [[u, v, order[wordOf(i, PLACES.length)[at]!]!] as Light];
        });
    const blobs = blobsOf(
      frame(lights, { seed: 100 + n, radius, peak, shift: drift * Math.max(0, shown) }),
      dark,
      WIDTH,
      HEIGHT,
      threshold,
    );
    const verdict = reader.take(blobs, since * 100);
    if (verdict.kind === "show") since = 0;
    else if (verdict.kind !== "wait") return verdict;
    assert.ok(since * 100 < 2 * PATIENCE_MS);
  }
  throw new Error("no end");
}

for (const delay of [0, 1, 7]) {
  test(`a view is read whatever the delay of the lights: ${delay} frames`, () => {
    const verdict = read({ delay });
    assert.equal(verdict.kind, "done");
    if (verdict.kind !== "done") return;
    assert.equal(verdict.seen.length, PLACES.length);
    for (const { index, u, v } of verdict.seen) {
      assert.ok(Math.hypot(u - PLACES[index]![0], v - PLACES[index]![1]) < 0.4, `${index} at ${u}, ${v}`);
    }
  });
}

test("lights that vanish on the way are left out, and the others have their numbers", () => {
  const verdict = read({ hidden: { from: 3, share: 0.25 } });
  assert.equal(verdict.kind, "done");
  if (verdict.kind === "done")
    assert.deepEqual(
      verdict.seen.map(({ index }) => index),
      Array.from({ length: 18 }, (_, i) => 6 + i),
    );
});

test("a lamp that changes later than the strips is read, too", () => {
  const verdict = read({ slow: { frames: 6, ms: 1000 } });
  assert.equal(verdict.kind === "done" ? verdict.seen.length : verdict, PLACES.length);
});

test("lights that flicker are read all the same", () => {
  const verdict = read({ flickers: true });
  assert.equal(verdict.kind === "done" ? verdict.seen.length : verdict, PLACES.length);
});

for (const [trouble, world] of [
  ["nothing", { isDark: true }],
  ["moved", { drift: 3 }],
  ["bloom", { radius: 2.6, peak: 3000 }],
  ["faint", { radius: 0.5, peak: 120 }],
  ["lost", { hidden: { from: 4, share: 0.8 } }],
  ["colours", { order: [1, 0, 2] }],
  ["colours", { order: [0, 2, 1] }],
] as const) {
  test(`what hinders a view is known: ${trouble}`, () => {
    const verdict = read(world);
    assert.equal(verdict.kind === "trouble" ? verdict.trouble : verdict.kind, trouble);
  });
}

test("a phone that turns away, or shakes, ends its view in a sentence and tries no other brightness", async () => {
  for (const [away, says] of [
    [() => [], /the camera turned away/],
    [(blobs: Blob[]) => blobs.map((blob) => ({ ...blob, u: blob.u + 3 })), /The phone moved/],
  ] as const) {
    let [now, shown, far, darks] = [0, -1, 0, 0];
    mock.method(globalThis, "setTimeout", (done: () => void) => queueMicrotask(done));
    mock.method(performance, "now", () => now);
    const camera = {
      isLive: true,
      hold: async () => undefined,
      still: async () => ({}),
      look: async (as: string) => {
        now += 100;
        const blobs = PLACES.map(([u, v], i) => ({
          u: u + 3 * far,
          v,
          area: 9,
          colour: wordOf(i, PLACES.length)[shown]!,
        }));
        if (shown > 2) far++;
        return {
          width: WIDTH,
          height: HEIGHT,
          blobs: as === "dark" || shown < 0 ? [] : shown > 2 ? away(blobs) : blobs,
        };
      },
    } as unknown as Camera;
    const lights = { show: async (step: number) => void (darks += (shown = step) < 0 ? 1 : 0) };
    await assert.rejects(
      new Capturer(camera, lights).take(PLACES.length, () => undefined),
      says,
    );
    assert.equal(darks, 1);
    mock.restoreAll();
  }
});

test("a picture full of spots is no view", () => {
  const reader = new Reader(24, WIDTH);
  assert.equal(reader.take(null, 10).kind, "wait");
  for (let i = 0; i < 5; i++) assert.equal(reader.take(null, PATIENCE_MS + 1).kind, "wait");
  assert.deepEqual(reader.take(null, PATIENCE_MS + 1), { kind: "trouble", trouble: "crowd" });
});

test("gravity is down in the picture, however the phone is held", () => {
  const near = (found: readonly number[], wanted: readonly number[]) =>
    found.forEach((value, i) => assert.ok(Math.abs(value - wanted[i]!) < 1e-9, `${found}`));
  near(gravity(fromAngles(30, 90, 0), 0), [0, 1, 0]); // upright
  near(gravity(fromAngles(30, 0, 0), 0), [0, 0, 1]); // flat on a table: the camera looks down
  near(gravity(fromAngles(70, 0, -90), 90), [0, 1, 0]); // on its left side, the picture turned with it
  near(gravity(fromAngles(0, 60, 0), 0), [0, Math.sin(Math.PI / 3), 0.5]); // leaning back: it looks down
});
