/** How many people there are, and whether the system has to find them first: the scenario is started anew. */

import { choice } from "../choice";
import type { Desk } from "../desk";
import { el, folded, show } from "../dom";
import type { Scenario } from "../scenario";
import type { Part } from "./part";

const MOST = 4;

export function peoplePart(desk: Desk, scenario: Scenario): Part {
  const { site } = desk;
  const count = choice("How many", (value) => void scenario.run(desk.scenario, { users: Number(value) }),
    Array.from({ length: MOST }, (_, index) => ({ value: String(index + 1), label: String(index + 1) })));
  const finds = el("input", { type: "checkbox", onchange: () => void scenario.run(desk.scenario, { localizes: finds.checked }) });
  const found = el("label", { className: "check" }, finds, el("span", { text: "Find them by their pointing at lamps" }));
  const element = folded("People", false, count.element, found,
    el("p", { className: "muted", text: "Both start the scenario anew." }));
  return {
    element,
    update() {
      show(element, desk.may("run/scenario"));
      count.set(String(site.people.size));
      show(found, (site.map?.lamps.length ?? 0) > 0);
      if (finds.checked !== desk.localizes) finds.checked = desk.localizes;
    },
  };
}
