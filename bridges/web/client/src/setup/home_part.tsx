/** The home in the panel: the way back to each card of its set-up. The cards are loaded when there is a home. */

import "./setup.css";
import type { Controls } from "../controls";
import type { HomeSetup } from "../messages";
import type { Pairing } from "../people/pairing";
import type { Panel } from "../panel/panel";
import { Button } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";
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
  const { site } = controls;
  let cards: SetupCards | null = null;
  let isLoading = false;
  const isThere = (): boolean => (site.hello?.home ?? false) && site.timeline === null; // also while the connection is lost
  const part = titledPart("Home", isThere, () => (
    <Home added={cards?.added ?? []} open={(step) => void cards?.go(step)} />
  ));

  async function load(): Promise<void> {
    isLoading = true;
    const { SetupCards: Cards } = await import("./setup_cards");
    cards = new Cards(controls, pairing, panel());
    controls.changed();
  }

  return {
    ...part,
    follow() {
      if (isThere() && !cards && !isLoading) void load();
      cards?.update(isThere());
    },
  };
}

interface HomeProps {
  /** Names of lamps that have come since the last choice. */
  added: readonly string[];
  open(step: HomeSetup["step"]): void;
}

function Home({ added, open }: HomeProps) {
  const news = `New lamps: ${added.join(", ")}. Choose lamps to point at them.`;
  return (
    <>
      <p class="muted">{added.length ? news : "Each card can be opened again."}</p>
      <div class="pairs">
        {CARDS.map(([step, name]) => (
          <Button name={name} key={step} icon="map" onClick={() => open(step)} />
        ))}
      </div>
    </>
  );
}
