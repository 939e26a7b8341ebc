import assert from "node:assert/strict";
import { test } from "node:test";
import { encode } from "@msgpack/msgpack";
import { Keeper } from "../site/apply";
import { decodeBatch, Pending } from "../site/batch";
import { note } from "../site/log";
import { emptySite, isHeard, position } from "../site/site";
import { SiteClock } from "../site/timing";
import type { TimelineLane } from "../wire";
import { clock, eventFrom, outline, spoken, textAt, ticks } from "./lanes";

const lane = (kind: TimelineLane["kind"], user: string, ...items: TimelineLane["items"]): TimelineLane => ({
  kind,
  user,
  items,
});
const LANES = [
  lane("interaction", "anna", [1, 20, "pointing"]),
  lane("hover", "anna", [2, 3, "red 7"], [8, 9, "red 8"]),
  lane("selections", "anna", [9.5, 9.5, "selected red 7"]),
  lane("misses", "", [9.501, 9.501, "red 9 left"]),
];

test("intervals are areas, instants lines; both are stretched over the length", () => {
  assert.equal(
    outline(
      [
        [0, 5, "a"],
        [7.5, 7.5, "b"],
      ],
      10,
    ),
    "M0 0V10H500V0ZM750 0V10",
  );
  assert.equal(outline([], 0), "");
});

test("a step goes to the next event, or the one before, and not to what is only hovered over", () => {
  assert.deepEqual(eventFrom(LANES, 0, 1), { at: 1, text: "anna: pointing" });
  assert.deepEqual(eventFrom(LANES, 1, 1), { at: 9.5, text: "anna: selected red 7; red 9 left" });
  assert.equal(eventFrom(LANES, 9.6, 1), null);
  assert.deepEqual(eventFrom(LANES, 9.5, -1), { at: 1, text: "anna: pointing" });
  assert.equal(eventFrom(LANES, 1, -1), null);
});

test("the pointer names what is under it, or near", () => {
  assert.equal(textAt(LANES[1]!, 2.5, 0.1), "red 7");
  assert.equal(textAt(LANES[1]!, 3.05, 0.1), "red 7");
  assert.equal(textAt(LANES[1]!, 5, 0.1), "");
  assert.equal(textAt(LANES[2]!, 9.45, 0.1), "selected red 7");
});

test("ticks are at round times and no more than fit", () => {
  assert.deepEqual(ticks(25.4, 6), [0, 5, 10, 15, 20, 25]);
  assert.deepEqual(ticks(3600, 4), [0, 1200, 2400, 3600]);
  for (const length of [0, 0.3, 59, 61, 3725, 1e5, 1e6])
    for (const most of [2, 5, 20]) assert.ok(ticks(length, most).length <= most + 1, `${length}`);
  assert.deepEqual(ticks(0, 5), [0]);
});

test("positions as they are shown and read out", () => {
  assert.deepEqual([0, 67.26, 3727, 59.96, -1].map(clock), [
    "0:00.0",
    "1:07.3",
    "1:02:07.0",
    "1:00.0",
    "0:00.0",
  ]);
  assert.deepEqual([7.25, 67].map(spoken), ["7.3 s", "1 min 7.0 s"]);
});

test("the position stands while the past is paused, and stays within its length", () => {
  const site = emptySite();
  assert.equal(position(site), 0);
  site.timeline = {
    kind: "timeline",
    title: "lab.mcap",
    began_ns: 1e18,
    length_s: 60,
    read_s: 60,
    problem: "",
    lanes: LANES,
  };
  Object.assign(site, { sentNs: 1e18 + 12e9, cameAt: performance.now() - 5000, speed: 0 });
  assert.equal(position(site), 12);
  site.speed = 100;
  assert.equal(position(site), 60);
});

test("a batch of a past that stands still has come when it came", () => {
  const times = new SiteClock();
  assert.equal(times.heard(1e18, 0, 123), 123);
  assert.equal(times.heard(1e18, 0, 456), 456);
});

test("cursors do not age while the past is paused, and are as old as they were after a jump", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  const cursor = { topic: "users/{user}/cursor", name: "anna", payload: encode({ stamp_ns: 5e9, seq: 1 }) };
  site.timeline = {
    kind: "timeline",
    title: "",
    began_ns: 0,
    length_s: 60,
    read_s: 60,
    problem: "",
    lanes: [],
  };
  Object.assign(site, { sentNs: 5.1e9, speed: 0 });
  keeper.take(cursor, 1000);
  keeper.hold(1000, 9000);
  assert.ok(isHeard(keeper.person("anna"), 9000));
  site.sentNs = 8e9;
  keeper.take(cursor, 9000);
  assert.ok(!isHeard(keeper.person("anna"), 9000));
});

test("a jump forgets the log and what is about to be told, but no state", () => {
  const site = emptySite();
  const keeper = new Keeper(site);
  const pending = new Pending();
  note(site, "info", "anna", "selected red 7");
  const before = site.logged;
  pending.add(
    decodeBatch(
      encode([2, 0, 1, [["map", "", encode({ name: "lab" })]], [["selection/events", "", encode({})]], 0]),
    ),
  );
  pending.forgetEvents();
  keeper.jumped();
  assert.deepEqual([site.log.length, site.logged > before], [0, true]);
  const { states, events } = pending.take();
  assert.deepEqual([states.length, events.length], [1, 0]);
});

test("lines of the log have the time of the past that is played", () => {
  const site = emptySite();
  site.timeline = {
    kind: "timeline",
    title: "",
    began_ns: 1.7e18,
    length_s: 60,
    read_s: 60,
    problem: "",
    lanes: [],
  };
  Object.assign(site, { sentNs: 1.7e18 + 3e9, speed: 0 });
  note(site, "info", "anna", "came");
  assert.equal(site.log[0]!.at, 1.7e12 + 3000);
});
