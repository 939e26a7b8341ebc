// Expected numbers marked "led-driver" or "sim.aim" come from a run of the Python of that name.
import assert from "node:assert/strict";
import { test } from "node:test";
import type { Environment, TrackedObject } from "../messages";
import { DEFAULT_BODY, eyesOf, hangingArm, onRay, pointingArm } from "./body";
import { aimsOf, boundsOf, pointsOf } from "./bounds";
import { ellipseOf } from "./ellipse";
import { framed, NO_EDGES } from "./framing";
import { contrast, cssColor, FREE_RAY_M, inkOn, kindColor, kindLetter, rayEnd, sizeOf } from "./appearance";
import { carriedOn, elapsed, LONGEST_S, type Placed } from "./motion";
import { layOut } from "./pixels";
import { placed } from "./placing";
import { Polyline } from "./polyline";
import { outline, ribbon } from "./ribbon";
import { cross, dot, norm, subtract, unit, wrapped, type Read3, type Vec3 } from "./vec";

function close(found: ArrayLike<number>, expected: readonly number[], within = 1e-9): void {
  assert.equal(found.length, expected.length);
  expected.forEach((x, i) => assert.ok(Math.abs(found[i]! - x) <= within, `${i}: ${found[i]} is not ${x}`));
}
const BENT: Vec3[] = [
  [0, 0, 1],
  [1, 0, 1],
  [1, 2, 1.5],
];
const STRIPS = [
  { id: "fwd", line_m: BENT, pixels: 7, direction: 1 as const },
  {
    id: "rev",
    line_m: [
      [4.85, -1.425, 0.9],
      [4.85, 3.575, 0.9],
    ] as Vec3[],
    pixels: 150,
    direction: -1 as const,
  },
  {
    id: "rep",
    line_m: [
      [0, 0, 0],
      [0, 0, 0],
      [0, 0.3, 0],
    ] as Vec3[],
    pixels: 3,
    direction: -1 as const,
  },
];

test("a polyline is addressed by arc length and clamped, or goes on (led-driver)", () => {
  const line = new Polyline(BENT);
  close([line.length], [3.0615528128088303]);
  close(line.pointAt(1.5), [1, 0.48507125007266594, 1.1212678125181665]);
  close(line.tangentAt(1), [0, 0.9701425001453319, 0.24253562503633297]);
  close(line.pointAt(99), [1, 2, 1.5]);
  close(line.pointAt(-0.5), [0, 0, 1]);
  close(line.pointAt(-0.5, true), [-0.5, 0, 1]);
  const near = line.nearestTo([1.2, 0.7, 1]);
  close([near.at, near.apart], [1.6790997, 0.26234239], 1e-7);
  assert.throws(
    () =>
      new Polyline([
        [1, 1, 1],
        [1, 1, 1],
      ]),
    /different/,
  );
});

test("a thing lies along the chord of a curve", () => {
  const line = new Polyline([
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
  ]);
  close(
    [line.headingAt(0.5, 0.4), line.headingAt(1, 0.4), line.headingAt(1.5, 0.4)],
    [0, Math.PI / 4, Math.PI / 2],
  );
});

test("pixels sit where led-driver draws them", () => {
  const laid = layOut(STRIPS);
  const place = (pixel: number) => laid.places.subarray(3 * pixel, 3 * pixel + 3);
  assert.equal(laid.count, 160);
  close(place(0), [0.2186823437720593, 0, 1], 1e-6);
  close(place(2), [1, 0.09062267847800093, 1.0226556696195002], 1e-6);
  close(place(6), [1, 1.7878469642753332, 1.4469617410688334], 1e-6);
  close(place(7), [4.85, 3.5583333333333336, 0.9], 1e-6);
  close(place(156), [4.85, -1.4083333333333334, 0.9], 1e-6);
  close(place(157), [0, 0.25, 0], 1e-6);
  close(place(159), [0, 0.05, 0], 1e-6);
  assert.deepEqual(laid.strips.get("rev")?.first, 7);
  close([laid.strips.get("rev")!.pitch], [1 / 30]);
});

test("pixels of a curved strip of the conveyor sit where led-driver draws them", () => {
  const line: Vec3[] = [
    [2.563, 0.614, 1.066],
    [2.223, 0.614, 1.066],
    [2.113, 0.611, 1.066],
    [2.073, 0.607, 1.066],
    [1.944, 0.588, 1.066],
    [1.8, 0.547, 1.066],
    [1.654, 0.482, 1.066],
    [1.527, 0.403, 1.066],
    [1.411, 0.307, 1.066],
    [1.303, 0.189, 1.066],
    [1.218, 0.065, 1.066],
    [1.147, -0.078, 1.066],
    [1.119, -0.164, 1.066],
    [1.099, -0.22, 1.066],
    [1.07, -0.378, 1.066],
    [1.062, -0.558, 1.066],
    [1.061, -1.452, 1.066],
  ];
  const { places } = layOut([{ id: "17", line_m: line, pixels: 152, direction: 1 }]);
  close(places.subarray(0, 3), [2.55285201, 0.614, 1.066], 1e-6);
  close(places.subarray(225, 228), [1.22267095, 0.07181409, 1.066], 1e-6);
  close(places.subarray(453), [1.06101135, -1.44185202, 1.066], 1e-6);
});

test("strips without a length have no pixels and push nobody aside", () => {
  const laid = layOut([
    {
      id: "no",
      line_m: [
        [0, 0, 0],
        [0, 0, 0],
      ],
      pixels: 5,
      direction: 1,
    },
    STRIPS[2]!,
  ]);
  assert.equal(laid.count, 3);
  assert.equal(laid.strips.has("no"), false);
  close(laid.places.subarray(0, 3), [0, 0.25, 0], 1e-6);
});

test("a ribbon's edges run parallel to the line, mitred at corners, cut off at sharp ones", () => {
  const cuts = ribbon(
    new Polyline([
      [0, 0, 1],
      [2, 0, 1],
      [2, 2, 1],
    ]),
    0.5,
  );
  close(cuts[0]!.left, [0, 0.25, 1]);
  close(cuts[1]!.left, [1.75, 0.25, 1]);
  close(cuts[1]!.right, [2.25, -0.25, 1]);
  close(cuts[2]!.right, [2.25, 2, 1]);
  assert.equal(outline(cuts).length, 6);
  close(outline(cuts)[5]!, [0, -0.25, 1]);
  const sharp = ribbon(
    new Polyline([
      [0, 0, 0],
      [1, 0, 0],
      [0, 0.01, 0],
    ]),
    1,
  )[1]!;
  assert.ok(norm(subtract(sharp.left, sharp.center)) <= 1 + 1e-9);
});

test("the ellipse of a covariance", () => {
  const found = ellipseOf([0.04, 0.01, 0, 0.01, 0.02, 0, 0, 0, 0.1]);
  close([found.major, found.minor], [0.4202006, 0.25185603], 1e-7);
  close([Math.sin(2 * found.angle), Math.cos(2 * found.angle)], [Math.SQRT1_2, Math.SQRT1_2], 1e-9);
  assert.deepEqual(ellipseOf([0, 0, 0, 0, 0, 0, 0, 0, 0]), { major: 0, minor: 0, angle: 0 });
});

test("the finger is where the server's stance has it when the shoulder is the model's own (sim.aim)", () => {
  const eyes: Vec3 = [1, 2, 1.64];
  const shoulder: Vec3 = [1.0591040413322679, 1.8089327021748787, 1.43];
  close(eyesOf(DEFAULT_BODY, [1, 2, 0]), eyes);
  const found = onRay(eyes, unit(subtract([4, 1, 0.9], eyes)), shoulder, 0.73);
  close(found, [1.7854847403659244, 1.7381717532113585, 1.4462470973764052]);
});

test("a pointing arm has its finger on the ray, whatever hand and direction; limbs keep their length", () => {
  for (const hand of ["left", "right"] as const) {
    for (const to of [
      [3, 0, 1],
      [0, 3, 0],
      [-2, 1, 3],
      [0.6, -0.1, 0.2],
    ] as Vec3[]) {
      const eyes = eyesOf(DEFAULT_BODY, [0, 0, 0]);
      const along = unit(subtract(to, eyes));
      const arm = pointingArm(DEFAULT_BODY, hand, [0, 0, 0], Math.atan2(to[1], to[0]), eyes, along);
      const reach = subtract(arm.finger, eyes);
      const off = norm(subtract(reach, along.map((x) => x * dot(reach, along)) as Vec3));
      assert.ok(off < 1e-9, `${off}`);
      close([norm(subtract(arm.elbow, arm.shoulder))], [0.56 * 0.55], 1e-9);
      close([norm(subtract(arm.finger, arm.elbow))], [0.44 * 0.55 + 0.18], 1e-9);
    }
  }
  const hanging = hangingArm(DEFAULT_BODY, "right", [0, 0, 0], 0);
  assert.ok(hanging.finger[2] < hanging.elbow[2] && hanging.elbow[2] < hanging.shoulder[2]);
});

const OBJECT: TrackedObject = {
  id: "a",
  kind: "red",
  bay: "",
  length_m: 0.2,
  position_m: [9, 9, 9],
  velocity_mps: [1, 2, 0],
  surface: "belt",
  surface_id: "b",
  surface_position_m: 0.9,
  surface_speed_mps: 0.5,
  bay_until_ns: null,
  yaw_rad: null,
  position_sigma_m: null,
  size_m: null,
  mode: "claim",
  press: false,
  dwell_s: null,
  lit: false,
};

test("objects are carried on along their surface, around corners and past its end; others straight", () => {
  const line = new Polyline([
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
  ]);
  const out: Placed = { at: [0, 0, 0], heading: 0, along: 0 };
  close(carriedOn(OBJECT, 0.4, line, out).at, [1, 0.1, 1]);
  close([out.along, out.heading], [1.1, Math.PI / 2]);
  close(carriedOn({ ...OBJECT, surface_position_m: 1.95 }, 0.2, line, out).at, [1, 1.05, 1]);
  close(carriedOn({ ...OBJECT, surface: "none" }, 0.5, null, out).at, [9.5, 10, 9]);
  close([out.heading], [Math.atan2(2, 1)]);
  assert.equal(elapsed(1e18, 1e18 + 2e8), 0.2);
  assert.equal(elapsed(1e18, 0), 0);
  assert.equal(elapsed(0, 1e18), LONGEST_S);
});

const EMPTY: Environment = {
  name: "",
  seq: 0,
  stamp_ns: 0,
  bays: [],
  belts: [],
  boxes: [],
  clouds: [],
  fences: [],
  frames: [],
  cylinders: [],
  lamps: [],
  links: [],
  paced_from: [],
  planes: [],
  spheres: [],
  strips: [],
  things: [],
};

test("bounds take in everything with an end, and the floor", () => {
  const found = boundsOf({
    ...EMPTY,
    lamps: [{ id: "l", position_m: [-3, 0, 2] }],
    strips: [STRIPS[1]!],
    planes: [{ id: "p", center_m: [99, 0, 0], normal: [0, 0, 1], size_m: null }],
    cylinders: [{ id: "c", center_m: [0, 7, 0], radius_m: 1, height_m: 3 }],
  });
  close([...found.low, ...found.high], [-3, -1.425, 0, 4.85, 8, 3]);
  assert.deepEqual(boundsOf(EMPTY).low, [-4, -4, 0]);
});

test("a camera shows everything, and touches the picture's edges on two sides", () => {
  const along = unit([0.3, 0.8, -0.5]);
  const fov = 0.7;
  for (const aspect of [0.5, 1.8]) {
    const points: Vec3[] = [
      [-4, -3, 0],
      [4.6, 2, 1],
      [0, 0, 2.5],
      [1, 1, 0],
      [-2, 3, 1],
    ];
    const { position, target } = framed(points, along, fov, aspect, NO_EDGES, 0.1);
    close(unit(subtract(target, position)), along, 1e-9);
    const right = unit(cross(along, [0, 0, 1]));
    const up = cross(right, along);
    const tall = Math.tan(fov / 2) * 0.9;
    const seen = points.map((point) => {
      const from = subtract(point, position);
      const depth = dot(from, along);
      return { x: dot(from, right) / (depth * tall * aspect), y: dot(from, up) / (depth * tall) };
    });
    for (const { x, y } of seen) assert.ok(Math.abs(x) <= 1 + 1e-9 && Math.abs(y) <= 1 + 1e-9, `${x} ${y}`);
    const spans = [seen.map(({ x }) => x), seen.map(({ y }) => y)].map(
      (all) => Math.max(...all) - Math.min(...all),
    );
    close([Math.max(...spans)], [2], 1e-9);
  }
});

test("a camera shows everything between what lies over the picture's top and bottom", () => {
  const points: Vec3[] = [
    [0, 0, 0.4],
    [0.5, 0.1, 0.6],
    [0.2, -1, 0],
    [0.2, -1, 2.1],
  ];
  const along = unit([0.34, 0.8, -0.62]);
  for (const aspect of [0.6, 1, 3]) {
    const { position } = framed(points, along, 0.7, aspect, { top: 0.25, bottom: 0.1 }, 0);
    const up = cross(unit(cross(along, [0, 0, 1])), along);
    const tall = Math.tan(0.35);
    const heights = points.map((point) => {
      const from = subtract(point, position);
      return dot(from, up) / (dot(from, along) * tall);
    });
    assert.ok(Math.max(...heights) <= 0.5 + 1e-9 && Math.min(...heights) >= -0.8 - 1e-9, `${heights}`);
    if (aspect > 1) close([Math.max(...heights), Math.min(...heights)], [0.5, -0.8], 1e-9);
  }
});

test("what people point at counts for the camera, walls and fences do not", () => {
  const hall: Environment = {
    ...EMPTY,
    lamps: [{ id: "a", position_m: [1, 2, 1.5] }],
    planes: [{ id: "wall", center_m: [0, 40, 3], normal: [0, -1, 0], size_m: [80, 6] }],
  };
  assert.deepEqual(aimsOf(hall), [
    [1, 2, 1.5],
    [1, 2, 0],
  ]);
  assert.ok(pointsOf(hall).length > 2);
});

test("kinds have a colour and a letter, patterns go round evenly", () => {
  assert.equal(cssColor(kindColor("red")), "#ff1e00");
  assert.equal(kindColor("no such")[0], 200);
  assert.deepEqual([kindLetter("red"), kindLetter(""), kindLetter("  über")], ["R", "", "Ü"]);
  close([wrapped((3 * Math.PI) / 2), wrapped(-7)], [-Math.PI / 2, -7 + 2 * Math.PI], 1e-9);
  const frozen: Read3 = [1, 2, 3];
  assert.equal(dot(frozen, [1, 1, 1]), 6);
});

test("a ray that meets nothing ends at the floor, or not too far", () => {
  assert.deepEqual(rayEnd([0, 0, 1.5], [0, 0, -1]), [0, 0, 0]);
  assert.deepEqual(rayEnd([0, 0, 1.5], [1, 0, 0]), [FREE_RAY_M, 0, 1.5]);
});

test("what stands on any colour is read: its contrast is 4.5 at least", () => {
  assert.ok(Math.abs(contrast([0, 0, 0], [255, 255, 255]) - 21) < 1e-9);
  assert.ok(Math.abs(contrast([118, 118, 118], [255, 255, 255]) - 4.54) < 0.01); // the lightest grey that white allows
  const inks = { "#000000": [0, 0, 0], "#ffffff": [255, 255, 255] } as const;
  for (let r = 0; r <= 255; r += 17) {
    for (let g = 0; g <= 255; g += 17) {
      for (let b = 0; b <= 255; b += 17) {
        assert.ok(contrast([r, g, b], inks[inkOn([r, g, b])]) >= 4.5, `${r} ${g} ${b}`);
      }
    }
  }
  assert.equal(inkOn(kindColor("blue")), "#ffffff");
  assert.equal(inkOn(kindColor("yellow")), "#000000");
});

test("a package is as long as it says, and neither a needle nor a wardrobe", () => {
  assert.deepEqual(sizeOf({ surface: "belt", length_m: 0.4 }), [0.4, 0.75 * 0.4, 0.6 * 0.4]);
  assert.deepEqual(sizeOf({ surface: "belt", length_m: 3 }), [3, 0.34, 0.26]);
  assert.deepEqual(sizeOf({ surface: "belt", length_m: 0.02 }), [0.02, 0.1, 0.1]);
  assert.deepEqual(sizeOf({ surface: "strip", length_m: 0.3 }), [0.3, 0.07, 0.06]);
  assert.deepEqual(sizeOf({ surface: "none", length_m: 0 }), [0.3, 0.3, 0.3]);
});

test("labels lie on nothing that is taken, the greater rank first", () => {
  const card = { x: 100, y: 0, width: 400, height: 60 };
  const picture = { width: 1000, height: 1000 };
  const wish = (x: number, y: number, rank = 1) => ({ x, y, width: 60, height: 20, rank });
  const free = placed([wish(50, 200)], [card], picture);
  assert.deepEqual(free, [{ x: 20, y: 180 }]);
  const wishes = [wish(300, 50), wish(310, 200), wish(300, 205, 2), wish(305, 198), wish(300, 200)];
  const found = placed(wishes, [card], picture);
  assert.deepEqual(found[2], { x: 270, y: 185 });
  const all = [card, ...found.map((at) => ({ ...at!, width: 60, height: 20 }))];
  for (const [i, a] of all.entries()) {
    for (const b of all.slice(0, i)) {
      assert.ok(
        a.x >= b.x + b.width || b.x >= a.x + a.width || a.y >= b.y + b.height || b.y >= a.y + a.height,
      );
    }
  }
  assert.ok(found[0]!.y >= 60);
  assert.deepEqual(placed([wish(300, 300)], [{ x: 0, y: 0, width: 1000, height: 1000 }], picture), [null]);
  assert.deepEqual(placed([wish(300, 30, 0)], [card], picture), [null]); // it would be too far from its thing
  assert.deepEqual(placed([wish(5, 205), wish(995, 5)], [], picture), [
    { x: 0, y: 185 },
    { x: 940, y: 0 },
  ]);
});
