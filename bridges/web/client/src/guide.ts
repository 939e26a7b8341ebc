/** The card over the scene with guidance for new users. */

import type { Controls } from "./controls";
import { el, icon, isTouch, key, mark, show, write } from "./dom";
import { capital } from "./format";
import { guidance, type Guidance } from "./guidance";
import type { SelectionEvent } from "./messages";
import type { Mouse } from "./mouse";
import type { Pairing } from "./panel/pairing";
import { robotSituation } from "./robot_guidance";
import { emptySentence, passedSentence } from "./run";
import { steeredBy } from "./site/robots";
import { proposalOf, thingsOf, type Person } from "./site/site";
import { unavailable } from "./site/things";
import { friendly, isNamed, modeOf, objectOf, outcome, ownCount, pressedNames, pressTitle, thing } from "./words";

const SUCCESS_MS = 2500;
/** The card is a chip after so long, ms: it lies over the scene. */
const LONG_MS = 10_000;
const SIGNS: Record<Guidance["mode"], string> = {
  none: "point", invite: "point", other: "mouse", point: "point", idle: "pause", success: "check", wrong: "close", phone: "phone", passed: "check",
};
const STEP_SIGNS: Partial<Record<Guidance["step"], string>> = { press: "button", following: "play", stopped: "warning" };
/** An object that wants no press stays full for less, ms. */
const FULL_MS = 400;

export interface Guide {
  update(): void;
  /** An object was selected. */
  selected(event: SelectionEvent): void;
}

export function makeGuide(host: HTMLElement, controls: Controls, mouse: Mouse, pairing: Pairing): Guide {
  const { site } = controls;
  let isShort = false, topic = "", since = 0, steered = "", full = { id: "", since: 0 };
  let success = { what: "", user: "", isWrong: false, at: -Infinity };
  const button = (symbol: string, name: string, shortcut: string, className: string, run: () => void): HTMLButtonElement =>
    el("button", { type: "button", className, onclick: run, ...(shortcut ? { "aria-keyshortcuts": shortcut } : {}) },
      icon(symbol), el("span", { text: name }), shortcut ? key(shortcut === "Escape" ? "Esc" : shortcut) : null);
  const sign = icon("point");
  const title = el("strong", {}), text = el("span", { className: "text" });
  const gauge = el("progress", { max: 1, value: 0, "aria-label": "How full it is" });
  const take = button("mouse", isTouch() ? "Point with your finger" : "Point with the mouse", "", "primary", () => void mouse.take());
  const phone = button("phone", "Point with your phone", "", "", () => pairing.open());
  const press = button("button", "Start pointing", "Space", "primary", () => controls.press(controls.mine?.user));
  const again = button("play", "Again", "", "primary", () => void controls.ask({ key: "conveyor/reset" }));
  const give = button("undo", "Give back", "Escape", "", () => void release());
  const shrink = el("button", { type: "button", className: "quiet", "aria-label": "Make it small", onclick: () => {
    isShort = true;
    self.update();
    take.focus();
  } }, icon("close"));
  host.append(sign, el("div", { className: "words" }, title, text, gauge), el("div", { className: "does" }, take, phone, press, again, give), shrink);

  async function release(): Promise<void> {
    if (controls.mine) await mouse.give();
    else await controls.ask({ deed: "give", name: controls.user });
  }

  /** Make the card a chip after a while, with all its buttons; not under a pointer or the keyboard's focus. */
  function shorten(mode: Guidance["mode"]): void {
    const now = performance.now(), newTopic = mode === "invite" ? "invite" : "arm";
    if (newTopic !== topic) {
      topic = newTopic;
      since = now;
      isShort = false;
    }
    isShort ||= now - since > LONG_MS && !host.matches(":hover, :focus-within");
  }

  /** Whether the object in `hover` waits for a press: it says so, or its gauge stays full. */
  function wantsPress(person: Person): boolean {
    const { hover, interaction } = person;
    const id = hover && hover.progress >= 1 ? hover.object_id : "", now = performance.now();
    if (id !== full.id) full = { id, since: now };
    const isHeld = id !== "" && now - full.since > FULL_MS && pressTitle(interaction) === "Confirm";
    return isHeld || person.announced !== null || (objectOf(site, hover?.object_id ?? "")?.press ?? false);
  }

  const self: Guide = {
    update() {
      const person = controls.mine ?? controls.person;
      const user = person?.user ?? "", hovered = person?.hover?.object_id ?? "", objects = thingsOf(site);
      steered = steeredBy(site, user)?.name ?? steered;
      const now = guidance({
        user, mayTake: controls.mayDo("take"), mayPair: controls.mayDo("pair"), isSimulated: controls.isSimulated(user),
        movedBy: person?.line?.moved_by ?? "own", isMine: person !== null && person === controls.mine,
        interaction: person?.interaction ? { ...person.interaction, next_step: friendly(site, person.interaction.next_step) } : null, hover: person?.hover ?? null,
        hovered: capital(thing(site, hovered)), unavailable: unavailable(site, hovered), mode: modeOf(site, hovered), scenario: controls.scenario,
        areAllPressed: objects.length > 0 && objects.every(({ object }) => object.press),
        isTheirs: site.selection?.objects.some(({ id, user: owner }) => id === hovered && owner === user) ?? false,
        hasNames: person?.announced != null, pressed: pressedNames(site), isOwn: controls.hasSelected(hovered), wantsPress: person !== null && wantsPress(person),
        robots: person && robotSituation(site, person, steered), isProposed: person !== null && proposalOf(person) !== null,
        passed: passedSentence(site, controls), empty: emptySentence(site),
        canSelect: controls.isPresent("selector"),
        success: success.user === user && performance.now() - success.at < SUCCESS_MS ? success.what : "",
        isWrong: success.isWrong,
        count: ownCount(site, user, (id) => controls.hasSelected(id)),
      });
      const isShown = site.connected && site.status?.run !== "over" && now.mode !== "none" && person !== null;
      show(host, isShown);
      if (!isShown) return;
      mark(host, "data-mode", now.mode);
      mark(host, "data-step", now.step);
      shorten(now.mode);
      mark(host, "data-short", isShort ? "" : null);
      mark(sign.firstElementChild!, "href", `#icon-${(now.mode === "point" ? STEP_SIGNS[now.step] : "") || SIGNS[now.mode]}`);
      write(title, now.title);
      write(text, now.text);
      show(text, now.text !== "");
      mark(gauge, "data-shown", now.progress === null ? null : "");
      gauge.value = now.progress ?? 0;
      show(take, (now.mode === "invite" || now.mode === "other") && controls.mayDo("take"));
      show(phone, now.mode === "invite" && controls.mayDo("pair") && !isTouch());
      show(press, now.press !== "" && controls.mayDo("press"));
      write(press.querySelector("span")!, now.press || "Press");
      show(again, now.mode === "passed" && controls.may("conveyor/reset"));
      show(give, now.mode !== "invite" && now.mode !== "other" && (person.line?.moved_by ?? "own") !== "own" && controls.mayDo("give"));
      show(shrink, now.mode === "invite" && !isShort);
    },
    selected(event) {
      success = {
        what: `${outcome(site, event).toLowerCase()} ${isNamed(site, event.object_id) ? "" : "a "}${thing(site, event.object_id, event.kind)}`, user: event.user, isWrong: !controls.isWanted(event.kind), at: performance.now(),
      };
      setTimeout(() => self.update(), SUCCESS_MS + 50);
    },
  };
  return self;
}
