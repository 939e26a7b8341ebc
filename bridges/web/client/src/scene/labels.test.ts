import assert from "node:assert/strict";
import { test } from "node:test";
import * as THREE from "three";
import { Labels, NAME } from "./labels";
import { DARK } from "./mesh_factory";
import { partsOf } from "./thing_states";

/** What labels use of an element, 90 px wide. */
class Element {
  style: Record<string, string> = {};
  textContent = "";
  offsetWidth = 90;
  offsetHeight = 22;
  children: Element[] = [];
  append(...more: Element[]): void {
    this.children.push(...more);
  }
  replaceChildren(...now: Element[]): void {
    this.children = now;
  }
  remove(): void {}
  setAttribute(): void {}
}

test("on a narrow picture every thing has its name, or a number that a legend explains", () => {
  Object.assign(globalThis, { document: { createElement: () => new Element() } });
  const host = new Element();
  const labels = new Labels(host as never);
  const camera = new THREE.PerspectiveCamera(42, 390 / 90, 0.1, 50);
  camera.position.set(0, -6, 1);
  camera.up.set(0, 0, 1);
  camera.lookAt(0, 0, 1);
  camera.updateMatrixWorld();
  labels.begin(DARK);
  for (let i = 0; i < 20; i++)
    labels.add(`thing t${i}`, [0.05 * i - 0.5, 0, 1], 0.1, [{ text: `thing ${i}` }], "", NAME, i + 1);
  labels.end(camera, 390, 90);
  const shown = host.children[0]!.children.filter(({ style }) => style.visibility === "visible");
  const names = shown.flatMap(({ children }) => children.map(({ textContent }) => textContent));
  const numbers = shown.map(({ textContent }) => textContent).filter((text) => /^\d+$/.test(text));
  assert.ok(names.length >= 1 && numbers.length >= 1);
  assert.equal(names.length + numbers.length, 20);
  const legend = shown.find(({ textContent }) => textContent.includes("thing"))!.textContent;
  assert.deepEqual(
    legend.split(" · ").map((each) => each.split(" ")[0]),
    numbers,
  );
});

test("a legend that would hide the picture is left out with its numbers", () => {
  class Tall extends Element {
    override offsetHeight = 96;
  }
  Object.assign(globalThis, { document: { createElement: () => new Tall() } });
  const host = new Element();
  const labels = new Labels(host as never);
  const camera = new THREE.PerspectiveCamera(42, 390 / 90, 0.1, 50);
  camera.position.set(0, -6, 1);
  camera.up.set(0, 0, 1);
  camera.lookAt(0, 0, 1);
  camera.updateMatrixWorld();
  labels.begin(DARK);
  for (let i = 0; i < 20; i++)
    labels.add(`thing t${i}`, [0.05 * i - 0.5, 0, 1], 0.1, [{ text: `thing ${i}` }], "", NAME, i + 1);
  labels.end(camera, 390, 90);
  const shown = host.children[0]!.children.filter(({ style }) => style.visibility === "visible");
  assert.deepEqual(
    shown.filter(({ textContent }) => textContent),
    [],
  );
});

test("boxes of one kind that touch have one name, that of the topmost; others and pressed ones have their own", () => {
  const box = (kind: string, x: number, z: number) =>
    ({ object: { kind }, placed: { at: [x, 0, z] }, size: [0.06, 0.06, 0.06] }) as never as Parameters<
      typeof partsOf
    >[0][number];
  const links = Array.from({ length: 7 }, (_, i) => box("arm", 0.1 * i, 0.1 * i));
  const far = box("arm", 5, 0);
  const red = box("red", 0.1, 0.1);
  const parts = partsOf([...links.slice(0, 3), far, red, ...links.slice(3)]);
  assert.deepEqual(
    [...links.map((each) => parts.has(each)), parts.has(far), parts.has(red)],
    [true, true, true, true, true, true, false, false, false],
  );
  assert.equal(partsOf([box("", 0, 0), box("", 0.1, 0)]).size, 0, "without a kind they have their ids");
});
