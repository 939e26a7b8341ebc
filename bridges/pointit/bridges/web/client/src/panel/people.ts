/** Number of people, and whether they are localized first. Changes restart the scenario. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, folded, show } from "../dom";
import type { Scenario } from "../scenario";
import type { Part } from "./part";

const MOST = 4;

export function peoplePart(controls: Controls, scenario: Scenario): Part {
  const { site } = controls;
  const count = choice("How many", (value) => void scenario.run(controls.scenario, { users: Number(value) }),
    Array.from({ length: MOST }, (_, index) => ({ value: String(index + 1), label: String(index + 1) })));
  const finds = el("input", { type: "checkbox", onchange: () => void scenario.run(controls.scenario, { localizes: finds.checked }) });
  const found = el("label", { className: "check" }, finds, el("span", { text: "Find them by their pointing at lamps" }));
  const element = folded("People", false, count.element, found,
    el("p", { className: "muted", text: "Both options restart the scenario." }));
  return {
    element,
    update() {
      show(element, controls.may("run/scenario"));
      count.set(String(site.people.size));
      show(found, (site.map?.lamps.length ?? 0) > 0);
      if (finds.checked !== controls.localizes) finds.checked = controls.localizes;
    },
  };
}
