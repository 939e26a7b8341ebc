import assert from "node:assert/strict";
import { test } from "node:test";
import { renderToString } from "preact-render-to-string";

import { Controls } from "../controls";
import { emptyPerson, emptySite } from "../site/site";
import type { PersonLine } from "../wire";
import { WhoPoints } from "./who_points";

const USER = "anna";

function drawn(line: Partial<PersonLine>, deeds: readonly string[]): string {
  const site = emptySite();
  Object.assign(site, { connected: true, hello: { deeds, requests: [] } });
  const person = emptyPerson(USER);
  person.line = {
    moved_by: "own",
    source: "device",
    is_mine: false,
    phone: "",
    battery: null,
    ...line,
  } as never;
  site.people.set(USER, person);
  const controls = new Controls(site, {} as never, {} as never, {} as never, () => {});
  return renderToString(
    <WhoPoints controls={controls} mouse={{ tremor: 0 } as never} pairing={{ open: () => {} }} />,
  );
}

test("who looks on has no way to move an arm", () => {
  const page = drawn({}, []);
  assert.match(page, /anna points with their own device\./);
  assert.doesNotMatch(page, /Mouse|Phone/);
});

test("the mouse of another page can be taken over, and none is chosen", () => {
  const page = drawn({ moved_by: "mouse" }, ["take", "pair"]);
  assert.match(page, /Another page&#39;s mouse points\.|Another page's mouse points\./);
  assert.match(page, /Take over/);
  assert.doesNotMatch(page, /checked/);
});

test("a phone tells its state and its charge, and can be unpaired", () => {
  const page = drawn({ moved_by: "phone", phone: "connected", battery: 0.8 }, ["pair"]);
  assert.match(page, /A phone points \(connected, battery 80 %\)\./);
  assert.match(page, /Unpair the phone/);
  assert.doesNotMatch(page, /Show the QR code/);
});
