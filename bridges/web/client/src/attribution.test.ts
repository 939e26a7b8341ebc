// What counts as done by this page, what another scenario would end, and the site's outage while one starts.
import assert from "node:assert/strict";
import { test } from "node:test";
import { Controls } from "./controls";
import { losses } from "./losses";
import { outage } from "./outage";
import { emptyPerson, emptySite, siteNow, type Site } from "./site/site";
import type { FindingLine, PersonLine, Status } from "./wire";

const lineOf = (user: string, moved_by: PersonLine["moved_by"], is_mine = false): PersonLine => ({
  user,
  moved_by,
  source: "device",
  is_mine,
  phone: "",
  battery: null,
  assumed: null,
});
const statusOf = (part: Partial<Status> = {}): Status => ({
  kind: "status",
  services: [],
  findings: [],
  people: [],
  viewers: 1,
  lan_url: "",
  devices: [],
  run: "runs",
  ...part,
});

function bench(): { site: Site; controls: Controls; now: () => number } {
  const site = emptySite();
  Object.assign(site, { connected: true, sentNs: 1e18, cameAt: performance.now(), status: statusOf() });
  site.people.set("user1", Object.assign(emptyPerson("user1"), { line: lineOf("user1", "own") }));
  const controls = new Controls(site, {} as never, {} as never, {} as never, () => undefined);
  return { site, controls, now: () => siteNow(site) };
}

test("what the simulated person has just selected is not praised after this page took the arm", () => {
  const { site, controls, now } = bench();
  const simulated = { user: "user1", stampNs: now() - 1e9 };
  controls.follow();
  assert.ok(!controls.isOwn(simulated), "nobody has taken it");
  site.people.get("user1")!.line = lineOf("user1", "mouse", true);
  controls.follow();
  assert.ok(!controls.isOwn(simulated), "it happened before, and is told afterwards");
  assert.ok(controls.isOwn({ user: "user1", stampNs: now() + 1e9 }));
  assert.ok(!controls.isOwn({ user: "user2", stampNs: now() + 1e9 }));
  controls.setSelected("own", true);
  site.people.get("user1")!.line = lineOf("user1", "own");
  controls.follow();
  assert.ok(!controls.isOwn({ user: "user1", stampNs: now() + 2e9 }), "it was given back");
  assert.ok(controls.hasSelected("own") && !controls.hasSelected("theirs"));
});

test("after a lost connection the same person's selections are still this page's own", () => {
  const { site, controls } = bench();
  const take = (user: string) => {
    site.people.get(user)!.line = lineOf(user, "mouse", true);
    controls.follow();
  };
  take("user1");
  controls.setSelected("own", true);
  site.people.get("user1")!.line = lineOf("user1", "own");
  controls.follow();
  take("user1");
  assert.ok(controls.hasSelected("own"));
  site.people.get("user1")!.line = lineOf("user1", "own");
  site.people.set("user2", emptyPerson("user2"));
  take("user2");
  assert.ok(!controls.hasSelected("own"));
});

test("another scenario asks first only where a person would lose something", () => {
  const { site, controls } = bench();
  const services = [{ instance: "user-sim.user1", present: true, since_s: 1 }];
  site.status = statusOf({ services, viewers: 3 });
  site.selection = {
    objects: [
      { id: "a", user: "user1" },
      { id: "b", user: "user1" },
    ],
    reserved: [],
  } as never;
  site.people.get("user1")!.line = { ...lineOf("user1", "own"), source: "simulation" };
  assert.deepEqual(losses(controls), [], "the simulated person's");
  site.people.get("user1")!.line = lineOf("user1", "mouse", true);
  controls.follow();
  controls.setSelected("b", true);
  assert.deepEqual(losses(controls), [
    "You point as user1, and lose 1 selection.",
    "2 other pages show it, too.",
  ]);
  site.people.get("user1")!.line = lineOf("user1", "phone");
  assert.deepEqual(losses(controls)[0], "user1 points with a phone, and loses 2 selections.");
  site.people.get("user1")!.line = lineOf("user1", "own");
  site.status = statusOf();
  assert.deepEqual(losses(controls), ["user1 points with their own device, and loses 2 selections."]);
});

test("services that leave or start with a scenario are no outage", () => {
  const finding = (part: Partial<FindingLine>): FindingLine => ({
    severity: "error",
    code: "unreachable",
    service: "",
    sentence: "10 of 11 services are gone together",
    remedy: "look there",
    follows: false,
    ...part,
  });
  const findings = [finding({}), finding({ service: "pui", follows: true })];
  const told = outage({ status: statusOf({ findings }) });
  assert.equal(told?.detail, "10 of 11 services are gone together; look there");
  for (const run of ["starts", "over"] as const)
    assert.equal(outage({ status: statusOf({ findings, run }) }), null);
});
