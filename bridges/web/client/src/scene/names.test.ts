// Names of the map in the scene, and what labels are kept clear of.
import assert from "node:assert/strict";
import { test } from "node:test";
import * as THREE from "three";
import type { Environment } from "../messages";
import { placed } from "../geometry/placing";
import { emptyPerson, emptySite } from "../site/site";
import { Names } from "./names";

const MAP = {
  lamps: [
    { id: "led_0", position_m: [-2, 0, 0] },
    { id: "radio_lamp", position_m: [2, 0, 0] },
  ],
  strips: [
    {
      id: "0",
      line_m: [
        [-2, 1, 0],
        [2, 1, 0],
      ],
      pixels: 10,
    },
  ],
  boxes: [{ id: "behind_left", center_m: [0, -2, 0], size_m: [2, 1, 1], yaw_rad: 0 }],
  spheres: [],
  cylinders: [],
  things: [{ id: "radio", lamp: "radio_lamp" }],
} as unknown as Environment;
const camera = new THREE.PerspectiveCamera(42, 1, 0.1, 200);
camera.position.set(0, 0, 10);
camera.lookAt(0, 0, 0);
camera.updateMatrixWorld();

function at(x: number, y: number): [number, number] {
  const seen = new THREE.Vector3(x, y, 0).project(camera);
  return [((seen.x + 1) / 2) * 600, ((1 - seen.y) / 2) * 600];
}
const shown = (pointer: [number, number] | null, site = emptySite()) =>
  new Names(MAP).shown(site, pointer, camera, 600, 600).map(({ text }) => text);

test("a name is shown where the mouse is over its lamp, strip or box, and nowhere else", () => {
  assert.deepEqual(shown(null), []);
  assert.deepEqual(shown(at(-2, 0)), ["lamp 0"]);
  assert.deepEqual(shown(at(1.3, 1.05)), ["strip 0"]);
  assert.deepEqual(shown(at(0.7, -2)), ["behind left"]);
  assert.deepEqual(shown(at(0, 0)), []);
  assert.deepEqual(shown(at(2, 0)), [], "a thing's lamp has the thing's name");
  const [name] = new Names(MAP).shown(emptySite(), at(1.3, 1), camera, 600, 600);
  assert.ok(Math.abs(name!.at[0] - 1.3) < 0.05, "where the mouse is, not in the middle of the strip");
});

test("while a person is localized every lamp has its name, once", () => {
  const site = emptySite();
  const ada = emptyPerson("ada");
  ada.localization = { phase: "sampling" } as never;
  site.people.set("ada", ada);
  assert.deepEqual(shown(null, site), ["lamp 0"]);
  assert.deepEqual(shown(at(-2, 0), site), ["lamp 0"]);
});

test("in a headset every lamp has its name", () => {
  assert.deepEqual(
    new Names(MAP).shown(emptySite(), null, camera, 600, 600, true).map(({ text }) => text),
    ["lamp 0"],
  );
});

test("a label that went aside stays there while there is room, and comes back otherwise", () => {
  const picture = { width: 400, height: 400 };
  const wish = { x: 100, y: 100, width: 40, height: 20, rank: 1 };
  const [aside] = placed([wish], [{ x: 90, y: 70, width: 30, height: 40 }], picture);
  assert.ok(aside!.x !== 80 || aside!.y !== 80);
  assert.deepEqual(placed([{ ...wish, kept: aside! }], [], picture), [aside]);
  assert.deepEqual(placed([wish], [], picture), [{ x: 80, y: 80 }]);
  assert.deepEqual(placed([{ ...wish, kept: aside! }], [{ ...aside!, width: 40, height: 20 }], picture), [
    { x: 80, y: 80 },
  ]);
  assert.deepEqual(
    placed([{ ...wish, kept: { x: 380, y: 80 } }], [], picture),
    [{ x: 80, y: 80 }],
    "it would leave the picture",
  );
});
