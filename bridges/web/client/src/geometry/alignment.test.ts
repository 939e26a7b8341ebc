import assert from "node:assert/strict";
import { test } from "node:test";
import { NOTHING } from "../scene/world";
import type { Environment } from "../messages";
import {
  alignmentFrom,
  assess,
  canAlign,
  headingOf,
  landmarksOf,
  leveled,
  mapped,
  reoriented,
  type Alignment,
  type Touch,
} from "./alignment";
import { add, norm, subtract, turn, wrapped, type Vec3 } from "./vec";

const TRUTH: Alignment = { yaw: 2.1, origin: [1.5, -0.7, 0.04] };
const MARKS: readonly (readonly [string, Vec3])[] = [
  ["door", [0, 2.6, 2]],
  ["desk", [-1.6, -1.2, 0.7]],
  ["shelf", [2.4, -1.4, 1.25]],
];

/** Seeded noise, approximately normal with deviation 1. */
function noise(seed: number): () => number {
  let state = seed;
  const uniform = (): number => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
  return () => Array.from({ length: 12 }, uniform).reduce((sum, each) => sum + each, -6);
}

function touchesOf(marks = MARKS, error = (): number => 0, order = marks.map((_, i) => i)): Touch[] {
  return marks.map(([name, at], i) => {
    const touched = turn(subtract(marks[order[i]!]![1], TRUTH.origin), -TRUTH.yaw);
    return { name, at, touched: touched.map((each) => each + error()) as Vec3 };
  });
}

test("exact touches give the exact alignment, whatever the number of positions", () => {
  for (const count of [2, 3]) {
    const { alignment, residual_m, fault } = assess(touchesOf(MARKS.slice(0, count)));
    assert.ok(
      Math.abs(wrapped(alignment.yaw - TRUTH.yaw)) < 1e-12 &&
        norm(subtract(alignment.origin, TRUTH.origin)) < 1e-12,
    );
    assert.ok(residual_m < 1e-12);
    assert.equal(fault, "");
  }
});

test("three touches with 1 cm of noise align within 3 cm in 95 % of cases, and the residual tells their size", () => {
  const error = noise(7);
  const away: number[] = [];
  let squares = 0;
  for (let run = 0; run < 400; run++) {
    const { alignment, residual_m } = assess(touchesOf(MARKS, () => 0.01 * error()));
    for (const at of [...MARKS.map(([, each]) => each), [1.5, 1.5, 0.5] as Vec3]) {
      away.push(norm(subtract(mapped(alignment, turn(subtract(at, TRUTH.origin), -TRUTH.yaw)), at)));
    }
    squares += residual_m ** 2;
  }
  assert.ok(away.sort((a, b) => a - b)[Math.floor(0.95 * away.length)]! < 0.03);
  assert.ok(Math.abs(Math.sqrt(squares / 400) - 0.01 * Math.sqrt(3)) < 0.002);
});

test("every swap of three positions is reported with the names", () => {
  for (const order of [
    [1, 0, 2],
    [2, 1, 0],
    [0, 2, 1],
    [1, 2, 0],
    [2, 0, 1],
  ]) {
    const names = MARKS.filter((_, i) => order[i] !== i)
      .map(([name]) => name)
      .join(" and ");
    assert.equal(
      assess(touchesOf(MARKS, () => 0, order)).fault,
      `You have probably swapped ${names}: touch them again.`,
    );
  }
});

test("two positions of one height, and three on a line, cannot show a swap of the outer ones, which is said", () => {
  const level: (readonly [string, Vec3])[] = [
    ["a", [0, 0, 1]],
    ["b", [3, 0, 1]],
  ];
  for (const marks of [level, [...level, ["c", [1.5, 0, 1]] satisfies [string, Vec3]]])
    assert.match(assess(touchesOf(marks)).caution, /If you swapped a and b/);
  assert.equal(assess(touchesOf()).caution, "");
});

test("a wrong distance is refused with both distances, and so are positions that are too near", () => {
  const touches = touchesOf();
  const moved = touches.map((each, i): Touch => (i === 2 ? { ...each, at: [3.4, -1.4, 1.25] } : each));
  assert.match(assess(moved).fault, /^\w+ and \w+: \d\.\d\d m between your touches, \d\.\d\d m in the map\./);
  assert.match(
    assess(
      touchesOf([
        ["a", [0, 0, 1]],
        ["b", [0.3, 0.1, 2]],
      ]),
    ).fault,
    /less than 0.5 m apart/,
  );
  assert.notEqual(
    assess(
      touchesOf([
        ["a", [0, 0, 1]],
        ["b", [NaN, 0, 1]],
      ]),
    ).fault,
    "",
  );
});

test("an anchor that moves in the headset's space keeps the alignment of its position", () => {
  const at: Vec3 = [1, 2, 0.5];
  const turned = alignmentFrom(at, 0.4, [3, -1, 0.2], 1.1);
  assert.ok(norm(subtract(mapped(turned, [3, -1, 0.2]), at)) < 1e-12);
  assert.ok(Math.abs(turned.yaw + 0.7) < 1e-12);
  const half = 0.35; // of a turn about y by .7 rad
  assert.ok(Math.abs(headingOf({ x: 0, y: Math.sin(half), z: 0, w: Math.cos(half) }) - 0.7) < 1e-12);
  assert.deepEqual(leveled({ x: 1, y: 2, z: 3 }), [1, -3, 2]);
});

test("a new origin of the headset's space moves nothing", () => {
  const at: Vec3 = [0.5, -2, 0.1];
  const heading = 0.9;
  const point: Vec3 = [1, 2, 3];
  assert.ok(
    norm(
      subtract(mapped(reoriented(TRUTH, at, heading), point), mapped(TRUTH, add(at, turn(point, heading)))),
    ) < 1e-12,
  );
});

test("positions to touch begin with the farthest pair; lamps of things and tracked things are none", () => {
  const lamp = (id: string, position_m: Vec3) => ({ id, position_m });
  const thing = { label: "", lamp: "", is_tracked: false, size_m: [0.2, 0.2, 0.4] };
  const map = {
    ...NOTHING,
    lamps: [
      lamp("led_0", [0, 0, 1]),
      lamp("led_1", [0.5, 0, 1]),
      lamp("far_lamp", [4, 0, 1]),
      lamp("radio_lamp", [9, 9, 1]),
    ],
    things: [
      { ...thing, id: "radio", lamp: "radio_lamp", center_m: [2, 2, 1] },
      { ...thing, id: "parcel", is_tracked: true, center_m: [-9, 0, 1] },
    ],
  } as unknown as Environment;
  const marks = landmarksOf(map);
  assert.deepEqual(
    marks.map(({ name }) => name),
    ["lamp 0", "far lamp", "the middle of the top of radio", "lamp 1"],
  );
  assert.deepEqual(marks[2]!.at, [2, 2, 1.2]);
  assert.ok(canAlign(marks));
  assert.deepEqual(landmarksOf(NOTHING), []);
  assert.deepEqual(
    landmarksOf({ ...map, things: [], lamps: map.lamps.slice(0, 1) }).map(({ name }) => name),
    ["lamp 0"],
  );
  assert.ok(!canAlign(landmarksOf({ ...map, things: [], lamps: map.lamps.slice(0, 1) })));
});

test("a map of two thousand lamps has positions to touch at once", () => {
  const lamps = Array.from({ length: 2000 }, (_, i) => ({
    id: `led_${i}`,
    position_m: [i % 50, Math.floor(i / 50), 1] as Vec3,
  }));
  const marks = landmarksOf({ ...NOTHING, lamps, things: [] } as unknown as Environment);
  assert.deepEqual(
    marks.slice(0, 2).map(({ name }) => name),
    ["lamp 0", "lamp 1999"],
  );
  assert.equal(marks.length, 30);
  assert.ok(canAlign(marks));
});
