/** Number of people, and whether they are localized first; a button restarts the scenario with them. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, section, show, write } from "../dom";
import type { Scenario } from "../scenario";
import type { PanelPart } from "./panel_part";

const MOST = 4;

export function peoplePart(controls: Controls, scenario: Scenario): PanelPart {
  const { site } = controls;
  /** Chosen and not yet running; null: as it runs. */
  let wanted: number | null = null;
  let localizes: boolean | null = null;
  const count = choice(
    "How many",
    (value) => choose(() => (wanted = Number(value))),
    Array.from({ length: MOST }, (_, index) => ({ value: String(index + 1), label: String(index + 1) })),
  );
  const finds = el("input", { type: "checkbox", onchange: () => choose(() => (localizes = finds.checked)) });
  const found = el(
    "label",
    { className: "check" },
    finds,
    el("span", { text: "Find them by their pointing at lamps" }),
  );
  const name = el("span", {});
  const restart = el(
    "button",
    {
      type: "button",
      onclick: () => {
        scenario.run(controls.scenario, {
          ...(wanted ? { users: wanted } : {}),
          ...(localizes === null ? {} : { localizes }),
        });
      },
    },
    name,
  );
  const element = section("People", count.element, found, restart);

  function choose(set: () => void): void {
    set();
    controls.changed();
  }

  return {
    element,
    update() {
      show(element, controls.may("run/scenario"));
      if (wanted === site.people.size || site.status?.run !== "runs") wanted = null;
      if (localizes === controls.localizes || site.status?.run !== "runs") localizes = null;
      count.set(String(wanted ?? site.people.size));
      show(found, (site.map?.lamps.length ?? 0) > 0);
      finds.checked = localizes ?? controls.localizes;
      const people = wanted ?? site.people.size;
      show(restart, wanted !== null || localizes !== null);
      write(
        name,
        `Restart with ${people === 1 ? "1 person" : `${people} people`}${localizes === null ? "" : localizes ? ", found by pointing" : ", at known places"}`,
      );
    },
  };
}
