/** One tile for each thing of the map: its name and state, what pointing at it does, who fired it last, and a button that tries it. */

import type { Controls } from "../controls";
import { el, enable, icon, mark, renew, section, show, write } from "../dom";
import { problemsOfThings, thingTiles, type ThingTile } from "../site/things";
import type { ActState } from "../messages";
import { OUTCOMES } from "../words";
import type { PanelPart } from "./panel_part";

/** User in the events of a trial, as of `pointit things try`: nobody pointed. */
const OPERATOR = "operator";
const ICONS: Record<ThingTile["mode"], string> = { button: "button", switch: "power", claim: "check" };

/** What is told of a trial: that it was done only if its carriers have told so. */
export function triedToast(
  name: string,
  does: string,
  status: ActState["status"] | null,
): ["done" | "info", string] {
  if (status === "done") return ["done", `${does}: ${name}.`];
  return ["info", `${name}: ${status === "pending" ? "started" : "asked, its result is not told yet"}.`];
}

export function thingsPart(controls: Controls): PanelPart {
  const { site } = controls;
  const list = el("ul", { className: "cards things" });
  const problems = el("div", { className: "problems" });
  const element = section("Things", problems, list);
  let updates: ((tile: ThingTile) => void)[] = [];

  function card({ id, name, mode }: ThingTile): HTMLLIElement {
    const state = el("p");
    const does = el("p", { className: "muted" });
    const last = el("p", { className: "muted" });
    const gauge = el("progress", { max: 1, value: 0, "aria-label": `How far ${name} is selected` });
    const button = el(
      "button",
      { type: "button", "aria-label": `Try ${name}`, onclick: () => void tryIt() },
      el("span", { text: "Try" }),
    );
    const item = el(
      "li",
      {},
      el("span", { className: "badge" }, icon(ICONS[mode])),
      el("div", {}, el("div", { className: "head" }, el("strong", { text: name }), state), last, does, gauge),
      button,
    );
    let isOn = false;

    async function tryIt(): Promise<void> {
      const does = OUTCOMES[mode][isOn ? 1 : 0];
      const reply = await controls.ask({
        key: "selector/{user}/set_thing",
        name: OPERATOR,
        query: { thing: id },
      });
      if (reply)
        controls.toasts.show(...triedToast(name, does, reply["status"] as ActState["status"] | null));
    }

    updates.push((now) => {
      isOn = now.isOn;
      mark(item, "data-on", now.isOn ? "" : null);
      mark(item, "data-unavailable", now.problem && !now.isStarting ? "" : null);
      write(state, now.state);
      write(does, now.does);
      write(last, now.last);
      mark(gauge, "data-shown", now.progress === null ? null : "");
      gauge.value = now.progress ?? 0;
      show(button, mode !== "claim" && controls.may("selector/{user}/set_thing"));
      enable(button, now.canBeTried);
    });
    return item;
  }

  return {
    element,
    update() {
      const tiles = thingTiles(site);
      show(element, tiles.length > 0);
      const causes = problemsOfThings(tiles);
      renew(problems, JSON.stringify(causes), () =>
        causes.map(({ text, isStarting }) =>
          el(
            "p",
            isStarting ? { className: "muted" } : {},
            icon(isStarting ? "pause" : "warning"),
            el("span", { text }),
          ),
        ),
      );
      renew(list, JSON.stringify(tiles.map(({ id, name, mode }) => [id, name, mode])), () => {
        updates = [];
        return tiles.map(card);
      });
      tiles.forEach((tile, index) => updates[index]!(tile));
    },
  };
}
