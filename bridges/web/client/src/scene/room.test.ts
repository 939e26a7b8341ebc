import assert from "node:assert/strict";
import { test } from "node:test";
import type * as THREE from "three";
import { boundsOf } from "../geometry/bounds";
import type { Environment } from "../messages";
import { LIGHT, MeshFactory } from "./mesh_factory";
import { Room } from "./room";
import { NOTHING } from "./world";

const MAP = {
  ...NOTHING,
  boxes: [{ id: "table", center_m: [1, 0, 0.4], size_m: [1, 1, 0.8], yaw_rad: 0 }],
  spheres: [{ id: "ball", center_m: [0, 2, 1], radius_m: 0.2 }],
  planes: [{ id: "wall", center_m: [3, 0, 1], normal: [1, 0, 0], size_m: [2, 2] }],
} as unknown as Environment;

test("in the viewer's own room solids are first, without colour, but with edges, and there is no floor; then all is as before", () => {
  const factory = new MeshFactory(true, LIGHT);
  const room = new Room(factory, MAP, boundsOf(MAP));
  const seen = (): string =>
    JSON.stringify(
      factory.group.children.map((each) => [
        each.visible,
        each.renderOrder,
        ((each as THREE.Mesh).material as THREE.Material).colorWrite,
      ]),
    );
  const before = seen();
  const solids = room.targets.filter(({ userData }) => userData.isSolid) as THREE.Mesh[];
  assert.equal(solids.length, 3);
  room.setImmersed(true);
  assert.ok(
    factory.group.children.every((each) => !each.visible || solids.includes(each as THREE.Mesh)),
    "nothing of the floor is left",
  );
  for (const solid of solids) {
    assert.ok(solid.visible && !(solid.material as THREE.Material).colorWrite && solid.renderOrder < 0);
    for (const edges of solid.children)
      assert.ok(((edges as THREE.LineSegments).material as THREE.Material).colorWrite && edges.visible);
  }
  assert.ok((solids[0]!.material as THREE.Material).depthWrite, "it hides what is behind it");
  room.setImmersed(false);
  assert.equal(seen(), before);
  factory.dispose();
});
