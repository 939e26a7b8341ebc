import assert from "node:assert/strict";
import { test } from "node:test";
import type { Shortcut } from "./keys";
import { beginning, makeShortcuts } from "./shortcuts";

/** Press keys on a page with these controls; returns what was done. */
function pressed(state: { canStep: boolean; mine: object | null }, ...keys: string[]): unknown[] {
  const done: unknown[] = [];
  const controls = {
    ...state,
    speaks: true,
    mayDo: () => false,
    may: () => false,
    stoppable: [],
    user: "ada",
    step: (...step: unknown[]) => done.push(step),
    site: { connected: true, timeline: null, people: new Map() },
  };
  const targets = {
    controls,
    speaker: { say: (text: string) => done.push(text) },
    mouse: { give: async () => void done.push("given") },
    stage: { view: { cameras: [], nudge: (...by: unknown[]) => done.push(by) }, separability: {} },
  };
  const table: Shortcut[] = makeShortcuts(targets as never);
  for (const [key, shiftKey] of keys.map((each) => [each.replace("Shift+", ""), each.includes("+")] as const))
    table
      .find((each) => each.keys.includes(key) && each.isOffered())
      ?.run({ key, shiftKey } as KeyboardEvent);
  return done;
}

test("arrow keys step within a row and among rows, Home stays, and with Shift arrows move the place", () => {
  assert.deepEqual(
    pressed(
      { canStep: true, mine: {} },
      "ArrowLeft",
      "ArrowRight",
      "ArrowUp",
      "ArrowDown",
      "Home",
      "Shift+ArrowUp",
    ),
    [
      [-1, "beside"],
      [1, "beside"],
      [-1, "row"],
      [1, "row"],
      [1, "here"],
      [0, 0.015],
    ],
  );
});

test("before anybody points, an arrow key speaks how to begin", () => {
  const [spoken] = pressed({ canStep: false, mine: null }, "ArrowDown") as [string];
  assert.match(spoken, /^M takes the arm\. The arrow keys/);
  assert.match(beginning({ canStep: true, mine: {} } as never), /^The arrow keys/);
});

test("who ends by Escape hears that the arm is given back", async () => {
  const done = pressed({ canStep: true, mine: {} }, "Escape");
  await Promise.resolve();
  assert.deepEqual(done, ["given", "The arm is given back."]);
});
