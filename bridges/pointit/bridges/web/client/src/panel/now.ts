/** Who, what they do now, and the button. */

import { choice } from "../choice";
import type { Desk } from "../desk";
import { el, icon, key, mark, show, write } from "../dom";
import { byName, capital } from "../format";
import { cssColor } from "../geometry/looks";
import { standingOf } from "../site/site";
import { stateTitle, thing } from "../words";
import type { Part } from "./part";

const ICONS = { idle: "pause", localizing: "place", pointing: "point" } as const;

export function nowPart(desk: Desk): Part {
  const { site } = desk;
  const who = choice("Person", (user) => desk.choose(user));
  who.element.classList.add("people");
  const badge = el("span", { className: "badge" }, icon("pause"));
  const state = el("strong", {});
  const next = el("p", { className: "next" });
  const gauge = el("progress", { max: 1, value: 0, "aria-label": "How far the selection has come" });
  const gaugeText = el("span", { className: "muted" });
  const gaugeRow = el("div", { className: "gauge", hidden: true }, gaugeText, gauge);
  const press = el("button", { className: "primary", type: "button", "aria-keyshortcuts": "Space", onclick: () => desk.press() },
    icon("button"), el("span", { text: "Press the button" }), key("Space"));
  const action = (name: string, symbol: string, shortcut: string, run: () => void): HTMLButtonElement =>
    el("button", { type: "button", onclick: run, "aria-keyshortcuts": shortcut }, icon(symbol), el("span", { text: name }), key(shortcut));
  const localize = action("Localize", "place", "L", () => desk.localize());
  const cancel = action("Cancel", "close", "C", () => desk.cancel());
  const undo = action("Undo", "undo", "U", () => desk.undo());
  const clear = action("Clear", "clear", "X", () => desk.clear());
  const actions = el("div", { className: "pairs" }, localize, cancel, undo, clear);
  const place = el("p", { className: "muted" });
  const nobody = el("p", { className: "muted", text: "Nobody is here yet. Add a person: pointit user anna" });
  const body = el("div", { className: "now" }, el("div", { className: "state" }, badge, el("div", {}, state, next)), gaugeRow);
  const viewer = el("p", { className: "muted", text: "This page only looks on. The operator's link lets you control." });
  const element = el("section", { className: "part", "aria-label": "Now" }, who.element, nobody, body, place, viewer, press, actions);

  function showGauge(): void {
    const hover = desk.person?.hover;
    const isOn = Boolean(hover?.object_id && site.people.get(desk.user)?.interaction?.state === "pointing");
    show(gaugeRow, desk.isPresent("selector")); // its place is kept, so that what is below does not jump
    mark(gaugeRow, "data-shown", isOn ? "" : null);
    if (!isOn || !hover) return;
    gauge.value = hover.progress;
    const what = capital(thing(site, hover.object_id));
    write(gaugeText, hover.action === "refuse" ? `${what}: taken${hover.taken_by ? ` by ${hover.taken_by}` : ""}` : what);
  }

  return {
    element,
    update() {
      const users = [...site.people.keys()].sort(byName);
      who.offer(users.map((user) => {
        const profile = site.people.get(user)?.profile;
        return profile ? { value: user, label: user, swatch: cssColor(profile.cursor_color) } : { value: user, label: user };
      }));
      who.set(desk.user);
      show(who.element, users.length > 1);
      show(viewer, site.hello?.role === "viewer");
      show(nobody, users.length === 0 && site.status !== null);
      const interaction = desk.person?.interaction ?? null;
      show(body, interaction !== null);
      const now = interaction?.state ?? "idle";
      mark(element, "data-state", now);
      badge.querySelector("use")?.setAttribute("href", `#icon-${ICONS[now] ?? "pause"}`);
      const stands = desk.person ? standingOf(desk.person) : null;
      show(place, desk.person !== null && (!stands || stands.isAssumed));
      write(place, stands ? `Where ${desk.user} stands is yet to be found; shown is where they are taken to stand.` : `Where ${desk.user} stands is not known, so they are not shown.`);
      const name = users.length > 1 ? `${desk.user}: ${stateTitle(now).toLowerCase()}` : stateTitle(now);
      write(state, interaction ? name : "");
      write(next, desk.person?.cursor?.passed?.text || (interaction?.next_step ?? ""));
      show(press, desk.mayDo("press") && desk.user !== "");
      const progress = desk.person?.localization;
      const isLocalizing = now === "localizing" || progress?.phase === "sampling";
      show(localize, desk.canLocalize && !isLocalizing);
      show(cancel, desk.may("localizer/{user}/cancel") && isLocalizing);
      show(undo, desk.may("selector/{user}/undo"));
      show(clear, desk.may("selector/{user}/clear"));
      show(actions, [localize, cancel, undo, clear].some((each) => !each.hidden));
      showGauge();
    },
  };
}
