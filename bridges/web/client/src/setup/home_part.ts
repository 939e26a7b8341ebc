/** The home in the panel: the way back to each card of its set-up. The cards are loaded when there is a home. */

import "./setup.css";
import type { Controls } from "../controls";
import { el, icon, section, show, write } from "../dom";
import type { HomeSetup } from "../messages";
import type { Pairing } from "../panel/pairing";
import type { PanelPart } from "../panel/panel_part";
import type { Panel } from "../panel/panel";
import type { SetupCards } from "./setup_cards";

const CARDS: readonly (readonly [HomeSetup["step"], string])[] = [
  ["connect", "Where lamps are"],
  ["choose", "Choose lamps"],
  ["hand", "What points"],
  ["place", "Place the lamps"],
  ["try", "Try"],
];

/** @param panel for the devices of its tab *Set up*. */
export function homePart(controls: Controls, pairing: Pairing, panel: () => Panel): PanelPart {
  const state = el("p", { className: "muted" });
  const buttons = CARDS.map(([step, name]) =>
    el(
      "button",
      { type: "button", onclick: () => void cards?.go(step) },
      icon("map"),
      el("span", { text: name }),
    ),
  );
  const element = section("Home", state, el("div", { className: "pairs" }, ...buttons));
  let cards: SetupCards | null = null;
  let isLoading = false;

  async function load(): Promise<void> {
    isLoading = true;
    const { SetupCards: Cards } = await import("./setup_cards");
    cards = new Cards(controls, pairing, panel());
    controls.changed();
  }

  return {
    element,
    update() {
      const has = (controls.site.hello?.home ?? false) && controls.site.timeline === null; // also while the connection is lost
      show(element, has);
      if (has && !cards && !isLoading) void load();
      cards?.update(has);
      const added = cards?.added ?? [];
      write(
        state,
        added.length
          ? `New lamps: ${added.join(", ")}. Choose lamps to point at them.`
          : "Each card can be opened again.",
      );
    },
  };
}
