/** The menu of scenarios in the header, its question before something is lost, and the progress of a start over the scene. */

import type { Controls } from "./controls";
import { el, icon, mark, renew, sheet, show, write } from "./dom";
import { losses } from "./losses";
import { scenarioSentence, scenarioTitle } from "./words";

/** Timeout of a scenario's start, ms. */
const PATIENCE_MS = 45_000;

/** Options of a start; missing ones stay as they are. */
export interface RunOptions {
  users?: number;
  localizes?: boolean;
}

export interface Scenario {
  update(): void;
  /** Start another scenario, or restart it with other options; asks first if something would be lost. */
  run(scenario: string, as?: RunOptions): void;
}

/**
 * @param host in the header.
 * @param progress over the scene, a live region.
 */
export function makeScenario(host: HTMLElement, progress: HTMLElement, controls: Controls): Scenario {
  const { site } = controls;
  const name = el("span", { className: "scenario-name" }), shown = el("span", {});
  const open = el("button", { type: "button", "aria-haspopup": "dialog", onclick: () => openMenu() }, shown, icon("chevron"));
  const sentence = el("p", {});
  host.append(name, open);
  progress.append(el("div", { className: "spinner", "aria-hidden": "true" }), sentence);

  const list = el("ul", { className: "scenarios" });
  const title = el("h2");
  const lost = el("ul", { className: "losses" });
  const yes = el("button", { type: "button", className: "primary" }), no = el("button", { type: "button", text: "Go on as it is", onclick: () => dialog.close() });
  const question = el("div", {}, el("p", { text: "This ends for everybody what runs now:" }), lost, el("div", { className: "pairs" }, yes, no));
  const dialog = sheet(title, list, question);

  let to = "";
  let since = 0;
  let isAccepted = false;

  function openMenu(): void {
    const offered = [...controls.scenarios], { scenario } = controls;
    write(title, "What to run");
    show(list, true);
    show(question, false);
    list.dataset.signature = "";
    renew(list, `${offered.join()} ${scenario}`, () => offered.map((each) => {
      const isNow = each === scenario, text = isNow ? "Restart" : "Run";
      return el("li", isNow ? { "aria-current": "true" } : {},
        el("div", {}, el("strong", { text: scenarioTitle(each) }), isNow ? el("span", { className: "tag", text: "runs now" }) : null, el("p", { text: scenarioSentence(each) })),
        el("button", { type: "button", "aria-label": `${text}: ${scenarioTitle(each)}`, onclick: () => run(each) }, icon("play"), el("span", { text })));
    }));
    if (!dialog.open) dialog.showModal();
    list.querySelector<HTMLElement>("[aria-current] button")?.scrollIntoView({ block: "nearest" });
  }

  function run(scenario: string, as: RunOptions = {}): void {
    const all = losses(controls), isSame = scenario === controls.scenario;
    if (!all.length) return void start(scenario, as);
    write(title, isSame ? `Restart “${scenarioTitle(scenario)}”?` : `Run “${scenarioTitle(scenario)}”?`);
    lost.replaceChildren(...all.map((text) => el("li", { text })));
    yes.textContent = isSame ? "Restart" : "Run";
    yes.onclick = () => void start(scenario, as);
    show(list, false);
    show(question, true);
    if (!dialog.open) dialog.showModal();
    no.focus();
  }

  async function start(scenario: string, as: RunOptions): Promise<void> {
    const before = { scenario: controls.scenario, as: { users: site.people.size, localizes: controls.localizes } };
    dialog.close();
    controls.toasts.endActions();
    to = scenario;
    since = performance.now();
    isAccepted = false;
    controls.changed();
    const reply = await controls.ask({ key: "run/scenario", query: { scenario, ...as } }, 20_000);
    if (reply) isAccepted = true;
    // a lost connection is no refusal: the page may have been restarted with the rest
    else if (site.connected) to = "";
    else isAccepted = true;
    back = isAccepted && before.scenario && (before.scenario !== scenario || before.as.users !== (as.users ?? before.as.users)) ? before : null;
    controls.changed();
  }

  let back: { scenario: string; as: RunOptions } | null = null;

  /** Whether the requested scenario runs with all its services. */
  function isThere(): boolean {
    if (!isAccepted || controls.scenario !== to || !site.map || !site.status) return false;
    return [...site.deployments.values()].every(({ services }) => services.every(({ service, user }) => controls.isPresent(service, user)));
  }

  function tellStarted(): void {
    const before = back, { scenario } = controls;
    back = null;
    const isOther = before !== null && before.scenario !== scenario, people = before?.as.users === 1 ? "1 person" : `${before?.as.users} people`;
    controls.toasts.show("done", `${scenarioTitle(scenario)} is running.`, before && before.as.users
      ? { action: { name: `Back to ${isOther ? scenarioTitle(before.scenario).replace(/:.*/, "") : people}`, run: () => run(before.scenario, before.as) } } : {});
  }

  return {
    run,
    update() {
      const may = controls.may("run/scenario"), { scenario } = controls, isStarting = to !== "" || site.status?.run === "starts";
      show(open, may || (dialog.open && isStarting));
      show(name, open.hidden && scenario !== "");
      write(name, scenarioTitle(scenario));
      write(shown, scenarioTitle(to || scenario));
      mark(open, "aria-label", `${shown.textContent ?? ""}. Choose what to run`);
      if (to && isThere()) {
        to = "";
        tellStarted();
      } else if (to && performance.now() - since > PATIENCE_MS) {
        controls.toasts.show("error", `${scenarioTitle(to)} did not start in time; the health page shows what is missing.`);
        to = "";
      }
      show(progress, isStarting && site.connected && !site.timeline);
      write(sentence, isStarting ? `Starting “${scenarioTitle(to || scenario)}” …` : "");
    },
  };
}
