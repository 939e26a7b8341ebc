// Objects as boxes in the scene.
import assert from "node:assert/strict";
import { test } from "node:test";
import type * as THREE from "three";
import type { TrackedObject } from "../messages";
import { boxColor, type Rgb } from "../geometry/appearance";
import { Polyline } from "../geometry/polyline";
import { emptyPerson, emptySite } from "../site/site";
import { DARK, MeshFactory } from "./mesh_factory";
import { state } from "./state";
import { Things } from "./things";

test("an object with a size is a box of that size and yaw: dim, in the colour of who points at it, bright once selected", () => {
  const factory = new MeshFactory(true, DARK);
  const things = new Things(
    factory,
    () =>
      new Polyline([
        [0, 0, 0],
        [1, 0, 0],
      ]),
  );
  const site = emptySite();
  const ada = emptyPerson("ada");
  const texts: string[] = [];
  const color: Rgb = [255, 255, 200];
  const object = {
    id: "t",
    kind: "screws",
    position_m: [1, 2, 1.4],
    velocity_mps: [0, 0, 0],
    length_m: 0.6,
    size_m: [0.4, 0.2, 0.3],
    yaw_rad: Math.PI / 2,
    surface: "strip",
    surface_id: "shelf",
    surface_position_m: 0.5,
    surface_speed_mps: 0,
  } as unknown as TrackedObject;
  const drawn = (): Rgb => {
    state(
      site,
      things,
      { add: () => undefined } as never,
      {
        add: (_key: string, _at: unknown, _up: number, [piece]: { text: string }[]) =>
          texts.push(piece!.text),
      } as never,
      false,
    );
    return [...box.instanceColor!.array.slice(0, 3)] as unknown as Rgb;
  };
  const linear = (shown: Rgb) =>
    shown.map((part) => (part / 255 <= 0.04045 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4));
  const near = (got: ArrayLike<number>, wanted: readonly number[]) =>
    assert.ok(
      wanted.every((part, i) => Math.abs(part - got[i]!) < 1e-5),
      `${Array.from(got)} instead of ${wanted}`,
    );
  ada.profile = { cursor_color: color, pattern: "solid" } as never;
  site.people.set("ada", ada);
  site.objects.set("things", { objects: [object], stamp_ns: 0, seq: 0, latency_sigma_s: null });
  things.set(site);
  things.place(0);
  const box = factory.group.children.find(({ name }) => name === "box screws") as THREE.InstancedMesh;
  near(box.instanceMatrix.array.slice(0, 16), [0, 0.4, 0, 0, -0.2, 0, 0, 0, 0, 0, 0.3, 0, 1, 2, 1.4, 1]);
  near(drawn(), linear([90, 90, 90]));
  assert.deepEqual(texts, ["screws"]);
  ada.hover = { object_id: "t", progress: 0.5, action: "select" } as never;
  near(drawn(), linear(boxColor("screws", null, { color, progress: 0.5 })));
  near(boxColor("screws", null, { color, progress: 1 }), color);
  site.selection = { objects: [{ id: "t", user: "ada" }], reserved: [] } as never;
  near(drawn(), linear(color));
});

test("in the viewer's own room a box is seen by its edges and hides what is behind it, and is solid again outside", () => {
  const factory = new MeshFactory(true, DARK);
  const things = new Things(factory, () => null);
  const site = emptySite();
  const object = {
    id: "t",
    kind: "screws",
    position_m: [1, 2, 1.4],
    velocity_mps: [0, 0, 0],
    length_m: 0.6,
    size_m: [0.4, 0.2, 0.3],
    yaw_rad: Math.PI / 2,
  } as unknown as TrackedObject;
  site.objects.set("things", { objects: [object], stamp_ns: 0, seq: 0, latency_sigma_s: null });
  things.set(site);
  things.place(0);
  const box = factory.group.children.find(({ name }) => name === "box screws") as THREE.InstancedMesh;
  const writes = () => (box.material as THREE.Material).colorWrite;
  const edges = () =>
    factory.group.children.filter((each) => (each as THREE.LineSegments).isLineSegments && each.visible);
  assert.deepEqual([edges().length, writes()], [0, true]);
  things.setImmersed(true);
  const [edge, ...more] = edges();
  assert.deepEqual([more.length, writes(), box.renderOrder < edge!.renderOrder], [0, false, true]);
  assert.deepEqual(
    [edge!.position.toArray(), edge!.scale.toArray(), edge!.rotation.z],
    [[1, 2, 1.4], [0.4, 0.2, 0.3], Math.PI / 2],
  );
  things.setImmersed(false);
  assert.deepEqual([edges().length, writes()], [0, true]);
});
