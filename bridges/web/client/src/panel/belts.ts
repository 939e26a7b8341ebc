/** The conveyor: speed, packages, counts at bays. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, icon, key, mark, renew, section, show, write } from "../dom";
import { byName, capital } from "../format";
import { cssColor, KIND_COLORS, kindColor } from "../geometry/appearance";
import type { BayCount } from "../messages";
import { initialOf } from "../site/figures";
import { slider } from "../slider";
import { called, movingOf, nounOf } from "../words";
import type { PanelPart } from "./panel_part";

/** Kinds offered while the real ones are unknown. */
const USUAL_KINDS = ["red", "green", "blue"];
const MOST_KINDS = 6;
const ORDER = Object.keys(KIND_COLORS);
const USUAL_SPEED = 0.3;

export interface Belts extends PanelPart {
  add(): void;
  /** Stop, or go on as before. */
  halt(): void;
  faster(by: number): void;
}

export function beltsPart(controls: Controls): Belts {
  const { site } = controls;
  let kind = USUAL_KINDS[0]!;
  let seen = new Set<string>();
  let seenIn = "";
  let before = USUAL_SPEED;

  async function setSpeed(value: number): Promise<number | null> {
    const speed = Math.round(value * 100) / 100;
    const reply = await controls.ask({ key: "conveyor/set_speed", query: { speed_mps: speed } });
    return reply ? speed : null;
  }

  async function addOne(): Promise<void> {
    const reply = await controls.ask({ key: "conveyor/add_package", query: { kind } });
    if (reply)
      controls.toasts.show("done", `Added: ${called(site, String(reply["object_id"] ?? ""), kind)}.`, {
        topic: "added",
      });
  }

  /** After the last package, feeding starts again. */
  const isFed = (): boolean => (site.conveyor?.feeding ?? false) && site.conveyor?.step !== "end";

  function feedOrRest(): void {
    if (site.conveyor) void controls.ask({ key: "conveyor/set_feeding", query: { feeding: !isFed() } });
  }

  const speed = slider({
    label: "Speed",
    min: 0,
    max: 1.5,
    step: 0.05,
    unit: "m/s",
    initial: () => initialOf(site, "conveyor-sim", "speed"),
    send: setSpeed,
    onInvalid: (problem) => controls.toasts.show("error", problem),
  });
  const haltName = el("span", { text: "Stop the belts" });
  const haltIcon = icon("stop");
  const halt = el(
    "button",
    { type: "button", "aria-keyshortcuts": "S", onclick: () => self.halt() },
    haltIcon,
    haltName,
    key("S"),
  );
  const feedName = el("span", {});
  const feedIcon = icon("pause");
  const feed = el("button", { type: "button", onclick: feedOrRest }, feedIcon, feedName);
  const kinds = choice("Kind to add", (value) => void (kind = value));
  const addName = el("span", {});
  const add = el(
    "button",
    { type: "button", "aria-keyshortcuts": "P", onclick: () => self.add() },
    icon("plus"),
    addName,
    key("P"),
  );
  const bays = el("table", { className: "bays" });
  const element = section("Belts", speed.element, halt, feed, kinds.element, add, bays);
  const title = element.querySelector("h2")!;

  const self: Belts = {
    element,
    add() {
      if (controls.may("conveyor/add_package")) void addOne();
    },
    halt() {
      const now = site.conveyor?.speed_mps ?? 0;
      if (!controls.may("conveyor/set_speed")) return;
      if (now !== 0) before = now;
      void setSpeed(now === 0 ? before : 0);
    },
    faster(by) {
      if (controls.may("conveyor/set_speed") && site.conveyor)
        void setSpeed(Math.max(0, Math.min(1.5, site.conveyor.speed_mps + by)));
    },
    update() {
      const state = site.conveyor;
      const mayRun = controls.may("conveyor/set_speed");
      const mayAdd = controls.may("conveyor/add_package");
      show(element, state !== null && (mayRun || mayAdd || state.bays.some(({ bay }) => bay)));
      speed.set(state?.speed_mps ?? null);
      if (!state) return;
      show(speed.element, mayRun);
      show(halt, mayRun);
      show(feed, controls.may("conveyor/set_feeding"));
      show(add, mayAdd);
      show(kinds.element, mayAdd);
      const isStill = state.speed_mps === 0;
      const moving = movingOf(site);
      write(title, capital(moving));
      write(addName, `Add a ${nounOf(site)}`);
      write(haltName, `${isStill ? "Start" : "Stop"} the ${moving}`);
      mark(haltIcon.firstElementChild!, "href", isStill ? "#icon-play" : "#icon-stop");
      write(feedName, isFed() ? "Stop feeding" : state.step === "end" ? "Feed again" : "Start feeding");
      mark(feedIcon.firstElementChild!, "href", isFed() ? "#icon-pause" : "#icon-play");
      const offered = kindsHere();
      if (!offered.includes(kind)) kind = offered[0]!;
      kinds.offer(
        offered.map((name) => ({ value: name, label: capital(name), swatch: cssColor(kindColor(name)) })),
      );
      kinds.set(kind);
      showBays(state.bays.filter(({ bay }) => bay));
    },
  };

  /** The kinds that this scenario has, as far as they were on its belts or came out; the usual ones before any did. */
  function kindsHere(): readonly string[] {
    const here = `${controls.scenario} ${site.map?.name ?? ""}`;
    if (here !== seenIn) [seen, seenIn] = [new Set(), here];
    for (const { objects } of site.objects.values())
      for (const object of objects) if (object.kind) seen.add(object.kind);
    for (const each of site.conveyor?.bays ?? []) if (each.kind) seen.add(each.kind);
    if (!seen.size) return USUAL_KINDS;
    const place = (name: string) => (ORDER.includes(name) ? ORDER.indexOf(name) : ORDER.length);
    return [...seen].sort((a, b) => place(a) - place(b) || byName(a, b)).slice(0, MOST_KINDS);
  }

  function showBays(counts: readonly BayCount[]): void {
    show(bays, counts.length > 0);
    renew(bays, JSON.stringify(counts), () => {
      const names = [...new Set(counts.map((each) => each.kind))].sort(byName);
      const ids = [...new Set(counts.map((each) => each.bay))].sort(byName);
      const cell = (bay: string, name: string): string => {
        const found = counts.find((each) => each.bay === bay && each.kind === name);
        return found ? String(found.count) : "–";
      };
      return [
        el("caption", { text: "Came out" }),
        el(
          "thead",
          {},
          el(
            "tr",
            {},
            el("th", { scope: "col", text: "Bay" }),
            ...names.map((name) => el("th", { scope: "col", text: capital(name) })),
          ),
        ),
        el(
          "tbody",
          {},
          ...ids.map((bay) =>
            el(
              "tr",
              {},
              el("th", { scope: "row", text: bay }),
              ...names.map((name) => el("td", { text: cell(bay, name) })),
            ),
          ),
        ),
      ];
    });
  }
  return self;
}
