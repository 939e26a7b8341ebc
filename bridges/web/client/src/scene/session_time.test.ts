import assert from "node:assert/strict";
import { test } from "node:test";
import { SessionTime } from "./session_time";

test("frames of a busy device hold no press for 1.5 s, and frames of a quick one do", () => {
  const busy = new SessionTime();
  const quick = new SessionTime();
  for (const now of [0, 2000, 4000]) busy.advance(now);
  for (let now = 0; now <= 1600; now += 16) quick.advance(now);
  assert.ok(busy.ms <= 300);
  assert.ok(quick.ms > 1500);
});
