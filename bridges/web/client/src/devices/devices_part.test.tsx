import assert from "node:assert/strict";
import { test } from "node:test";
import { renderToString } from "preact-render-to-string";

import { Controls } from "../controls";
import { emptyPerson, emptySite, type Site } from "../site/site";
import { DeviceSession } from "./device_session";
import { Devices } from "./devices_part";

const BANDS = ["F1", "F2"].map((address) => ({
  kind: "wrist",
  plugin: "metamotion",
  address,
  label: `Band ${address}`,
  use: `--imu metamotion:${address}`,
}));

/** A site on whose page two wristbands were found, and a drawing of what it shows. */
async function withBands(): Promise<{ site: Site; drawn(): string }> {
  const site = emptySite();
  const hello = { deeds: ["find_devices", "connect_device", "forget_device"], requests: [] };
  Object.assign(site, { connected: true, hello });
  const connection = { ask: async () => ({ devices: BANDS, can_connect: true }) };
  const controls = new Controls(site, {} as never, connection as never, {} as never, () => {});
  const session = new DeviceSession(controls);
  await session.search();
  return { site, drawn: () => renderToString(<Devices session={session} fit={() => {}} />) };
}

/** Names that are proposed for who wears what was found. */
function proposed(page: string): string[] {
  return [...page.matchAll(/<input type="text" value="([^"]*)"/g)].map(([, name]) => name!);
}

function join(site: Site, user: string): void {
  site.people.set(user, emptyPerson(user));
}

function connect(site: Site, address: string, name: string): void {
  const line = { id: name, kind: "wrist", plugin: "metamotion", address, name, label: `Band ${address}` };
  site.status = { services: [], devices: [{ ...line, is_on: true, problem: "", said: "" }] } as never;
}

test("two wristbands are offered different names", async () => {
  const { site, drawn } = await withBands();
  join(site, "user1");

  assert.deepEqual(proposed(drawn()), ["user2", "user3"]);
});

test("a wristband is not offered the name of one that was just connected", async () => {
  const { site, drawn } = await withBands();
  join(site, "user1");
  connect(site, "F1", "user2");

  assert.deepEqual(proposed(drawn()), ["user3"], "before the person has come");
  join(site, "user2");
  assert.deepEqual(proposed(drawn()), ["user3"], "and afterwards");
});

test("a connected wrist can be fitted, and one that failed be connected again", async () => {
  const { site, drawn } = await withBands();
  connect(site, "F1", "user2");
  assert.match(drawn(), /Fit: how user2 wears it/);

  Object.assign(site.status!.devices[0]!, { is_on: false, problem: "the band is asleep" });
  assert.match(drawn(), /class="reason">The band is asleep/);
  assert.match(drawn(), /Connect user2 again/);
});
