/** The menu of scenarios in the header, its question before something is lost, and the progress of a start over the scene. */

import type { Controls } from "./controls";
import { el, icon, mark, renew, sheet, show, write } from "./dom";
import { sentence } from "./format";
import { losses } from "./losses";

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
  const name = el("span", { className: "scenario-name" });
  const shown = el("span", {});
  const open = el(
    "button",
    { type: "button", "aria-haspopup": "dialog", onclick: () => openMenu() },
    shown,
    icon("chevron"),
  );
  const starting = el("p", {});
  host.append(name, open);
  progress.append(el("div", { className: "spinner", "aria-hidden": "true" }), starting);

  const list = el("ul", { className: "scenarios" });
  const title = el("h2");
  const lost = el("ul", { className: "losses" });
  const yes = el("button", { type: "button", className: "primary" });
  const no = el("button", { type: "button", text: "Go on as it is", onclick: () => dialog.close() });
  const question = el(
    "div",
    {},
    el("p", { text: "This ends for everybody what runs now:" }),
    lost,
    el("div", { className: "pairs" }, yes, no),
  );
  const dialog = sheet(title, list, question);

  let to = "";
  let since = 0;
  let isAccepted = false;

  function openMenu(): void {
    const { offers, scenario } = controls;
    write(title, "What to run");
    show(list, true);
    show(question, false);
    list.dataset.signature = "";
    renew(list, JSON.stringify([offers, scenario]), () =>
      offers.map((each) => {
        const isNow = each.name === scenario;
        const text = isNow ? "Restart" : "Run";
        const shownTitle = controls.titleOf(each.name);
        return el(
          "li",
          isNow ? { "aria-current": "true" } : {},
          el(
            "div",
            {},
            el("strong", { text: shownTitle }),
            isNow ? el("span", { className: "tag", text: "runs now" }) : null,
            el("p", { text: sentence(each.about) }),
          ),
          el(
            "button",
            { type: "button", "aria-label": `${text}: ${shownTitle}`, onclick: () => run(each.name) },
            icon("play"),
            el("span", { text }),
          ),
        );
      }),
    );
    if (!dialog.open) dialog.showModal();
    list.querySelector<HTMLElement>("[aria-current] button")?.scrollIntoView({ block: "nearest" });
  }

  function run(scenario: string, as: RunOptions = {}): void {
    const all = losses(controls);
    const isSame = scenario === controls.scenario;
    if (!all.length) return void start(scenario, as);
    write(
      title,
      isSame ? `Restart “${controls.titleOf(scenario)}”?` : `Run “${controls.titleOf(scenario)}”?`,
    );
    lost.replaceChildren(...all.map((text) => el("li", { text })));
    yes.textContent = isSame ? "Restart" : "Run";
    yes.onclick = () => void start(scenario, as);
    show(list, false);
    show(question, true);
    if (!dialog.open) dialog.showModal();
    no.focus();
  }

  async function start(scenario: string, as: RunOptions): Promise<void> {
    const before = {
      scenario: controls.scenario,
      as: { users: site.people.size, localizes: controls.localizes },
    };
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
    back =
      isAccepted &&
      before.scenario &&
      (before.scenario !== scenario || before.as.users !== (as.users ?? before.as.users))
        ? before
        : null;
    controls.changed();
  }

  let back: { scenario: string; as: RunOptions } | null = null;

  /** Whether the requested scenario runs with all its services. */
  function isThere(): boolean {
    if (!isAccepted || controls.scenario !== to || !site.map || !site.status) return false;
    return [...site.deployments.values()].every(({ services }) =>
      services.every(({ service, user }) => controls.isPresent(service, user)),
    );
  }

  function tellStarted(): void {
    const before = back;
    const { scenario } = controls;
    back = null;
    const isOther = before !== null && before.scenario !== scenario;
    const people = before?.as.users === 1 ? "1 person" : `${before?.as.users} people`;
    controls.toasts.show(
      "done",
      `${controls.titleOf(scenario)} is running.`,
      before && before.as.users
        ? {
            action: {
              name: `Back to ${isOther ? "the last one" : people}`,
              run: () => run(before.scenario, before.as),
            },
          }
        : {},
    );
  }

  return {
    run,
    update() {
      const may = controls.may("run/scenario");
      const { scenario } = controls;
      const isStarting = to !== "" || site.status?.run === "starts";
      show(open, may || (dialog.open && isStarting));
      show(name, open.hidden && scenario !== "");
      write(name, controls.titleOf(scenario));
      write(shown, controls.titleOf(to || scenario));
      mark(open, "aria-label", `${shown.textContent ?? ""}. Choose what to run`);
      if (to && isThere()) {
        to = "";
        tellStarted();
      } else if (to && performance.now() - since > PATIENCE_MS) {
        controls.toasts.show(
          "error",
          `${controls.titleOf(to)} did not start in time; the health page shows what is missing.`,
        );
        to = "";
      }
      show(progress, isStarting && site.connected && !site.timeline);
      write(starting, isStarting ? `Starting “${controls.titleOf(to || scenario)}” …` : "");
    },
  };
}
