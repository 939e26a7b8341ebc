/** The run: how many of the objects to select were selected, whether feeding is over, and its end. */

import type { Controls } from "./controls";
import { show, write } from "./dom";
import { thingsOf, type Site } from "./site/site";
import { movingOf, nounOf } from "./words";

/** Time without a run after which it has ended, ms; a change of the scenario is shorter. */
const OVER_MS = 4_000;

/** Objects of the kinds to select: how many came to their end, and how many of them were selected. */
export interface Score {
  selected: number;
  passed: number;
}

/** Score of the conveyor or of segments on strips so far; null before the first object came out. */
export function scoreOf(
  { conveyor }: Pick<Site, "conveyor">,
  isWanted: (kind: string) => boolean,
): Score | null {
  const wanted = (conveyor?.bays ?? []).filter(({ kind }) => isWanted(kind));
  const passed = wanted.reduce((sum, { count }) => sum + count, 0);
  return passed ? { passed, selected: wanted.reduce((sum, { selected }) => sum + selected, 0) } : null;
}

/** Whether nothing more is fed, and everything that was fed has come to its end. */
export function haveAllPassed({ conveyor }: Pick<Site, "conveyor">): boolean {
  return conveyor?.step === "end" && conveyor.fed > 0 && conveyor.left >= conveyor.fed;
}

/** `All packages have passed: 8 of 10 red ones selected.`, or "" while more are to come. */
export function passedSentence(site: Site, controls: Pick<Controls, "isWanted" | "targetKinds">): string {
  if (site.timeline || !haveAllPassed(site)) return "";
  const score = scoreOf(site, (kind) => controls.isWanted(kind));
  return `All ${nounOf(site)}s have passed${score ? `: ${scoreWords(score, controls.targetKinds)} selected` : ""}.`;
}

/** Reason why nothing is on the conveyor, with the remedy; "" while something is, or comes. */
export function emptySentence(site: Site): string {
  const { conveyor } = site;
  const noun = nounOf(site);
  const moving = movingOf(site);
  if (!conveyor || thingsOf(site).length) return "";
  if (!conveyor.feeding)
    return `No ${noun} is here: feeding is stopped. Press Start feeding, or add a ${noun}.`;
  return conveyor.speed_mps
    ? ""
    : `No ${noun} is here: the ${moving} stand still. Press Start the ${moving}.`;
}

function scoreWords({ selected, passed }: Score, kinds: readonly string[]): string {
  return `${selected} of ${passed}${kinds.length === 1 ? ` ${kinds[0]} ones` : ""}`;
}

export interface RunEnd {
  update(): void;
  /** The run has ended on purpose. */
  readonly isOver: boolean;
}

/** Say in `host` that the run has ended, with its result. */
export function makeRunEnd(host: HTMLElement, controls: Controls): RunEnd {
  const { site } = controls;
  const text = host.querySelector("p")!;
  let result = "";
  let scenario = "";
  let isShipped = false;
  let since = Infinity;

  const self = {
    isOver: false,
    update() {
      const isOver = site.status?.run === "over" && !site.timeline;
      const now = performance.now();
      since = isOver ? Math.min(since, now) : Infinity;
      self.isOver = isOver && (!site.connected || now - since >= OVER_MS);
      if (controls.scenario && controls.scenario !== scenario) [scenario, result] = [controls.scenario, ""];
      if (controls.scenario)
        isShipped = controls.offers.some((each) => each.name === scenario && each.is_shipped);
      const score = scoreOf(site, (kind) => controls.isWanted(kind));
      // the kinds to select end with the deployment, the counts with their service
      if (!isOver && controls.scenario)
        result = score ? `: ${scoreWords(score, controls.targetKinds)} were selected` : "";
      show(host, self.isOver);
      const again = isShipped
        ? ` Start it again in a terminal: pointit run ${scenario}`
        : " Start it again where it was started.";
      write(text, self.isOver ? `The run has ended${result}.${again}` : "");
    },
  };
  return self;
}
