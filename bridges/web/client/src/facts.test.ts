// The site as facts of the card's table.
import assert from "node:assert/strict";
import { test } from "node:test";
import { Controls } from "./controls";
import { factsOf } from "./facts";
import { guidance } from "./guidance";
import type { ActState, Hover } from "./messages";
import { emptyPerson, emptySite } from "./site/site";

const S = 1e9;
const HOVER: Hover = {
  act_ns: null,
  action: "select",
  is_selected: false,
  miss_rad: 0,
  object_id: "movie",
  progress: 0.4,
  seq: 0,
  snapped_m: null,
  snapped_position_m: null,
  stamp_ns: 10 * S,
  taken_by: "",
};
const ACT: ActState = {
  object_id: "movie",
  user: "ada",
  event_ns: 11 * S,
  asked_ns: 11 * S,
  effect: "select",
  status: "done",
  code: "",
  text: "",
};

function home() {
  const site = emptySite();
  const ada = emptyPerson("ada");
  const object = { kind: "Movie", mode: "button", surface: "none", size_m: [1, 1, 1], press: false, bay: "" };
  const controls = new Controls(site, {} as never, {} as never, {} as never, () => {});
  Object.assign(site, {
    connected: true,
    hello: { deeds: ["take", "pair"], requests: [] },
    status: { services: [{ instance: "selector", present: true, since_s: 60 }] },
  });
  Object.assign(ada, {
    line: { user: "ada", moved_by: "mouse", is_mine: true, source: "none" },
    hover: HOVER,
    interaction: { state: "pointing", next_step: "next", press: "" },
  });
  site.people.set("ada", ada);
  site.objects.set("things", {
    objects: [
      { ...object, id: "movie" },
      { ...object, id: "radio", kind: "Radio", mode: "switch" },
    ],
  } as never);
  const card = (hover: Partial<Hover> = {}): string => {
    ada.hover = { ...HOVER, ...hover };
    const { facts, words } = factsOf(controls, ada, false, null);
    return guidance(facts, words).text;
  };
  return { site, ada, controls, card };
}

test("what came of an act stays while one is on the thing, and another visit starts without it", () => {
  const { site, card } = home();
  const there = { action: "", act_ns: 11 * S } as const;
  const tell = (...acts: Partial<ActState>[]): void => {
    site.selection = { objects: [], reserved: [], acts: acts.map((act) => ({ ...ACT, ...act })) } as never;
  };
  assert.equal(card(), "Movie: stay on it …");
  tell({ status: "failed", text: "no Home Assistant answers: start it" });
  assert.equal(card(there), "Movie did not change: no Home Assistant answers: start it");
  assert.equal(card({ action: "" }), "Movie: leave it, then point at it again.", "that was an earlier visit");
  tell({ status: "done" });
  assert.equal(card(there), "Movie has fired. Continue with the next one.");
  tell({ status: "pending" });
  assert.equal(card(there), "Movie has started; its result follows.");
  tell({ status: "unanswered", text: "reactions did not report the result in time" });
  assert.equal(card(there), "Movie did not answer: reactions did not report the result in time");
  tell({ user: "ben", status: "failed", text: "of another" });
  assert.equal(card(there), "Movie: in progress …", "the selector has not told of it yet");
});

test("an act is only asked until the selector tells of it, whatever is selected and whatever came before", () => {
  const { site, card } = home();
  const there = { action: "", act_ns: 12 * S } as const;
  site.selection = {
    objects: [{ id: "movie", user: "ada", is_pending: false }],
    reserved: [],
    acts: [ACT],
  } as never;
  assert.equal(card(there), "Movie: in progress …", "what was done is an earlier act");
});

test("a switch that was changed since an act is not told as that act left it", () => {
  const { site, card } = home();
  const radio = { object_id: "radio", action: "", act_ns: 11 * S } as const;
  const acts = [{ ...ACT, object_id: "radio" }];
  site.selection = { objects: [{ id: "radio", user: "ada" }], reserved: [], acts } as never;
  assert.equal(card(radio), "Radio is on. Continue with the next one.");
  site.selection = { objects: [], reserved: [], acts } as never;
  assert.equal(card(radio), "Radio: leave it, then point at it again.", "it was switched off at its place");
});

test("an unavailable thing is said to be so before, during and after an act", () => {
  const { site, card } = home();
  site.carriers.set("ha", {
    things: [{ id: "movie", state: "unavailable", reason: "its lamp is off: switch it on" }],
  } as never);
  for (const action of ["refuse", "", "select"] as const)
    assert.equal(card({ action }), "Movie is unavailable: its lamp is off: switch it on");
});

test("a switch that is on, under way or not wanted has its own words", () => {
  const { site, controls, card } = home();
  const radio = { object_id: "radio" };
  site.selection = { objects: [{ id: "radio", user: "ada", is_pending: true }], reserved: [] } as never;
  assert.equal(card({ ...radio, action: "" }), "Radio: in progress …");
  site.selection = { objects: [{ id: "radio", user: "ben" }], reserved: [] } as never;
  assert.equal(
    card({ ...radio, action: "", is_selected: true }),
    "Radio: leave it, then point at it again.",
    "others have switched it on",
  );
  assert.equal(
    card({ ...radio, action: "deselect", is_selected: true }),
    "Radio is on; staying switches it off.",
  );
  site.deployments.set("run.a", {
    target_kinds: ["Movie"],
    services: [],
    scenarios: [],
    goal: "Point at Movie.",
  } as never);
  site.selection = null;
  assert.equal(
    card(radio),
    "Radio should not be selected, but staying on it selects it. Move on to the Movie ones.",
  );
  assert.equal(controls.goal, "Point at Movie.");
});

test("what selects here is what the selector says, or the thing, or names", () => {
  const { site, ada, card } = home();
  site.manner = {
    by: "stay",
    pressed: ["the kettle"],
    pressed_count: 3,
    names_by: null,
    seq: 0,
    stamp_ns: 0,
  };
  assert.equal(
    card({ object_id: "" }),
    "Move onto a thing and stay on it until it is full. For the kettle, 2 more, press the button.",
  );
  site.manner = { by: "press", pressed: [], pressed_count: 0, names_by: null, seq: 0, stamp_ns: 0 };
  assert.equal(card(), "Movie: press the button.");
  ada.announced = { object_id: "" } as never;
  assert.equal(card(), "Movie: press once you have heard its name.");
});

test("who has the arm is said by the server", () => {
  const { ada, controls } = home();
  const who = (moved_by: string, source: string, is_mine = false) => {
    ada.line = { user: "ada", moved_by, source, is_mine } as never;
    return factsOf(controls, ada, false, null).facts.who;
  };
  assert.deepEqual(
    [who("own", "none"), who("own", "device"), who("own", "simulation")],
    ["nobody", "device", "simulation"],
  );
  assert.deepEqual(
    [who("mouse", "none"), who("mouse", "simulation", true), who("phone", "none"), who("headset", "device")],
    ["mouse", "me", "phone", "headset"],
  );
});
