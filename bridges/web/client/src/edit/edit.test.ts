import assert from "node:assert/strict";
import { test } from "node:test";
import {
  editsBetween,
  freeName,
  History,
  itemsOf,
  nameProblem,
  numberIn,
  sorted,
  type Item,
  type Items,
} from "./model";
import { scaled, widened, type Picture } from "./picture";
import {
  aboutOrigin,
  distanceTo,
  lengthOf,
  moved,
  outlineOf,
  turned,
  verticesOf,
  withLength,
  withVertices,
  yawOf,
  type Vec,
} from "./shape";
import { level, parallel, snapMove, snapTurn } from "./snap";
import { spreadAlongWalls, unplacedOf } from "./spread";

const ITEMS: Items = itemsOf({
  lamps: { door: { position: [0, 1, 2] } },
  strips: {
    top: {
      line: [
        [0, 0, 1],
        [2, 0, 1],
      ],
      pixels: 120,
      length: 2,
    },
    low: {
      line: [
        [3, 0, 0.5],
        [3, 1, 0.5],
      ],
      pixels: 60,
    },
  },
  planes: { wall: { center: [1, 3, 1.5], normal: [0, -1, 0], size: [4, 3] } },
  boxes: { desk: { center: [5, 1, 0.4], size: [2, 1, 0.8], yaw_deg: 90 } },
  things: { radio: { light: "door" } },
});
const named = (name: string): Item => ITEMS.find((item) => item.name === name)!;
/** `off`: 0.001 where vertices are rounded to a millimetre. */
const near = (found: readonly number[], wanted: readonly number[], off = 1e-6): void =>
  found.forEach((value, i) =>
    assert(Math.abs(value - wanted[i]!) < off, `${found.join(" ")} is not ${wanted.join(" ")}`),
  );
const put = (item: Item): Items => ITEMS.map((other) => (other.id === item.id ? item : other));

test("edits are what differs from the file, by the names there", () => {
  assert.deepEqual(editsBetween(ITEMS, ITEMS), []);
  const top = {
    ...named("top"),
    name: "long",
    value: {
      line: [
        [0, 0, 1],
        [2, 0, 1.5],
      ],
      pixels: 120,
    },
  };
  const lamp: Item = { id: 99, section: "lamps", name: "new", value: { position: [0, 0, 1] } };
  assert.deepEqual(editsBetween(ITEMS, [...put(top).filter(({ name }) => name !== "desk"), lamp]), [
    { op: "rename", section: "strips", name: "top", to: "long" },
    {
      op: "set",
      section: "strips",
      name: "top",
      key: "line",
      value: [
        [0, 0, 1],
        [2, 0, 1.5],
      ],
    },
    { op: "set", section: "strips", name: "top", key: "length", value: null },
    { op: "remove", section: "boxes", name: "desk" },
    { op: "add", section: "lamps", name: "new", value: { position: [0, 0, 1] } },
  ]);
});

test("undo goes back step by step, one gesture at once, and a further edit ends redo", () => {
  const history = new History([]);
  const steps = [1, 2, 3, 4].map((n) => ITEMS.slice(0, n));
  history.put(steps[0]!);
  history.put(steps[1]!, "drag 1");
  history.put(steps[2]!, "drag 1");
  history.undo();
  assert.equal(history.items, steps[0]);
  history.redo();
  assert.equal(history.items, steps[2]);
  history.undo();
  history.put(steps[3]!, "drag 1");
  assert.equal(history.canRedo, false);
  history.undo();
  history.undo();
  history.undo();
  assert.deepEqual([history.items.length, history.canUndo], [0, false]);
});

test("names are free, valid, and of one item of a section", () => {
  assert.equal(nameProblem(ITEMS, named("top"), "top"), "");
  assert.equal(nameProblem(ITEMS, named("top"), "door"), "");
  assert.match(nameProblem(ITEMS, named("top"), "low"), /another one of the name low/);
  for (const bad of ["", "a b", "-a", "ä", "x".repeat(65)])
    assert.match(nameProblem(ITEMS, named("top"), bad), /A name has/);
  assert.equal(
    freeName([...ITEMS, { ...named("top"), id: 50, name: "strip1" }], "strips", "strip"),
    "strip2",
  );
});

test("what is no number, or none that can be, is said", () => {
  const limits = { least: 0.5, most: 9 };
  assert.equal(numberIn(" 1,25 ", limits), 1.25);
  for (const bad of ["", "nan", "1.2.3", "Infinity", "1e999"])
    assert.match(String(numberIn(bad, limits)), /Write a number, such as/);
  assert.match(String(numberIn("10", limits)), /from 0.5 to 9/);
  assert.match(String(numberIn("1.5", { ...limits, isWhole: true })), /whole/);
});

test("findings are at the entry and key that they name, with the longest name", () => {
  const items: Items = [...ITEMS, { ...named("top"), id: 70, name: "top.x" }];
  const finding = (where: string) => ({ severity: "error" as const, where, text: where });
  const found = sorted(
    [
      "strips.top",
      "strips.top.pixels",
      "strips.top.line.0",
      "strips.top.x.pixels",
      "lamps",
      "strips.topmost",
    ].map(finding),
    items,
  );
  assert.deepEqual(
    [...found.of(named("top"))].map(([key, all]) => [key, all.map(({ where }) => where)]),
    [
      ["", ["strips.top"]],
      ["pixels", ["strips.top.pixels"]],
      ["line", ["strips.top.line.0"]],
    ],
  );
  assert.deepEqual([...found.of(items.at(-1)!).keys()], ["pixels"]);
  assert.deepEqual(
    found.rest.map(({ where }) => where),
    ["lamps", "strips.topmost"],
  );
});

test("a strip is moved, turned about its middle, stretched from its first end, and its stated length follows", () => {
  near(verticesOf(moved(named("top"), 0.5, -1, 0.25)).flat(), [0.5, -1, 1.25, 2.5, -1, 1.25]);
  near(verticesOf(turned(named("top"), Math.PI / 2)).flat(), [1, -1, 1, 1, 1, 1]);
  const longer = withLength(named("top"), 2.5);
  near(verticesOf(longer).flat(), [0, 0, 1, 2.5, 0, 1]);
  assert.deepEqual([longer.value["length"], "length" in withLength(named("low"), 3).value], [2.5, false]);
  assert.equal(moved(named("top"), 1, 1).value["length"], 2);
  const third = withVertices(named("low"), [
    [0, 0, 0],
    [1 / 3, 0, 0],
  ]);
  assert.equal(JSON.stringify(third.value["line"]), "[[0,0,0],[0.333,0,0]]");
});

test("everything moves when a strip becomes the origin, and nothing moves against it", () => {
  const placed = aboutOrigin(ITEMS, {
    ...named("top"),
    value: {
      ...named("top").value,
      line: [
        [1, 2, 1],
        [1, 4, 1],
      ],
      direction: -1,
    },
  });
  const now = (name: string) => placed.find((item) => item.name === name)!;
  near(verticesOf(now("door"))[0]!, [
    4 - verticesOf(named("door"))[0]![1],
    verticesOf(named("door"))[0]![0] - 1,
    verticesOf(named("door"))[0]![2],
  ]);
  near(
    [Math.sin(yawOf(now("desk"))! - yawOf(named("desk"))!), lengthOf(now("low"))],
    [1, lengthOf(named("low"))],
  );
  near(outlineOf(now("wall"))![0]!, [4 - 2.98, -1 - 1]);
  assert.equal(now("radio"), named("radio"));
});

test("boxes and walls are turned by their keys, and what is nowhere stays there", () => {
  assert.equal(turned(named("desk"), Math.PI).value["yaw_deg"], -90);
  near(turned(named("wall"), Math.PI / 2).value["normal"] as Vec, [1, 0, 0]);
  near(outlineOf(named("wall"))!.flat(), [-1, 2.98, 3, 2.98, 3, 3.02, -1, 3.02]);
  near(outlineOf(named("desk"))!.flat(), [5.5, 0, 5.5, 2, 4.5, 2, 4.5, 0]);
  assert.equal(moved(named("radio"), 1, 1), named("radio"));
  assert.deepEqual(
    [yawOf(named("radio")), yawOf(named("door")), turned(named("door"), 1)],
    [null, null, named("door")],
  );
});

test("a move snaps onto walls and ends within reach, ends first, and onto nothing else", () => {
  assert.deepEqual(snapMove(named("top"), ITEMS, 0.5, 2.9, 0.05), { dx: 0.5, dy: 2.9, onto: "", far: 0.05 });
  const onto = snapMove(named("top"), ITEMS, 0.5, 2.96, 0.05);
  near([onto.dx, onto.dy], [0.5, 3]);
  assert.equal(onto.onto, "wall");
  const end = snapMove(named("top"), ITEMS, 0.97, 0.02, 0.05);
  near([end.dx, end.dy], [1, 0]);
  assert.equal(end.onto, "the end of low");
  assert.equal(snapMove(named("top"), ITEMS, 9, 2.98, 0.05).onto, "", "beside the wall's end");
  assert.equal(snapMove(named("door"), ITEMS, 4.52, 0, 0.05).onto, "desk");
});

test("a turn snaps to directions of others and of the room, a right angle too", () => {
  for (const by of [1.55, -1.55]) near([snapTurn(named("top"), [], by).by], [(Math.sign(by) * Math.PI) / 2]);
  const free = snapTurn(named("top"), ITEMS, 0.5);
  assert.deepEqual([free.by, free.onto], [0.5, ""]);
  const slanted = turned(named("low"), 0.3);
  const items = put(slanted);
  const found = snapTurn(named("top"), items, 0.33);
  near([found.by], [0.3], 0.001);
  assert.equal(found.onto, "low");
  const beside = parallel(moved(turned(named("top"), 0.2), 0, 2.5), ITEMS)!;
  assert.equal(beside.to, "wall");
  near([yawOf(beside.item)!], [0], 0.001);
});

test("a strip is level with the nearest other", () => {
  const found = level(named("top"), ITEMS)!;
  assert.equal(found.to, "low");
  near(
    found.vertices.map(([, , z]) => z),
    [0.5, 0.5],
  );
  assert.equal(level(named("door"), ITEMS), null);
  near([lengthOf(named("top")), distanceTo(named("top"), 1, -2)], [2, 2]);
});

test("a picture is scaled about the first click so that two places are as far apart as said", () => {
  const picture: Picture = { source: "", left: 0, top: 4, width: 8, height: 4 };
  const found = scaled(picture, [2, 2], [4, 2], 3);
  near([found.left, found.top, found.width, found.height], [-1, 5, 12, 6]);
  near([widened(picture, 4).height, widened(picture, 4).left], [2, 0]);
});

const HOME: Items = itemsOf({
  lamps: { door: { position: [0, 1, 2] } },
  things: {
    radio: { light: "door" },
    sofa: { home_assistant: "light.sofa" },
    tv: { home_assistant: "switch.tv", size: [1, 0.1, 0.6] },
  },
});
const WALL = { center: [0, 3, 1.25], normal: [0, -1, 0], size: [4, 2.5] };

test("only things without a center, a light and something to move with are unplaced", () => {
  assert.deepEqual(
    unplacedOf(HOME).map(({ name }) => name),
    ["sofa", "tv"],
  );
  assert.equal(unplacedOf(spreadAlongWalls(HOME)).length, 0);
});

test("unplaced things stand along a wall, on its inner side", () => {
  const wall: Item = { id: 9, section: "planes", name: "north", value: WALL };
  const spread = spreadAlongWalls([...HOME, wall]);
  const things = unplacedOf(HOME).map(({ id }) => spread.find((item) => item.id === id)!);
  for (const thing of things) near([verticesOf(thing)[0]![1]], [2.8]);
  near(
    things.map((thing) => Math.abs(verticesOf(thing)[0]![0])),
    [1, 1],
  );
  assert.deepEqual(things[1]!.value["size"], [1, 0.1, 0.6]);
  assert.equal(spread[0], HOME[0], "what has a place stays");
});

test("without a wall, unplaced things stand around all that has a place", () => {
  const spread = spreadAlongWalls(HOME);
  const places = spread.filter(({ section }) => section === "things").flatMap(verticesOf);
  assert.equal(places.length, 2);
  for (const [x, y] of places) assert.ok(Math.abs(x) <= 2 && Math.abs(y - 1) <= 2);
  assert.equal(new Set(places.map(String)).size, 2);
});
