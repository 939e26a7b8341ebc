import assert from "node:assert/strict";
import { test } from "node:test";
import { render } from "preact-render-to-string";

import type { HomeLamp } from "../messages";
import { roomsOf, type HomeThing } from "./home_rooms";
import { HomeView } from "./home_view";

const lamp = (id: string, label: string, area: string, fields: Partial<HomeLamp> = {}): HomeLamp => ({
  id,
  label,
  area,
  state: "on",
  is_chosen: true,
  is_new: false,
  is_placed: true,
  places: 2,
  direction_sigma_rad: 0.05,
  quality: "good",
  kind: "lamp",
  is_met: true,
  reason: "",
  ...fields,
});
const thing = (id: string, name: string, isOn = false): HomeThing => ({
  id,
  name,
  isOn,
  state: isOn ? "on" : "off",
  canBeTried: true,
});
const LAMPS = [
  lamp("light.desk", "Desk lamp", "Study", { kind: "spot" }),
  lamp("light.sofa", "Sofa", "Living room", { quality: "again" }),
  lamp("light.hall", "Hall", "Living room", { is_chosen: false }),
];
const THINGS = [thing("desk", "Desk lamp", true), thing("sofa", "Sofa"), thing("radio", "Radio")];

test("things stand by room, those of no lamp last", () => {
  const rooms = roomsOf(THINGS, LAMPS).map(([room, tiles]) => [room, tiles.map(({ name }) => name)]);
  assert.deepEqual(rooms, [
    ["Living room", ["Sofa"]],
    ["Study", ["Desk lamp"]],
    ["", ["Radio"]],
  ]);
});

test("view shows rooms, a switch a lamp, and what to press", () => {
  const nothing = (): void => undefined;
  const page = render(
    <HomeView
      lamps={LAMPS}
      things={THINGS}
      pointing={{ title: "Nobody points", next: "Pair a phone to begin." }}
      added={["Attic"]}
      switchThing={nothing}
      pair={nothing}
      placeAgain={nothing}
      addLamps={nothing}
      showAdvanced={nothing}
    />,
  );
  assert.match(page, /<h3>Living room<\/h3>/);
  assert.match(page, /role="switch" aria-checked="true" aria-label="Desk lamp"/);
  assert.match(page, /icon-spot/);
  assert.match(page, /place it again/);
  assert.match(page, /New lamps: Attic/);
  for (const name of ["Place again", "Add lamps", "Advanced", "Point with a phone"])
    assert.ok(page.includes(name), name);
  assert.ok(!/ms|latency|\bcm\b|sigma/i.test(page.replaceAll(/class="[^"]*"|lamps/gi, "")));
});
