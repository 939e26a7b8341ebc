import assert from "node:assert/strict";
import { test } from "node:test";
import { problemOf, timed } from "./voice";

test("words are spread over the time of speech by their lengths, and none ends after it was shown", () => {
  const [put, that, there] = timed(" Put that  there ", 0.8, 10, 11.8, 12, [10.9, 10.75, 11.5]);
  assert.deepEqual(
    [put, that, there].map((word) => word!.text),
    ["put", "that", "there"],
  );
  assert.ok(put!.start_s === 2 && that!.start_s === put!.end_s && that!.end_s === 1.25);
  assert.ok(there!.start_s <= that!.start_s && there!.end_s < there!.start_s && there!.confidence === 0.8);
});

test("a long silence after the words is not spread over them, and ages are never negative", () => {
  const [stop] = timed("stop", null, 10, 40, 40, [40]);
  assert.ok(stop!.start_s === 30 && stop!.end_s > 29);
  assert.deepEqual(timed("x", null, 500, 400, 300, []), [
    { text: "x", start_s: 0, end_s: 0, confidence: null },
  ]);
  assert.equal(timed("w ".repeat(99), null, 0, 9, 9, []).length, 64);
});

test("each problem of the recogniser has its remedy", () => {
  assert.match(
    problemOf("not-allowed", true),
    /^The microphone was refused: allow it .*, then tap Listen again\.$/,
  );
  assert.match(problemOf("not-allowed", false), /only over https/);
  for (const error of ["service-not-allowed", "audio-capture", "network", "language-not-supported"])
    assert.match(problemOf(error, true), /: (allow|connect|load) /);
});
