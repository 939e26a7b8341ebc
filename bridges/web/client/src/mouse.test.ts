import assert from "node:assert/strict";
import { test } from "node:test";
import { Controls } from "./controls";
import { Mouse } from "./mouse";
import { emptyPerson, emptySite } from "./site/site";

const LINE = { user: "ada", moved_by: "own", is_mine: false, assumed: null, phone: "", battery: null };

test("after a restart the wrist is taken back once, and not before the server can have its person point", async () => {
  Object.assign(globalThis, { document: { getElementById: () => null } });
  const site = emptySite();
  const asked: string[] = [];
  const connection = {
    ask: (wish: { deed: string; name: string }) => (
      asked.push(`${wish.deed} ${wish.name}`),
      Promise.resolve({})
    ),
  };
  const controls = new Controls(site, {} as never, connection as never, {} as never, () => {});
  const mouse = new Mouse(controls, () => null, { addEventListener: () => {} } as never);
  const appears = (line: object, interaction: object | null, present: boolean) => {
    site.people.set("ada", Object.assign(emptyPerson("ada"), { line: { ...LINE, ...line }, interaction }));
    site.status = { services: [{ instance: "imu-bridge.ada", present, since_s: 0 }] } as never;
    mouse.update();
  };
  Object.assign(site, { connected: true, hello: { deeds: ["take"], requests: [] } });
  appears({}, { state: "idle" }, true);
  await mouse.take();
  appears({ is_mine: true, moved_by: "mouse" }, { state: "pointing" }, true);
  assert.deepEqual(asked.splice(0), ["take ada"]);
  appears({}, { state: "idle" }, false); // the server would refuse
  appears({}, null, true); // the server would not know that the person rests
  assert.deepEqual(asked, []);
  site.people.set("bea", emptyPerson("bea"));
  controls.choose("bea");
  appears({}, { state: "idle" }, true);
  appears({}, { state: "idle" }, true);
  assert.deepEqual(asked, ["take ada"]);
});
