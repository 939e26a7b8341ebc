import assert from "node:assert/strict";
import { test } from "node:test";
import type { Environment, Hover, Strip, TrackedObject } from "../messages";
import { Polyline } from "../geometry/polyline";
import { emptyPerson, emptySite, standingOf } from "../site/site";
import { Frame, grown, scaleBar } from "./frame";
import { Lanes } from "./lanes";
import { facing } from "./people";
import { edges, paths } from "./runs";
import { lampRows, objectRows, peopleRows, robotRows, shortNames } from "./sentences";
import { pointedPosition } from "./pointed_position";

const STRIP: Strip = {
  id: "0",
  line_m: [
    [0, 0, 1],
    [2, 0, 1],
  ],
  direction: 1,
  pixels: 4,
};

function room(parts: Partial<Environment> = {}): Environment {
  return {
    stamp_ns: 0,
    seq: 0,
    name: "room",
    lamps: [],
    strips: [],
    belts: [],
    links: [],
    bays: [],
    boxes: [],
    planes: [],
    cylinders: [],
    spheres: [],
    clouds: [],
    fences: [],
    frames: [],
    things: [],
    paced_from: [],
    ...parts,
  };
}

function thing(parts: Partial<TrackedObject> = {}): TrackedObject {
  return {
    id: "x-1",
    kind: "red",
    position_m: [0, 0, 1],
    velocity_mps: [0, 0, 0],
    length_m: 0.4,
    surface: "belt",
    surface_id: "a",
    surface_position_m: 1,
    surface_speed_mps: 0,
    bay: "",
    bay_until_ns: null,
    yaw_rad: null,
    position_sigma_m: null,
    size_m: null,
    mode: "claim",
    press: false,
    dwell_s: null,
    lit: false,
    ...parts,
  };
}

test("neighbours of one colour are one stroke, pixels that are off none", () => {
  const at = edges(STRIP, new Polyline(STRIP.line_m));
  assert.deepEqual(at, ["0 0", "50 0", "100 0", "150 0", "200 0"]);
  const found = paths(new Uint8Array([255, 0, 0, 255, 0, 0, 0, 0, 0, 0, 0, 255]), at);
  assert.deepEqual(
    [...found],
    [
      ["#ff0000", "M0 0L50 0L100 0"],
      ["#0000ff", "M150 0L200 0"],
    ],
  );
});

test("strokes of one colour that are apart share a path", () => {
  const found = paths(new Uint8Array([255, 0, 0, 0, 0, 0, 255, 0, 0, 0, 0, 0]), ["a", "b", "c", "d", "e"]);
  assert.deepEqual([...found], [["#ff0000", "MaLbMcLd"]]);
});

test("a strip laid backwards has pixel 0 at its line's end, and dim pixels are still seen", () => {
  const at = edges({ ...STRIP, direction: -1 }, new Polyline(STRIP.line_m));
  assert.deepEqual([at[0], at[4]], ["200 0", "0 0"]);
  assert.equal(paths(new Uint8Array([3, 0, 0]), ["a", "b"]).size, 1);
});

test("what is under the pointer of a zooming hand stays there", () => {
  const frame = new Frame();
  [frame.width, frame.height] = [800, 600];
  frame.fit({ low: [-2, -1, 0], high: [6, 3, 2] }, 40);
  assert.deepEqual([frame.x, frame.y], [2, 1]);
  assert.equal(frame.scale, 90);
  const before = frame.toWorld(100, 50);
  frame.zoom(2.5, 100, 50);
  frame.toWorld(100, 50).forEach((value, i) => assert.ok(Math.abs(value - before[i]!) < 1e-9));
  const [px, py] = frame.toScreen(...before);
  assert.ok(Math.abs(px - 100) < 1e-6 && Math.abs(py - 50) < 1e-6);
  frame.zoom(1e9, 0, 0);
  assert.equal(frame.scale, Frame.MOST);
});

test("people who stand outside the map are shown too", () => {
  assert.deepEqual(
    grown({ low: [0, 0, 0], high: [2, 2, 2] }, [
      [-1, 1, 0],
      [1, 3, 0],
    ]),
    { low: [-1, 0, 0], high: [2, 3, 2] },
  );
});

test("the scale's bar is a round length", () => {
  assert.equal(scaleBar(100), 1);
  assert.equal(scaleBar(1500), 0.05);
});

test("pointing means the place with the height of what is there", () => {
  const map = room({
    lamps: [{ id: "l", position_m: [5, 5, 2] }],
    strips: [STRIP],
    belts: [
      {
        id: "a",
        line_m: [
          [0, 3, 1],
          [2, 3, 2],
        ],
        width_m: 0.5,
      },
    ],
    boxes: [{ id: "b", center_m: [8, 0, 0.5], size_m: [2, 1, 1], yaw_rad: Math.PI / 2 }],
    cylinders: [{ id: "c", center_m: [12, 0, 0], radius_m: 0.5, height_m: 1.5 }],
    spheres: [{ id: "s", center_m: [15, 0, 1], radius_m: 1 }],
  });
  const lanes = new Lanes(map);
  const at = (x: number, y: number) => pointedPosition(map, lanes, [], x, y, 0.1);
  assert.deepEqual(at(5.05, 5.05), [5, 5, 2]);
  assert.deepEqual(at(1, 0.08), [1, 0, 1]);
  assert.deepEqual(at(1, 3.2), [1, 3.2, 1.5]);
  assert.deepEqual(at(1, 3.3), [1, 3.3, 0]);
  assert.deepEqual(at(8.4, 0.9), [8.4, 0.9, 1]);
  assert.deepEqual(at(8.9, 0), [8.9, 0, 0]);
  assert.deepEqual(at(12.4, 0), [12.4, 0, 1.5]);
  assert.deepEqual(at(15, 0), [15, 0, 2]);
  const package_ = {
    at: [1, 3, 1.7] as [number, number, number],
    heading: Math.PI / 2,
    halfLength: 0.3,
    halfBreadth: 0.1,
  };
  assert.deepEqual(pointedPosition(map, lanes, [package_], 1.05, 3.25, 0.1), [1.05, 3.25, 1.7]);
  const edge = room({
    strips: [STRIP],
    belts: [
      {
        id: "a",
        line_m: [
          [0, 0.25, 2],
          [2, 0.25, 2],
        ],
        width_m: 0.5,
      },
    ],
  });
  assert.deepEqual(pointedPosition(edge, new Lanes(edge), [], 1, 0.04, 0.1), [1, 0, 1]);
  assert.deepEqual(pointedPosition(edge, new Lanes(edge), [], 1, 0.06, 0.1), [1, 0.06, 2]);
  assert.deepEqual(pointedPosition(null, new Lanes(null), [], 1, 2, 0.1), [1, 2, 0]);
});

test("objects are drawn where they are now, not where they were told to be", () => {
  const lanes = new Lanes(
    room({
      belts: [
        {
          id: "a",
          line_m: [
            [0, 0, 1],
            [1, 0, 1],
            [1, 5, 1],
          ],
          width_m: 0.5,
        },
      ],
    }),
  );
  const { at, heading } = lanes.placed(thing({ surface_position_m: 1.9, surface_speed_mps: 1 }), 0, 2e8);
  assert.ok(Math.abs(at[0] - 1) < 1e-9 && Math.abs(at[1] - 1.1) < 1e-9);
  assert.ok(Math.abs(heading - Math.PI / 2) < 1e-9);
});

test("people face where they point, as long as they are heard", () => {
  const person = emptyPerson("ada");
  person.pose = { yaw_rad: 1 } as never;
  person.cursor = { direction: [0, 1, 0] } as never;
  assert.equal(facing(person, true), Math.PI / 2);
  assert.equal(facing(person, false), 1);
});

test("who has no pose stands where they are taken to stand, if anybody knows", () => {
  const person = emptyPerson("ada");
  assert.equal(standingOf(person), null);
  person.line = { assumed: { position_m: [1, 2, 0], yaw_rad: 0.5 } } as never;
  assert.deepEqual(standingOf(person), { position_m: [1, 2, 0], yaw_rad: 0.5, isAssumed: true });
  assert.equal(facing(person, false), 0.5);
  person.pose = { position_m: [3, 4, 0], yaw_rad: 1 } as never;
  assert.deepEqual(standingOf(person), { position_m: [3, 4, 0], yaw_rad: 1, isAssumed: false });
});

test("the list tells people, objects and lamps in short lines", () => {
  const site = emptySite();
  site.map = room({ lamps: [{ id: "led_0", position_m: [1, 2, 3] }] });
  const person = emptyPerson("user2");
  site.people.set("user10", emptyPerson("user10"));
  site.people.set("user2", person);
  person.interaction = { state: "pointing" } as never;
  person.line = { assumed: { position_m: [0, 0, 0], yaw_rad: 0 } } as never;
  person.hover = { object_id: "1a-1", progress: 0.456, action: "select" } as Hover;
  site.objects.set("conveyor", {
    stamp_ns: 0,
    seq: 0,
    latency_sigma_s: null,
    objects: [thing({ id: "1a-2", kind: "blue" }), thing({ id: "1a-1", bay: "1", bay_until_ns: 0 })],
  });
  site.selection = {
    stamp_ns: 0,
    seq: 0,
    acts: [],
    undoable: [],
    objects: [{ id: "1a-1", user: "user2", kind: "red", since_ns: 0, confidence: null, is_pending: false }],
    reserved: [{ id: "1a-2", user: "user10", until_ns: 0 }],
    method: null,
    dwell_s: null,
  };
  assert.deepEqual(
    peopleRows(site).map(({ key, text }) => [key, text]),
    [
      ["user2", "pointing; their position is not yet measured; points at red package, select 46 %"],
      ["user10", "nothing heard yet; their position is not known"],
    ],
  );
  assert.deepEqual(
    objectRows(site).map(({ name, text }) => [name, text]),
    [
      ["red package 1", "on belt a at 1.0 m, bound for bay 1, too late to change; selected by user2"],
      ["blue package 2", "on belt a at 1.0 m; user10 is about to select it"],
    ],
  );
  assert.deepEqual(
    lampRows(site).map(({ text, at }) => [text, at]),
    [["dark", [1, 2, 3]]],
  );
});

test("robots are told by their states, and not a second time as tracked objects", () => {
  const site = emptySite();
  const heardAt = performance.now();
  const state = {
    kind: "quadrotor",
    phase: "moving",
    position_m: [1, 2, 0.84],
    target_m: [3, 4, 0.8],
    user: "ada",
    reason: "the fence is in the way",
    battery: 0.5,
  };
  site.robots.set("quad", { name: "quad", state: state as never, plan: null, heardAt });
  site.robots.set("cart", {
    name: "cart",
    state: {
      ...state,
      kind: "ground",
      phase: "idle",
      position_m: [5, 6, 0],
      target_m: null,
      user: "",
      reason: "",
      battery: null,
    } as never,
    plan: null,
    heardAt,
  });
  site.robots.set("silent", {
    name: "silent",
    state: null,
    plan: { line_m: [[0, 0, 0]], user: "" } as never,
    heardAt,
  });
  site.objects.set("robot.quad", {
    objects: [thing({ id: "quad", surface: "none" }), thing({ id: "silent", surface: "none" })],
  } as never);
  assert.deepEqual(
    robotRows(site).map(({ key, text }) => [key, text]),
    [
      ["cart", "nobody steers it · standing · at 5.0, 6.0 m"],
      ["quad", "steered by ada · flying · to 3.0, 4.0 m · 0.8 m up · battery 50 %; the fence is in the way"],
    ],
  );
  assert.deepEqual(
    objectRows(site).map(({ key }) => key),
    ["silent"],
  );
});

test("ids are shortened only where they stay apart", () => {
  assert.deepEqual([...shortNames(["a-1", "a-2"]).values()], ["1", "2"]);
  assert.deepEqual([...shortNames(["a-1", "b-1"]).values()], ["a-1", "b-1"]);
});
