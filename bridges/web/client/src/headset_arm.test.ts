import assert from "node:assert/strict";
import { test } from "node:test";
import { Controls } from "./controls";
import { emptyPerson, emptySite } from "./site/site";
import { HeadsetArm } from "./headset_arm";

const LINE = { user: "ada", moved_by: "own", is_mine: false, assumed: null, phone: "", battery: null };

test("an arm that another page took before any status told of it is not pointed with, and presses ask once", async () => {
  let now = 0;
  const clock = performance.now;
  performance.now = () => now;
  const site = emptySite();
  const asked: string[] = [];
  const connection = {
    ask: (wish: { deed: string; name: string; query?: { held_s?: number } }) => (
      asked.push(`${wish.deed} ${wish.name} ${wish.query?.held_s ?? ""}`.trim()),
      Promise.resolve({})
    ),
  };
  const controls = new Controls(site, {} as never, connection as never, {} as never, () => {});
  const told: string[] = [];
  const arm = new HeadsetArm(controls, (sentence) => told.push(sentence));
  const appears = (line: object) => {
    site.people.set("ada", Object.assign(emptyPerson("ada"), { line: { ...LINE, ...line } }));
    arm.update();
  };
  Object.assign(site, { connected: true, hello: { deeds: ["take"], requests: [] } });
  appears({});
  const [problem, second] = await Promise.all([arm.take(), arm.take()]);
  assert.deepEqual([problem, second !== "", asked], ["", true, ["take ada"]]);
  await Promise.all([arm.press(150), arm.press(9000)]);
  assert.deepEqual(asked.splice(1), ["press ada 0.15", "press ada 2"]);
  appears({ moved_by: "mouse" }); // may be older than the consent
  assert.equal(arm.pointing, "ada");
  now = 4000;
  appears({ moved_by: "mouse" });
  arm.give();
  await arm.take();
  appears({ moved_by: "headset", is_mine: true });
  appears({ moved_by: "headset" });
  appears({ moved_by: "headset" });
  performance.now = clock;
  assert.deepEqual([arm.pointing, asked], ["", ["take ada", "take ada"]]);
  assert.deepEqual(told, ["Another page points as ada now.", "Another headset points as ada now."]);
});
