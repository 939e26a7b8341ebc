import assert from "node:assert/strict";
import { test } from "node:test";
import { renderToString } from "preact-render-to-string";

import { Belts, BeltsView } from "../belts/belts";
import { Controls } from "../controls";
import { Messages } from "../health/messages";
import { Now } from "../people/now";
import { Robots } from "../robots/robots";
import { note } from "../site/log";
import { emptyPerson, emptySite, type Site } from "../site/site";

const USER = "anna";

/** Controls of a connected site at which this page may do what is named. */
function controlsOf(site: Site, requests: string[] = [], deeds: string[] = []): Controls {
  const services = ["conveyor-sim", "selector"].map((instance) => ({ instance, present: true, since_s: 9 }));
  const hello = { deeds, requests, role: "operator" };
  Object.assign(site, {
    connected: true,
    hello,
    status: { run: "runs", services, findings: [], devices: [] },
  });
  return new Controls(site, {} as never, {} as never, {} as never, () => {});
}

function withPerson(line: object): Site {
  const site = emptySite();
  const person = emptyPerson(USER);
  Object.assign(person, { line, interaction: { state: "pointing", press: "Stop pointing" } });
  site.people.set(USER, person);
  return site;
}

test("the button of a wrist is quiet while a simulation points", () => {
  const drawn = (line: object): string =>
    renderToString(<Now controls={controlsOf(withPerson(line), [], ["press"])} />);
  const primary = /class="primary press"/;

  assert.match(drawn({ moved_by: "own", source: "device" }), primary);
  assert.doesNotMatch(drawn({ moved_by: "own", source: "simulation" }), primary);
});

test("what cannot be taken back is off and says so", () => {
  const site = withPerson({ moved_by: "own", source: "device" });
  const page = renderToString(<Now controls={controlsOf(site, ["selector/{user}/undo"])} />);
  assert.match(page, /title="There is nothing to undo"[^>]*aria-disabled="true"/);
  assert.doesNotMatch(page, /Clear/);
});

test("the belts have the kinds that came, and their counts at bays", () => {
  const site = emptySite();
  const bays = [
    { bay: "2", kind: "red", count: 3, selected: 1 },
    { bay: "1", kind: "blue", count: 1, selected: 0 },
  ];
  site.conveyor = { speed_mps: 0, feeding: true, step: "end", bays } as never;
  const controls = controlsOf(site, ["conveyor/set_speed", "conveyor/set_feeding", "conveyor/add_package"]);
  const page = renderToString(<BeltsView controls={controls} belts={new Belts(controls)} />);

  assert.match(page, /Start the belts/);
  assert.match(page, /Feed again/);
  assert.doesNotMatch(page, /Green/);
  assert.match(page, /<th scope="row">1<\/th><td>1<\/td><td>–<\/td><\/tr><tr><th scope="row">2/);
});

test("robots stand in the order of their names, with the reason of a stop", () => {
  const site = emptySite();
  for (const name of ["robot10", "robot2"]) {
    const state = {
      name,
      kind: "ground",
      phase: "stopped",
      user: "",
      reason: "a person is near",
      position_m: [0, 0, 0],
      target_m: null,
      battery: null,
    };
    site.robots.set(name, { name, state, plan: null, heardAt: performance.now() } as never);
  }
  const page = renderToString(<Robots controls={controlsOf(site, ["robots/{robot}/stop"])} />);
  assert.match(page, /Stop robot2[^]*Stop robot10/);
  assert.match(page, /<p class="reason">a person is near/);
});

test("the newest message is the first, and its severity is read out", () => {
  const site = emptySite();
  note(site, "info", "", "Nothing to see");
  note(site, "warning", "pui", "No map");
  const page = renderToString(<Messages controls={controlsOf(site)} />);
  assert.match(page, /<b>pui<\/b> No map<span class="unseen"> \(warning\)[^]*Nothing to see/);
});
