import assert from "node:assert/strict";
import { test } from "node:test";

import type { HomeLamp, HomeSetup } from "../messages";
import {
  brokerOf,
  byArea,
  cardOf,
  countOf,
  handText,
  addressOf,
  homeKindOf,
  isBroker,
  isFound,
  lampText,
  profileOf,
  repeatText,
  sentence,
  stateText,
  stepBefore,
} from "./setup_words";

const lamp = (id: string, fields: Partial<HomeLamp> = {}): HomeLamp => ({
  id,
  label: id.toUpperCase(),
  area: "",
  state: "on",
  is_chosen: true,
  is_new: false,
  is_placed: false,
  places: 0,
  direction_sigma_rad: null,
  quality: "",
  kind: "lamp",
  is_met: false,
  reason: "",
  ...fields,
});
const setup = (fields: Partial<HomeSetup> = {}): HomeSetup => ({
  step: "place",
  url: "",
  has_token: true,
  is_connected: true,
  problem: "",
  lamps: [lamp("a"), lamp("b")],
  hand: "phone",
  user: "anna",
  place: "A",
  target: "a",
  end: "",
  is_aligning: false,
  may_walk: false,
  can_take_back: false,
  is_lit: true,
  goes_off: false,
  map: "",
  places_m: [],
  poses: 0,
  pose_m: null,
  pose_yaw_rad: 0,
  advice: [],
  next_step: "",
  choices: [],
  tried: "",
  beside: "",
  is_short_walk: false,
  is_waiting: false,
  may_repeat: [],
  message: "",
  ...fields,
});

test("card follows the step, the walk and the alignment", () => {
  assert.equal(cardOf(setup()), "place");
  assert.equal(cardOf(setup({ may_walk: true })), "walk");
  assert.equal(cardOf(setup({ is_aligning: true })), "align");
  assert.equal(cardOf(setup({ step: "done" })), "");
  assert.equal(countOf(setup()), "Step 4 of 5");
  assert.equal(stepBefore(setup()), "hand");
  assert.equal(stepBefore(setup({ step: "connect" })), null);
});

test("summary counts the lamps of this place", () => {
  const lamps = [lamp("a", { places: 2 }), lamp("b", { places: 1 })];
  assert.equal(repeatText(setup({ lamps })), "2 of 2 from your first place. One again?");
  assert.equal(repeatText(setup({ lamps, place: "B" })), "1 of 2 from your second place. One again?");
});

test("lamp says how well it is known in words, or why it is not placed", () => {
  assert.equal(lampText(lamp("a", { is_placed: true, quality: "good" })), "A: good");
  assert.equal(lampText(lamp("a", { is_placed: true, quality: "again" })), "A: not sure, point at it again");
  assert.equal(lampText(lamp("a", { reason: "you left it out" })), "A: you left it out");
});

test("address of a broker is recognised in any card, and gets its scheme", () => {
  assert.equal(homeKindOf("192.168.77.1:1883"), "broker");
  assert.equal(homeKindOf("192.168.77.1"), "");
  assert.equal(addressOf("192.168.77.1", "broker"), "mqtt://192.168.77.1");
  assert.equal(addressOf("http://192.168.77.1:1883", "broker"), "mqtt://192.168.77.1:1883");
  assert.equal(addressOf("mqtts://anna@hub", "broker"), "mqtts://anna@hub");
  assert.equal(addressOf(" 192.168.77.1 ", "home"), "192.168.77.1");
});

test("search finds lamps by words of their name and area", () => {
  const shelf = lamp("a", { label: "Shelf lamp", area: "Living room" });
  assert.ok(isFound(shelf, "living shelf"));
  assert.ok(isFound(shelf, ""));
  assert.ok(!isFound(shelf, "kitchen"));
});

test("lamps without an area come last", () => {
  assert.deepEqual(
    byArea([lamp("a"), lamp("b", { area: "Kitchen" })]).map(([area]) => area),
    ["Kitchen", ""],
  );
});

test("profile is linked for addresses of the web only", () => {
  assert.equal(profileOf("http://ha.local:8123/x"), "http://ha.local:8123/profile/security");
  assert.equal(profileOf("ha.local:8123"), "http://ha.local:8123/profile/security");
  assert.equal(profileOf("javascript://alert(1)"), "");
  assert.equal(profileOf("http://"), "");
});

test("reason ends with one full stop, and a scene's time is no state", () => {
  assert.equal(sentence("choose at least one lamp"), "Choose at least one lamp.");
  assert.equal(sentence("Is it on?"), "Is it on?");
  assert.equal(sentence(""), "");
  assert.equal(stateText("2026-11-30T01:00:00+00:00"), "");
  assert.equal(stateText("unavailable"), "unavailable");
});

test("phone that is not paired is said, and one that points", () => {
  assert.equal(handText("phone", null), "No phone is paired yet.");
  assert.equal(handText("phone", { moved_by: "phone", phone: "connected" }), "The phone points.");
});

test("address of a broker is told from that of a web server by its scheme", () => {
  for (const url of ["mqtt://hub", " MQTTS://anna@hub:8883", "tcp://hub"]) assert.ok(isBroker(url), url);
  for (const url of ["http://hub", "hub:1883", "mqtt.local:8123"]) assert.ok(!isBroker(url), url);
  assert.equal(brokerOf("hub:1884"), "mqtt://hub:1884");
  assert.equal(brokerOf("mqtts://hub"), "mqtts://hub");
});
