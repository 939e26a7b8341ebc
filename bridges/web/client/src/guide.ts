/** The card over the scene with guidance for new users. */

import type { Controls } from "./controls";
import { el, icon, isTouch, key, mark, show, write } from "./dom";
import { factsOf } from "./facts";
import { guidance, type Facts, type Said, type Words } from "./guidance";
import type { SelectionEvent } from "./messages";
import type { Mouse } from "./mouse";
import type { Pairing } from "./people/pairing";
import { robotSituation, robotStep, type RobotSituation } from "./robot_guidance";
import { steeredBy } from "./site/robots";
import { isNamed, outcome, thing } from "./words";

const SUCCESS_MS = 2500;
/** The card is a chip after so long, ms: it lies over the scene. */
const LONG_MS = 10_000;
const SIGNS: Record<Said["mode"], string> = {
  none: "point",
  invite: "point",
  other: "mouse",
  point: "point",
  idle: "pause",
  success: "check",
  wrong: "close",
  phone: "phone",
  passed: "check",
};
const STEP_SIGNS: Partial<Record<Said["step"], string>> = {
  press: "button",
  leave: "warning",
  following: "play",
  stopped: "warning",
};

export interface Guide {
  update(): void;
  /** An object was selected. */
  selected(event: SelectionEvent): void;
}

/** The card of the table; who is on nothing has the words of robots, where they steer some. */
export function cardOf(
  { facts, words }: { facts: Facts; words: Words },
  robots: RobotSituation | null,
): Said {
  const said = guidance(facts, words);
  return robots && said.mode === "point" && !said.text ? { ...said, press: "", ...robotStep(robots) } : said;
}

/** Whether the card shows how full the gauge is: while staying on something, or a press, has an effect. */
const hasGauge = ({ mode, step, text }: Said): boolean =>
  mode === "point" && ["hold", "leave", "press"].includes(step) && text !== "";

export function makeGuide(host: HTMLElement, controls: Controls, mouse: Mouse, pairing: Pairing): Guide {
  const { site } = controls;
  let isShort = false;
  let topic = "";
  let since = 0;
  let steered = "";
  let success = { did: "", user: "", isWrong: false, at: -Infinity };
  const button = (
    symbol: string,
    name: string,
    shortcut: string,
    className: string,
    run: () => void,
  ): HTMLButtonElement =>
    el(
      "button",
      { type: "button", className, onclick: run, ...(shortcut ? { "aria-keyshortcuts": shortcut } : {}) },
      icon(symbol),
      el("span", { text: name }),
      shortcut ? key(shortcut === "Escape" ? "Esc" : shortcut) : null,
    );
  const sign = icon("point");
  const title = el("strong", {});
  const text = el("span", { className: "text" });
  const gauge = el("progress", { max: 1, value: 0, "aria-label": "How full it is" });
  const take = button(
    "mouse",
    isTouch() ? "Point with your finger" : "Point with the mouse",
    "",
    "primary",
    () => void mouse.take(),
  );
  const phone = button("phone", "Point with your phone", "", "", () => pairing.open());
  const press = button("button", "Start pointing", "Space", "primary", () =>
    controls.press(controls.mine?.user),
  );
  const again = button("play", "Again", "", "primary", () => void controls.ask({ key: "conveyor/reset" }));
  const give = button("undo", "Give back", "Escape", "", () => void release());
  const shrink = el(
    "button",
    {
      type: "button",
      className: "quiet",
      "aria-label": "Make it small",
      onclick: () => {
        isShort = true;
        self.update();
        take.focus();
      },
    },
    icon("close"),
  );
  host.append(
    sign,
    el("div", { className: "words" }, title, text, gauge),
    el("div", { className: "does" }, take, phone, press, again, give),
    shrink,
  );

  async function release(): Promise<void> {
    if (controls.mine) await mouse.give();
    else await controls.ask({ deed: "give", name: controls.user });
  }

  /** Make the card a chip after a while, with all its buttons; not under a pointer or the keyboard's focus. */
  function shorten(mode: Said["mode"]): void {
    const now = performance.now();
    const newTopic = mode === "invite" ? "invite" : "arm";
    if (newTopic !== topic) {
      topic = newTopic;
      since = now;
      isShort = false;
    }
    isShort ||= now - since > LONG_MS && !host.matches(":hover, :focus-within");
  }

  const self: Guide = {
    update() {
      const person = controls.mine ?? controls.person;
      const user = person?.user ?? "";
      steered = steeredBy(site, user)?.name ?? steered;
      const robots = person && robotSituation(site, person, steered);
      const isNew = success.user === user && performance.now() - success.at < SUCCESS_MS;
      const now = person
        ? cardOf(factsOf(controls, person, robots !== null, isNew ? success : null), robots)
        : null;
      const isShown = site.connected && site.status?.run !== "over" && now !== null && now.mode !== "none";
      show(host, isShown);
      if (!isShown) return;
      mark(host, "data-mode", now.mode);
      mark(host, "data-step", now.step);
      shorten(now.mode);
      mark(host, "data-short", isShort ? "" : null);
      mark(
        sign.firstElementChild!,
        "href",
        `#icon-${(now.mode === "point" ? STEP_SIGNS[now.step] : "") || SIGNS[now.mode]}`,
      );
      write(title, now.title);
      write(text, now.text);
      show(text, now.text !== "");
      mark(gauge, "data-shown", hasGauge(now) ? "" : null);
      gauge.value = person?.hover?.progress ?? 0;
      show(take, now.offers.includes("take") && controls.mayDo("take"));
      show(phone, now.offers.includes("pair") && controls.mayDo("pair") && !isTouch());
      show(press, now.press !== "" && controls.mayDo("press"));
      write(press.querySelector("span")!, now.press || "Press");
      show(again, now.offers.includes("again") && controls.may("conveyor/reset"));
      show(give, now.offers.includes("give") && controls.mayDo("give"));
      show(shrink, now.mode === "invite" && !isShort);
    },
    selected(event) {
      success = {
        did: `${outcome(site, event).toLowerCase()} ${isNamed(site, event.object_id) ? "" : "a "}${thing(site, event.object_id, event.kind)}`,
        user: event.user,
        isWrong: !controls.isWanted(event.kind),
        at: performance.now(),
      };
      setTimeout(() => self.update(), SUCCESS_MS + 50);
    },
  };
  return self;
}
