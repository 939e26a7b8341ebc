// From where the scene is seen.
import assert from "node:assert/strict";
import { test } from "node:test";
import * as THREE from "three";
import { larger } from "../geometry/framing";
import type { Read3 } from "../geometry/vec";
import { Cameras } from "./cameras";

test("the camera gives way to a card that grows at once, and while somebody points stays there when it shrinks", () => {
  const camera = new THREE.PerspectiveCamera(42, 1.6);
  const picture = { camera, canvas: null, width: 1440, height: 900 };
  const cameras = new Cameras(picture as never, false, () => undefined);
  const points: Read3[] = [
    [-3, -2, 0],
    [3, 2, 2.1],
    [0, 0, 1],
    [-3, 2, 2.1],
  ];
  const top = () => {
    cameras.tick(performance.now() + 10_000, 0.1, null, null, null);
    camera.updateMatrixWorld();
    return Math.max(...points.map((point) => new THREE.Vector3(...point).project(camera).y));
  };
  cameras.frame(points, 6);
  const free = top();
  assert.ok(free > 1 - (2 * 270) / 900, `${free}: a card of 270 px would cover it`);
  cameras.keepClear({ top: 270, bottom: 0 });
  const below = top();
  assert.ok(below <= 1 - (2 * 270) / 900, `${below}`);
  cameras.keepClear(larger(cameras.edges, { top: 90, bottom: 0 }));
  assert.equal(top(), below);
});
