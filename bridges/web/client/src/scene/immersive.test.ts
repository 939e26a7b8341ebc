import assert from "node:assert/strict";
import { test } from "node:test";
import * as THREE from "three";
import type { Environment } from "../messages";
import type { Arm } from "../view";
import { Immersive, NOTE_SCALE } from "./immersive";
import { isAbout } from "./people";
import { LETTER_SHARE, LINE_RAD } from "./sprites";

/** An aligned session in a room of three lamps, which were touched by something with this hand; its note. */
async function aligned(handedness: XRHandedness): Promise<Immersive> {
  Object.assign(globalThis, { window: globalThis });
  const space = new EventTarget();
  const session = Object.assign(new EventTarget(), {
    inputSources: [] as unknown[],
    requestReferenceSpace: async () => space,
    end: async () => undefined,
  });
  Object.defineProperty(globalThis, "navigator", {
    value: { xr: { requestSession: async () => session } },
    configurable: true,
  });
  const picture = {
    scene: new THREE.Scene(),
    isImmersed: true,
    sessionSpace: space,
    immerse: async () => undefined,
  };
  const lamps = [
    [0, 1, 1],
    [2, 1, 1],
    [0, 3, 1],
  ].map((position_m, i) => ({ id: `lamp${i + 1}`, position_m }));
  const map = { name: "room", lamps, things: [], strips: [], belts: [] } as unknown as Environment;
  const arm = {
    user: "ada",
    pointing: "",
    take: async () => "",
    give() {},
    press: async () => "",
    step: async () => "",
    move() {},
  } as Arm;
  const immersive = new Immersive(
    picture as never,
    () => map,
    () => undefined,
    arm,
    () => undefined,
  );
  await immersive.enter(() => undefined);
  for (let n = 0; n < 3; n++) {
    const lamp = lamps.find(({ id }) => immersive.noteText.includes(`${id.replace("lamp", "lamp ")} (`))!;
    const [x, y, z] = lamp.position_m as [number, number, number];
    const inputSource = {
      handedness,
      targetRayMode: handedness === "none" ? "screen" : "tracked-pointer",
      targetRaySpace: space,
      hand: null,
    };
    session.inputSources = [inputSource];
    const frame = {
      getPose: () => ({
        transform: { position: { x, y: z, z: -y }, orientation: { x: 0, y: 0, z: 0, w: 1 } },
      }),
    };
    for (const kind of ["selectstart", "selectend"])
      session.dispatchEvent(Object.assign(new Event(kind), { frame, inputSource }));
  }
  assert.match(immersive.noteText, /^Aligned/);
  return immersive;
}

test("a hand is invited to point, a phone's tap is not, since it does nothing", async () => {
  assert.match((await aligned("right")).noteText, /Press to point as ada\.$/);
  assert.equal((await aligned("none")).noteText.includes("Press to point"), false);
});

test("the wearer reads their next step once, after what stands before their eyes", async () => {
  const immersive = await aligned("right");
  const time = (immersive as unknown as { time: { ms: number } }).time;
  immersive.tellStep("Point at a box.");
  assert.match(immersive.noteText, /^Aligned/);
  time.ms += 60_000;
  immersive.tellStep("Point at a box.");
  assert.match(immersive.noteText, /^Point at a box\./);
  immersive.tell("Kettle has fired.");
  time.ms += 60_000;
  immersive.tellStep("Point at a box.");
  assert.match(immersive.noteText, /^Kettle/, "it was read");
  immersive.tellStep("Press.");
  assert.match(immersive.noteText, /^Press\./);
});

test("who has lost the arm reads so at once, and how to take it back", async () => {
  const immersive = await aligned("right");
  immersive.tell("Another headset points as ada now.");
  assert.equal(immersive.noteText, "Another headset points as ada now. Press to point as ada.");
});

test("letters of the note are at least 0.6° high, and no figure is about the viewer", () => {
  assert.ok(NOTE_SCALE * LINE_RAD * LETTER_SHARE >= (0.6 * Math.PI) / 180);
  assert.deepEqual([isAbout([1, 1, 1.6], [1.3, 1.3, 0]), isAbout([1, 1, 1.6], [1.5, 1, 0])], [true, false]);
});
