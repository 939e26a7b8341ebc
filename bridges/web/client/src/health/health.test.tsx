import assert from "node:assert/strict";
import { test } from "node:test";
import { renderToString } from "preact-render-to-string";

import type { Controls } from "../controls";
import { emptySite, type Site } from "../site/site";
import { LatencyHistory } from "../site/timing";
import { Health, Sentence } from "./health";
import { lineThrough, ticksTo } from "./latency_graph";

const USER = "anna";

function drawn(site: Site): string {
  const controls = { site, user: USER, connection: { latency: new LatencyHistory() } } as unknown as Controls;
  return renderToString(<Health controls={controls} stats={null} now={0} />);
}

function withFigures(service: string, figures: Record<string, number>): Site {
  const site = emptySite();
  const listed = Object.entries(figures).map(([name, value]) => ({ name, value, unit: "" }));
  site.health.set(`${service}.${USER}`, {
    user: USER,
    keys: [],
    errors: 0,
    figures: listed,
  } as never);
  return site;
}

test("a site of which nothing is known has dashes, and no part of what nobody measures", () => {
  const page = drawn(emptySite());
  assert.match(page, /<dt>wrist<\/dt><dd>–<\/dd>/);
  assert.match(page, /Nothing is wrong\./);
  assert.doesNotMatch(page, /How surely they point|The device on their wrist/);
});

test("figures have units that people read", () => {
  const page = drawn(withFigures("localizer", { "position σ": 0.12, "yaw σ": 1.25, "anchor age": 125 }));
  assert.match(page, /place ±<\/dt><dd>12 cm/);
  assert.match(page, /direction ±<\/dt><dd>1\.3°/);
  assert.match(page, /set right<\/dt><dd>2 min ago/);
  assert.match(page, /drift<\/dt><dd>–/);
});

test("a gap has its length, if there was one", () => {
  assert.match(drawn(withFigures("imu-bridge", { rate: 99, gaps: 3, "latest gap": 40 })), /3\.0\/min, 40 ms/);
  assert.match(drawn(withFigures("imu-bridge", { rate: 99, gaps: 0, "latest gap": 40 })), /<dd>0\/min<\/dd>/);
});

test("a warning has its remedy, and what follows from it is folded", () => {
  const site = emptySite();
  const finding = { severity: "warning", service: "pui", sentence: "No map.", remedy: "Load one." };
  site.status = {
    services: [],
    viewers: 2,
    findings: [
      { ...finding, follows: false },
      { ...finding, sentence: "No cursor.", remedy: "", follows: true },
    ],
  } as never;
  const page = drawn(site);
  assert.match(page, /Warning: pui<\/strong><p>No map\.<\/p><p class="muted">Load one\./);
  assert.match(page, /<details><summary>What follows from it<\/summary>.*No cursor\./);
  assert.match(page, /2 pages look on/);
});

test("an axis has round ticks, and a line has gaps", () => {
  assert.deepEqual(ticksTo(40), [0, 10, 20, 30, 40]);
  const same = (value: number): number => value;
  assert.equal(lineThrough([1, null, 2, 3], same, same), "M0.0 1.0M2.0 2.0L3.0 3.0");
});

test("a sentence has a capital, a full stop, and words of programs without backticks", () => {
  const page = renderToString(<Sentence text="process 12 is slow: run `top`" />);
  assert.equal(page, "Process 12 is slow: run <code>top</code>.");
});

test("services are grouped by person, folded while all of a person are up", () => {
  const site = emptySite();
  const service = (instance: string, present: boolean) => ({ instance, present, since_s: 7 });
  const services = [
    service("pui", true),
    service("pointing.anna", true),
    service("localizer.anna", true),
    service("pointing.bob", false),
    service("localizer.bob", true),
  ];
  site.status = { services, findings: [] } as never;
  const page = drawn(site);
  assert.match(page, /<details class="services"><summary>.*<span>anna<\/span><span class="muted">2 up/);
  assert.match(
    page,
    /<details class="services" open[^>]*><summary>.*bob<\/span><span class="muted">1 of 2 up/,
  );
  assert.match(page, /<li data-up="false">.*<span>pointing<\/span><span class="muted">down 7 s/);
});
