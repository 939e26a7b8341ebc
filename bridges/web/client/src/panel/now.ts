/** Person, current state, and the button. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, enable, icon, key, mark, show, write } from "../dom";
import { byName, capital } from "../format";
import { cssColor } from "../geometry/appearance";
import { standingOf } from "../site/site";
import { unavailable } from "../site/things";
import { friendly, nextStepOf, pressTitle, rememberedSentence, stateTitle, thing } from "../words";
import type { PanelPart } from "./panel_part";

const ICONS = { idle: "pause", localizing: "place", pointing: "point" } as const;

/** The person of the controls, where there are several. */
export function personPart(controls: Controls): PanelPart {
  const { site } = controls;
  const who = choice("Person", (user) => controls.choose(user));
  who.element.classList.add("people");
  const element = el("section", { className: "part", "aria-label": "Person" }, who.element);
  return {
    element,
    update() {
      const users = [...site.people.keys()].sort(byName);
      who.offer(
        users.map((user) => {
          const profile = site.people.get(user)?.profile;
          return profile
            ? { value: user, label: user, swatch: cssColor(profile.cursor_color) }
            : { value: user, label: user };
        }),
      );
      who.set(controls.user);
      show(element, users.length > 1);
    },
  };
}

/** Time without people after which it is said, ms: they come a little later than the rest of a scenario. */
const NOBODY_MS = 3000;

export function nowPart(controls: Controls): PanelPart {
  const { site } = controls;
  const badge = el("span", { className: "badge" }, icon("pause"));
  const state = el("strong", {});
  const next = el("p", { className: "next" });
  const gauge = el("progress", { max: 1, value: 0, "aria-label": "How far the selection has come" });
  const gaugeText = el("span", { className: "muted" });
  const gaugeRow = el("div", { className: "gauge", hidden: true }, gaugeText, gauge);
  const pressText = el("span", {});
  const press = el(
    "button",
    {
      className: "primary press",
      type: "button",
      "aria-keyshortcuts": "Space",
      onclick: () => controls.press(),
    },
    icon("button"),
    pressText,
    key("Space"),
  );
  const action = (name: string, symbol: string, shortcut: string, run: () => void): HTMLButtonElement =>
    el(
      "button",
      { type: "button", onclick: run, "aria-keyshortcuts": shortcut },
      icon(symbol),
      el("span", { text: name }),
      key(shortcut),
    );
  const localize = action("Localize", "place", "L", () => controls.localize());
  const cancel = action("Cancel", "close", "C", () => controls.cancel());
  const undo = action("Undo", "undo", "U", () => controls.undo());
  const clear = action("Clear", "clear", "X", () => controls.clear());
  const actions = el("div", { className: "pairs" }, localize, cancel, undo, clear);
  const place = el("p", { className: "muted" });
  const remembered = el("p", { className: "muted" });
  const forget = el("button", {
    type: "button",
    text: "Forget",
    "aria-label": "Forget the elevation bias",
    onclick: () => controls.cancel({ forget_bias: true }),
  });
  const nobody = el("p", {
    className: "muted",
    text: "Nobody is here yet. Add a person: pointit person add anna",
  });
  let nobodySince = Infinity;
  const body = el(
    "div",
    { className: "now" },
    el("div", { className: "state" }, badge, el("div", {}, state, next)),
    gaugeRow,
  );
  const viewer = el("p", { className: "muted" });
  const element = el(
    "section",
    { className: "part", "aria-label": "Now" },
    nobody,
    body,
    place,
    viewer,
    press,
    actions,
    remembered,
    forget,
  );

  function showGauge(): void {
    const hover = controls.person?.hover;
    const isOn = Boolean(
      hover?.object_id && site.people.get(controls.user)?.interaction?.state === "pointing",
    );
    show(gaugeRow, controls.isPresent("selector")); // its place is kept, so that what is below does not jump
    mark(gaugeRow, "data-shown", isOn ? "" : null);
    if (!isOn || !hover) return;
    gauge.value = hover.progress;
    const what = capital(thing(site, hover.object_id));
    write(
      gaugeText,
      hover.action === "refuse"
        ? `${what}: ${hover.taken_by ? `taken by ${hover.taken_by}` : unavailable(site, hover.object_id) ? "unavailable" : "too late"}`
        : what,
    );
  }

  return {
    element,
    update() {
      const users = [...site.people.keys()];
      show(viewer, site.hello?.role === "viewer");
      write(
        viewer,
        site.timeline
          ? "This is the past: nothing in it can be changed."
          : "This page only looks on. The operator's link lets you control.",
      );
      const isNobody = users.length === 0 && site.connected && site.status?.run === "runs" && !site.timeline;
      nobodySince = isNobody ? Math.min(nobodySince, performance.now()) : Infinity;
      show(nobody, performance.now() - nobodySince > NOBODY_MS);
      const interaction = controls.person?.interaction ?? null;
      show(body, interaction !== null);
      const now = interaction?.state ?? "idle";
      const line = controls.person?.line ?? null;
      mark(element, "data-state", now);
      badge.querySelector("use")?.setAttribute("href", `#icon-${ICONS[now] ?? "pause"}`);
      const stands = controls.person ? standingOf(controls.person) : null;
      show(place, controls.person !== null && (!stands || stands.isAssumed));
      write(
        place,
        stands
          ? `The position of ${controls.user} is not yet measured; the assumed one is shown.`
          : `The position of ${controls.user} is not known, so they are not shown.`,
      );
      const name = users.length > 1 ? `${controls.user}: ${stateTitle(now).toLowerCase()}` : stateTitle(now);
      write(state, interaction ? name : "");
      write(
        next,
        capital(friendly(site, controls.person?.cursor?.passed?.text ?? "")) ||
          (site.timeline || !controls.person ? "" : nextStepOf(site, controls.person)),
      );
      write(pressText, pressTitle(interaction));
      const canPoint = line?.moved_by !== "own" || line.source !== "none"; // without an arm nothing follows the press
      show(
        press,
        controls.mayDo("press") && controls.user !== "" && canPoint && pressTitle(interaction) !== "",
      );
      const progress = controls.person?.localization;
      const isLocalizing = now === "localizing" || progress?.phase === "sampling";
      show(localize, controls.canLocalize && !isLocalizing);
      show(cancel, controls.may("localizer/{user}/cancel") && isLocalizing);
      show(undo, controls.may("selector/{user}/undo"));
      show(clear, controls.may("selector/{user}/clear"));
      for (const [button, can, what] of [
        [undo, controls.canUndo, "undo"],
        [clear, controls.canClear, "clear"],
      ] as const) {
        enable(button, can);
        button.title = can ? "" : `There is nothing to ${what}`;
      }
      write(remembered, rememberedSentence(controls.person?.pose ?? null));
      show(remembered, remembered.textContent !== "");
      show(forget, !remembered.hidden && !isLocalizing && controls.may("localizer/{user}/cancel")); // it would cancel
      show(
        actions,
        [localize, cancel, undo, clear].some((each) => !each.hidden),
      );
      showGauge();
    },
  };
}
