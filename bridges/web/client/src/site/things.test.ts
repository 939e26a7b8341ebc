import assert from "node:assert/strict";
import { test } from "node:test";
import { encode } from "@msgpack/msgpack";
import type { SelectionEvent, Thing, TrackedObject } from "../messages";
import { Keeper } from "./apply";
import type { Item } from "./batch";
import { emptyPerson, emptySite, type Site } from "./site";
import { darkLamps, hasSelected, noteChange, problemsOfThings, thingTiles } from "./things";

const S = 1e9;

function site(): Site {
  const all = emptySite();
  const thing = { dwell_s: null, label: "", press: false } as Thing;
  const map = {
    things: [
      { ...thing, id: "screws", mode: "button" },
      { ...thing, id: "radio", mode: "switch", dwell_s: 2 },
      { ...thing, id: "kettle", label: "the kettle", mode: "button", press: true },
      { ...thing, id: "box_2", mode: "claim" },
    ],
  };
  const objects = map.things
    .slice(0, 3)
    .map(
      ({ id, mode, label }) =>
        ({ id, mode, kind: label || id, surface: "none", size_m: [1, 1, 1] }) as unknown as TrackedObject,
    );
  const services = [{ instance: "selector", present: true, since_s: 60 }];
  Object.assign(all, { map, sentNs: 100 * S, cameAt: performance.now(), status: { services } });
  all.objects.set("things", { objects } as never);
  return all;
}

const event = (
  what: "selected" | "deselected",
  id: string,
  user: string,
  at_s: number,
  cause: SelectionEvent["cause"] = "dwell",
): SelectionEvent => ({
  event: what,
  object_id: id,
  user,
  cause,
  stamp_ns: at_s * S,
  kind: id,
  reason: "",
  bay: "",
  confidence: null,
  seq: 0,
  carriers: [],
  status: "done",
  begin_within_s: null,
});

function select(all: Site, id: string, user: string, at_s: number): void {
  noteChange(all, event("selected", id, user, at_s));
  all.selection = { objects: [{ id, user }], reserved: [] } as never;
}

test("a tile shows the state of its thing, what it does, and who fired it last", () => {
  const all = site();
  assert.deepEqual(
    thingTiles(all).map(({ name, state, canBeTried }) => [name, state, canBeTried]),
    [
      ["Screws", "Ready", true],
      ["Radio", "Off", true],
      ["The kettle", "Ready", true],
      ["Thing 2", "Not in the room now", false],
    ],
  );
  assert.deepEqual(
    thingTiles(all).map(({ does }) => does),
    [
      "Fires when somebody stays on it.",
      "Switches when somebody stays on it for 2 s.",
      "Fires on a press while somebody points at it.",
      "Is taken, and given back, when somebody stays on it.",
    ],
  );
  assert.deepEqual(
    thingTiles(all).map(({ last }) => last),
    ["Not fired yet.", "Not used yet.", "Not fired yet.", "Not used yet."],
  );
  select(all, "screws", "anna", 88);
  assert.deepEqual(
    [thingTiles(all)[0]!.state, thingTiles(all)[0]!.isOn, thingTiles(all)[0]!.last],
    ["Fired", true, "Fired by anna 12 s ago."],
  );
  noteChange(all, event("deselected", "screws", "anna", 89, "")); // a button goes off by itself
  noteChange(all, event("deselected", "radio", "bob", 99.5));
  noteChange(all, { ...event("selected", "kettle", "bob", 99), event: "refused" });
  all.selection = null;
  assert.deepEqual(
    thingTiles(all)
      .slice(0, 3)
      .map(({ last }) => last),
    ["Fired by anna 12 s ago.", "Switched off by bob just now.", "Not fired yet."],
  );
});

test("a tile shows who points at its thing", () => {
  const all = site();
  all.people.set(
    "anna",
    Object.assign(emptyPerson("anna"), { hover: { object_id: "radio", progress: 0.4 } }),
  );
  assert.deepEqual(
    [thingTiles(all)[1]!.state, thingTiles(all)[1]!.progress, thingTiles(all)[0]!.progress],
    ["Off: anna points at it", 0.4, null],
  );
});

const encoded = (topic: string, message: object, name = ""): Item =>
  ({ topic, name, payload: encode(message) }) as Item;

test("a tile says that its thing is unavailable and why, and that an act is under way", () => {
  const all = site();
  const things = [{ id: "radio", state: "unavailable", reason: "no power: switch it on", limit_s: 5 }];
  new Keeper(all).take(encoded("things/{carrier}", { things }, "home-assistant"), 0);
  assert.deepEqual(
    [thingTiles(all)[1]!.state, thingTiles(all)[1]!.problem],
    ["Unavailable", "no power: switch it on"],
  );
  const problems = (tiles: Parameters<typeof problemsOfThings>[0]): string[] =>
    problemsOfThings(tiles).map(({ text }) => text);
  assert.deepEqual(problems(thingTiles(all)), ["Radio unavailable: no power: switch it on"], "once for all");
  const off = { problem: "off", isStarting: false };
  assert.deepEqual(
    problems([
      { name: "A", ...off },
      { name: "B", ...off },
    ]),
    ["Everything unavailable: off"],
  );
  new Keeper(all).take(
    encoded("things/{carrier}", { things: [{ ...things[0], is_starting: true }] }, "home-assistant"),
    0,
  );
  assert.deepEqual(
    [thingTiles(all)[1]!.state, problems(thingTiles(all))],
    ["Starting …", ["Radio starting: no power: switch it on"]],
  );
  all.carriers.clear();
  all.selection = { objects: [{ id: "radio", user: "anna", is_pending: true }], reserved: [] } as never;
  assert.deepEqual([thingTiles(all)[1]!.state, thingTiles(all)[1]!.isOn], ["Under way …", false]);
  const act = { object_id: "radio", user: "anna", effect: "select", status: "pending" };
  all.selection = { objects: [{ id: "radio", user: "anna" }], reserved: [], acts: [act] } as never;
  assert.deepEqual([thingTiles(all)[1]!.state, thingTiles(all)[1]!.isOn], ["Under way …", false]);
  noteChange(all, { ...event("selected", "radio", "anna", 99), status: "pending" });
  assert.equal(thingTiles(all)[1]!.last, "Started by anna just now.");
});

test("the lamp of an unavailable thing is not drawn as lit", () => {
  const map = {
    things: [
      { id: "radio", lamp: "radio_lamp" },
      { id: "desk", lamp: "desk_lamp" },
      { id: "box", lamp: "" },
    ],
  } as never;
  const carriers = new Map([
    [
      "home-assistant",
      {
        things: [
          { id: "radio", state: "unavailable" },
          { id: "desk", state: "on" },
          { id: "box", state: "unavailable" },
        ],
      },
    ],
  ]) as never;
  assert.deepEqual([...darkLamps({ map, carriers })], ["radio_lamp"]);
});

test("only what can be cleared is offered: nothing of a button, or of others", () => {
  const all = site();
  assert.equal(hasSelected(all, "anna"), false);
  select(all, "screws", "anna", 90);
  assert.equal(hasSelected(all, "anna"), false, "a button");
  select(all, "radio", "bob", 91);
  assert.equal(hasSelected(all, "anna"), false, "another's");
  select(all, "radio", "anna", 92);
  assert.equal(hasSelected(all, "anna"), true);
});

test("an object on its last way cannot be cleared any more", () => {
  const all = site();
  const object = {
    id: "red-1",
    mode: "claim",
    kind: "red",
    surface: "belt",
    bay: "1",
    bay_until_ns: 0,
  } as unknown as TrackedObject;
  all.objects.set("belt", { objects: [object] } as never);
  select(all, "red-1", "anna", 92);
  assert.equal(hasSelected(all, "anna"), false);
  all.objects.set("belt", { objects: [{ ...object, bay_until_ns: 200 * S }] } as never);
  assert.equal(hasSelected(all, "anna"), true);
});
