/** Selection of the scenario in the header, and the progress of its start over the scene. */

import type { Controls } from "./controls";
import { el, renew, show, write } from "./dom";
import { scenarioTitle } from "./words";

/** Timeout of a scenario's start, ms. */
const PATIENCE_MS = 45_000;

export interface Scenario {
  update(): void;
  /** Start another scenario, or restart it with other options; missing ones stay as they are. */
  run(scenario: string, as?: { users?: number; localizes?: boolean }): Promise<void>;
}

/**
 * @param host in the header.
 * @param progress over the scene, a live region.
 */
export function makeScenario(host: HTMLElement, progress: HTMLElement, controls: Controls): Scenario {
  const name = el("span", { className: "scenario-name" });
  const select = el("select", { "aria-label": "Scenario", onchange: () => void run(select.value) });
  const sentence = el("p", {});
  host.append(name, select);
  progress.append(el("div", { className: "spinner", "aria-hidden": "true" }), sentence);
  let to = "";
  let since = 0;
  let isAccepted = false;

  async function run(scenario: string, as: { users?: number; localizes?: boolean } = {}): Promise<void> {
    to = scenario;
    since = performance.now();
    isAccepted = false;
    controls.changed();
    const reply = await controls.ask({ key: "run/scenario", query: { scenario, ...as } }, { isQuiet: true, patienceMs: 20_000 });
    if (reply) isAccepted = true;
    // a lost connection is no refusal: the page may have been restarted with the rest
    else if (controls.site.connected) to = "";
    else isAccepted = true;
    controls.changed();
  }

  /** Whether the requested scenario runs with all its services. */
  function isThere(): boolean {
    const { site } = controls;
    if (!isAccepted || controls.scenario !== to || !site.map || !site.status) return false;
    return [...site.deployments.values()].every(({ services }) => services.every(({ service, user }) => controls.isPresent(service, user)));
  }

  return {
    run,
    update() {
      const may = controls.may("run/scenario");
      const { scenario } = controls;
      show(select, may);
      show(name, !may && scenario !== "");
      write(name, scenarioTitle(scenario));
      const offered = [...controls.scenarios];
      renew(select, offered.join(), () => offered.map((each) => el("option", { value: each, text: scenarioTitle(each) })));
      const shown = to || scenario;
      if (document.activeElement !== select || !to) {
        if (select.value !== shown) select.value = shown;
      }
      if (to && isThere()) {
        controls.toasts.show("done", `${scenarioTitle(to)} is running.`);
        to = "";
      } else if (to && performance.now() - since > PATIENCE_MS) {
        controls.toasts.show("error", `${scenarioTitle(to)} did not start in time; the health page shows what is missing.`);
        to = "";
      }
      show(progress, to !== "");
      write(sentence, to ? `Starting “${scenarioTitle(to)}” …` : "");
    },
  };
}
