/** Which scenario runs, and running another: in the header, with a word on its progress over the scene. */

import type { Desk } from "./desk";
import { el, renew, show, write } from "./dom";
import { scenarioTitle } from "./words";

/** Starting takes some seconds; after so long something is wrong, ms. */
const PATIENCE_MS = 45_000;

export interface Scenario {
  update(): void;
  /** Run another, or the same anew, with so many people, found by pointing at lamps or not; nothing: as now. */
  run(scenario: string, as?: { users?: number; localizes?: boolean }): Promise<void>;
}

/**
 * @param host in the header.
 * @param progress over the scene, a live region.
 */
export function makeScenario(host: HTMLElement, progress: HTMLElement, desk: Desk): Scenario {
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
    desk.changed();
    const reply = await desk.ask({ key: "run/scenario", query: { scenario, ...as } }, { isQuiet: true, patienceMs: 20_000 });
    if (reply) isAccepted = true;
    // a lost connection is no refusal: the page may have been started anew with the rest
    else if (desk.site.connected) to = "";
    else isAccepted = true;
    desk.changed();
  }

  /** Whether what was asked for is there with all that belongs to it. */
  function isThere(): boolean {
    const { site } = desk;
    if (!isAccepted || desk.scenario !== to || !site.map || !site.status) return false;
    return [...site.deployments.values()].every(({ services }) => services.every(({ service, user }) => desk.isPresent(service, user)));
  }

  return {
    run,
    update() {
      const may = desk.may("run/scenario");
      const { scenario } = desk;
      show(select, may);
      show(name, !may && scenario !== "");
      write(name, scenarioTitle(scenario));
      const offered = [...desk.scenarios];
      renew(select, offered.join(), () => offered.map((each) => el("option", { value: each, text: scenarioTitle(each) })));
      const shown = to || scenario;
      if (document.activeElement !== select || !to) {
        if (select.value !== shown) select.value = shown;
      }
      if (to && isThere()) {
        desk.toasts.show("done", `${scenarioTitle(to)} is running.`);
        to = "";
      } else if (to && performance.now() - since > PATIENCE_MS) {
        desk.toasts.show("error", `${scenarioTitle(to)} did not start in time; the health page tells what is missing.`);
        to = "";
      }
      show(progress, to !== "");
      write(sentence, to ? `Starting “${scenarioTitle(to)}” …` : "");
    },
  };
}
