// Objects as boxes in the scene.
import assert from "node:assert/strict";
import { test } from "node:test";
import type * as THREE from "three";
import type { TrackedObject } from "../messages";
import { boxColor, type Rgb } from "../geometry/appearance";
import { Polyline } from "../geometry/polyline";
import { emptyPerson, emptySite } from "../site/site";
import { DARK, MeshFactory } from "./mesh_factory";
import { drawStates } from "./thing_states";
import { Things } from "./things";

const CURSOR: Rgb = [255, 255, 200];
/** Red, green and blue of a box that nobody points at. */
const DIM: Rgb = [90, 90, 90];
/** Elements of the matrix of one box. */
const MATRIX = 16;

const SCREWS = {
  id: "t",
  kind: "screws",
  position_m: [1, 2, 1.4],
  velocity_mps: [0, 0, 0],
  length_m: 0.6,
  size_m: [0.4, 0.2, 0.3],
  yaw_rad: Math.PI / 2,
} as unknown as TrackedObject;
const ON_SHELF = {
  surface: "strip",
  surface_id: "shelf",
  surface_position_m: 0.5,
  surface_speed_mps: 0,
} as const;

/** A scene with one box on a shelf, at which ada may point. */
function withBox() {
  const factory = new MeshFactory(true, DARK);
  const shelf = new Polyline([
    [0, 0, 0],
    [1, 0, 0],
  ]);
  const things = new Things(factory, () => shelf);
  const site = emptySite();
  const ada = emptyPerson("ada");
  ada.profile = { cursor_color: CURSOR, pattern: "solid" } as never;
  site.people.set("ada", ada);
  const objects = [{ ...SCREWS, ...ON_SHELF }];
  site.objects.set("things", { objects, stamp_ns: 0, seq: 0, latency_sigma_s: null });
  things.set(site);
  things.place(0);
  const box = factory.group.children.find(({ name }) => name === "box screws") as THREE.InstancedMesh;
  return { things, site, ada, box };
}

type BoxScene = ReturnType<typeof withBox>;

/** Draw the states, and return the box's colour and the names that were written. */
function drawn({ things, site, box }: BoxScene): { color: Rgb; names: string[] } {
  const names: string[] = [];
  const labels = {
    add: (_key: string, _at: unknown, _up: number, [piece]: { text: string }[]) => names.push(piece!.text),
  };
  const marks = { add: () => undefined };
  drawStates(site, { things, marks: marks as never, labels: labels as never, isDark: false });
  return { color: [...box.instanceColor!.array.slice(0, 3)] as unknown as Rgb, names };
}

/** The colour as the renderer has it: linear, from 0 to 1 (IEC 61966-2-1). */
function linear(shown: Rgb): number[] {
  return shown.map((part) => {
    const share = part / 255;
    return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
  });
}

function assertNear(got: ArrayLike<number>, wanted: readonly number[]): void {
  const isNear = wanted.every((part, i) => Math.abs(part - got[i]!) < 1e-5);
  assert.ok(isNear, `${Array.from(got)} instead of ${wanted}`);
}

test("an object with a size is a box of that size and yaw, with its name", () => {
  const scene = withBox();

  const matrix = [0, 0.4, 0, 0, -0.2, 0, 0, 0, 0, 0, 0.3, 0, 1, 2, 1.4, 1];
  assertNear(scene.box.instanceMatrix.array.slice(0, MATRIX), matrix);
  assert.deepEqual(drawn(scene).names, ["screws"]);
});

test("a box is dim while nobody points at it", () => {
  assertNear(drawn(withBox()).color, linear(DIM));
});

test("a box has the colour of who points at it, as far as the selection has come", () => {
  const scene = withBox();
  scene.ada.hover = { object_id: "t", progress: 0.5, action: "select" } as never;

  assertNear(drawn(scene).color, linear(boxColor("screws", null, { color: CURSOR, progress: 0.5 })));
  assertNear(boxColor("screws", null, { color: CURSOR, progress: 1 }), CURSOR);
});

test("a selected box has the colour of who selected it", () => {
  const scene = withBox();
  scene.site.selection = { objects: [{ id: "t", user: "ada" }], reserved: [] } as never;

  assertNear(drawn(scene).color, linear(CURSOR));
});

test("in the viewer's own room a box is seen by its edges and hides what is behind it, and is solid again outside", () => {
  const factory = new MeshFactory(true, DARK);
  const things = new Things(factory, () => null);
  const site = emptySite();
  site.objects.set("things", { objects: [SCREWS], stamp_ns: 0, seq: 0, latency_sigma_s: null });
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
