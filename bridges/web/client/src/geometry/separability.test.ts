import assert from "node:assert/strict";
import { test } from "node:test";
import { separabilityText, confusion, type Separability } from "./separability";

const SEPARABILITY: Separability = {
  x_m: [0, 1, 2],
  y_m: [-1, 0],
  things: ["screws", "nuts", "bolts", "lamp"],
  told_apart: [[4, 0]],
  confused: [[[], [[0, 1]]]],
};

test("the place under the mouse says how many things are told apart, and which are not", () => {
  assert.equal(separabilityText(SEPARABILITY, 0.5, -0.5), "4 of 4 told apart");
  assert.equal(separabilityText(SEPARABILITY, 1, -1), "0 of 4 told apart, not screws and nuts, …");
  for (const [x, y] of [
    [-0.1, -0.5],
    [2, -0.5],
    [0.5, 0],
  ] as const)
    assert.equal(separabilityText(SEPARABILITY, x, y), "");
});

test("the floor is coloured the more the fewer things are told apart, and not at all where all are", () => {
  const shown = [4, 2, 0].map((told) => confusion(SEPARABILITY, told));
  assert.equal(shown[0], 0);
  assert.deepEqual(shown, [...shown].sort());
});
