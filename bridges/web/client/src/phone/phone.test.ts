import assert from "node:assert/strict";
import { test } from "node:test";
import { fromAngles, normalized } from "./orientation";
import { LEAST_MS, MOST_BUFFERED, Pace, Rate, STILL_MS } from "./pace";
import { RetryPolicy } from "./retry_policy";
import { DOUBLE_MS, HOLD_MS, Taps } from "./taps";
import { sentence } from "../format";
import { figures, pressWords } from "./words";
import { withNames } from "../words";

type Matrix = number[][];
const times = (a: Matrix, b: Matrix): Matrix =>
  a.map((row) => b[0]!.map((_, j) => row.reduce((sum, x, k) => sum + x * b[k]![j]!, 0)));

/** The rotation matrix of the W3C's own formulation, Z X' Y''. */
function matrix(alpha: number, beta: number, gamma: number): Matrix {
  const rad = (degrees: number) => (degrees * Math.PI) / 180;
  const [cz, sz, cx, sx, cy, sy] = [
    Math.cos(rad(alpha)),
    Math.sin(rad(alpha)),
    Math.cos(rad(beta)),
    Math.sin(rad(beta)),
    Math.cos(rad(gamma)),
    Math.sin(rad(gamma)),
  ];
  const z = [
    [cz, -sz, 0],
    [sz, cz, 0],
    [0, 0, 1],
  ];
  const x = [
    [1, 0, 0],
    [0, cx, -sx],
    [0, sx, cx],
  ];
  const y = [
    [cy, 0, sy],
    [0, 1, 0],
    [-sy, 0, cy],
  ];
  return times(times(z, x), y);
}

function matrixOf([x, y, z, w]: readonly number[]): Matrix {
  return [
    [1 - 2 * (y! * y! + z! * z!), 2 * (x! * y! - z! * w!), 2 * (x! * z! + y! * w!)],
    [2 * (x! * y! + z! * w!), 1 - 2 * (x! * x! + z! * z!), 2 * (y! * z! - x! * w!)],
    [2 * (x! * z! - y! * w!), 2 * (y! * z! + x! * w!), 1 - 2 * (x! * x! + y! * y!)],
  ];
}

test("angles of events are the rotation that the W3C's matrices are, within 1e-12", () => {
  let worst = 0;
  for (let alpha = 0; alpha < 360; alpha += 17) {
    for (let beta = -180; beta <= 180; beta += 13) {
      for (let gamma = -90; gamma <= 90; gamma += 11) {
        const expected = matrix(alpha, beta, gamma);
        matrixOf(fromAngles(alpha, beta, gamma)).forEach((row, i) =>
          row.forEach((value, j) => {
            worst = Math.max(worst, Math.abs(value - expected[i]![j]!));
          }),
        );
      }
    }
  }
  assert.ok(worst < 1e-12, `${worst}`);
});

test("a phone that lies flat and points north is the identity, and turning left is about z", () => {
  assert.deepEqual(fromAngles(0, 0, 0), [0, 0, 0, 1]);
  const [x, y, z, w] = fromAngles(90, 0, 0);
  assert.ok(x === 0 && y === 0 && Math.abs(z - Math.SQRT1_2) < 1e-15 && Math.abs(w - Math.SQRT1_2) < 1e-15);
});

test("what is no rotation is none", () => {
  assert.equal(normalized(null), null);
  assert.equal(normalized([0, 0, 0, 0]), null);
  assert.equal(normalized([0, 0, Number.NaN, 1]), null);
  assert.equal(normalized([0, 0, 1]), null);
  assert.deepEqual(normalized([0, 0, 0, 1.04]), [0, 0, 0, 1]);
  assert.equal(normalized([0, 0, 0, 1.06]), null);
});

test("readings go out at once, but not closer together than agreed", () => {
  const pace = new Pace();
  assert.equal(pace.due(0, 0), null);
  pace.read([0, 0, 0, 1], 5);
  assert.deepEqual(pace.due(10, 0), { q: [0, 0, 0, 1], t: 5 });
  pace.read([0, 0, 1, 0], 9);
  assert.equal(pace.due(10 + LEAST_MS - 1, 0), null);
  assert.deepEqual(pace.due(10 + LEAST_MS, 0)?.q, [0, 0, 1, 0]);
});

test("a still phone says so again and again, with a time that goes forward", () => {
  const pace = new Pace();
  pace.read([0, 0, 0, 1], 100);
  pace.due(100, 0);
  assert.equal(pace.due(100 + STILL_MS - 1, 0), null);
  assert.deepEqual(pace.due(100 + STILL_MS, 0), { q: [0, 0, 0, 1], t: 100 + STILL_MS });
  pace.read([0, 0, 0, 1], 90);
  assert.equal(pace.due(400, 0)?.t, 100 + STILL_MS);
  pace.stop();
  assert.equal(pace.due(5000, 0), null);
});

test("nothing is said into a connection that does not keep up, and then the newest", () => {
  const pace = new Pace();
  pace.read([0, 0, 0, 1], 1);
  assert.equal(pace.due(50, MOST_BUFFERED + 1), null);
  pace.read([1, 0, 0, 0], 2);
  assert.deepEqual(pace.due(60, 0), { q: [1, 0, 0, 0], t: 2 });
});

test("a rate counts the last second", () => {
  const rate = new Rate();
  for (let t = 0; t < 2000; t += 20) rate.tick(t);
  assert.equal(rate.at(1999), 50);
  assert.equal(rate.at(9000), 0);
});

test("posts are tried when the socket was refused twice, and kept while they work", () => {
  const retries = new RetryPolicy();
  const tries = [];
  for (let i = 0; i < 2; i++) {
    tries.push(retries.nextTransport());
    retries.noteFailure(false);
  }
  tries.push(retries.nextTransport());
  retries.noteSuccess();
  assert.deepEqual(tries, ["socket", "socket", "post"]);
  retries.noteFailure(true);
  assert.equal(retries.nextTransport(), "post");
});

test("a socket that was open and broke is tried again as such", () => {
  const retries = new RetryPolicy();
  for (let i = 0; i < 5; i++) {
    assert.equal(retries.nextTransport(), "socket");
    retries.noteSuccess();
    assert.equal(retries.noteFailure(true), 400);
  }
});

test("as long as nothing works both ways are tried in turn, ever more rarely", () => {
  const retries = new RetryPolicy();
  const tried: string[] = [];
  const waits: number[] = [];
  for (let i = 0; i < 9; i++) {
    tried.push(retries.nextTransport());
    waits.push(retries.noteFailure(false));
  }
  assert.deepEqual(tried, ["socket", "socket", "post", "socket", "post", "socket", "post", "socket", "post"]);
  assert.deepEqual(waits, [400, 800, 1600, 3200, 6400, 8000, 8000, 8000, 8000]);
});

test("a tap is a press at once, a long one a hold before the finger leaves", () => {
  const taps = new Taps();
  taps.down(0);
  assert.equal(taps.wait(100), null);
  assert.equal(taps.up(120, false), "press");
  taps.down(1000);
  assert.equal(taps.wait(1000 + HOLD_MS), "hold");
  assert.equal(taps.up(2000, false), null);
  taps.down(3000);
  taps.cancel();
  assert.equal(taps.wait(9000), null);
});

test("where a double press means something, one waits for the second", () => {
  const taps = new Taps();
  taps.down(0);
  assert.equal(taps.up(50, true), null);
  taps.down(150);
  assert.equal(taps.wait(180), null);
  assert.equal(taps.up(200, true), "double");
  taps.down(1000);
  assert.equal(taps.up(1050, true), null);
  assert.equal(taps.wait(1050 + DOUBLE_MS), null);
  assert.equal(taps.wait(1051 + DOUBLE_MS), "press");
  assert.equal(taps.wait(5000), null);
});

test("sentences of the server are understood as far as the page needs it", () => {
  assert.equal(sentence("point at led_1, 1 of 4"), "Point at led_1, 1 of 4.");
  assert.equal(figures(59, 12.4, 0.84, "sensor", false), "59/s · 12 ms · battery 84 %");
  assert.equal(figures(27, null, null, "event", true), "27/s · by events · by posts");
});

test("lamps have names instead of ids in sentences", () => {
  const lamps = ["led_1", "led_10", "behind_left", "door"];
  assert.equal(
    withNames("You point 60° to the left of lamp led_10: turn right.", lamps),
    "You point 60° to the left of lamp 10: turn right.",
  );
  assert.equal(
    withNames("Lamp led_1 left, lamp behind_left and door stay, xled_1 is none.", lamps),
    "lamp 1 left, lamp behind left and door stay, xled_1 is none.",
  );
  assert.equal(withNames("Point at led_1.", []), "Point at led_1.");
});

test("the big button says what a press does now, not what the state might allow", () => {
  assert.deepEqual(["start", "cancel", "stop", "confirm", ""].map(pressWords), [
    "starts pointing",
    "calls it off",
    "stops",
    "confirms; hold it to stop",
    "hold it to stop",
  ]);
});
