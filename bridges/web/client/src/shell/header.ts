/** The header's state of the connection, and the way into the past of a running site. */

import type { Controls } from "../controls";
import { mark, show, write } from "../dom";
import { milliseconds } from "../format";
import { causes, isCutOff } from "../outage";

type State = "live" | "loading" | "lost" | "past" | "warning";

/** What the pill in the header says of the connection. */
export interface ConnectionState {
  readonly state: State;
  readonly icon: string;
  readonly text: string;
}

/** What the state of the connection depends on. */
export interface ConnectionFacts {
  readonly isOver: boolean;
  /** No status has come, and no reason why. */
  readonly isLoading: boolean;
  readonly isConnected: boolean;
  /** The site as a whole is out of reach. */
  readonly isCutOff: boolean;
  readonly hasWarnings: boolean;
  readonly isPast: boolean;
}

/** The first state that holds, the most important first. */
export function connectionState(facts: ConnectionFacts): ConnectionState {
  if (facts.isOver) return { state: "past", icon: "stop", text: "Ended" };
  if (facts.isLoading) return { state: "loading", icon: "live", text: "Connecting" };
  if (!facts.isConnected) return { state: "lost", icon: "close", text: "Lost" };
  if (facts.isCutOff) return { state: "lost", icon: "close", text: facts.isPast ? "Past" : "Cut off" };
  if (facts.hasWarnings) return { state: "warning", icon: "warning", text: facts.isPast ? "Past" : "Live" };
  if (facts.isPast) return { state: "past", icon: "history", text: "Past" };
  return { state: "live", icon: "live", text: "Live" };
}

export class Header {
  constructor(
    private readonly at: (id: string) => HTMLElement,
    private readonly controls: Controls,
  ) {}

  /** @param isLostTold a notice over the scene says why there is no connection. */
  update(isOver: boolean, isLostTold: boolean): void {
    const { at, controls } = this;
    const { site } = controls;
    const isPast = site.timeline !== null;
    write(at("site"), [site.hello?.site, site.timeline?.title].filter(Boolean).join(" · "));
    this.showVisit();
    this.showState(isOver, isLostTold);
    show(at("recorded"), site.connected && controls.isPresent("recorder") && !isPast);
    show(at("looks-on"), site.connected && site.hello?.role === "viewer" && !isPast);
  }

  private showState(isOver: boolean, isLostTold: boolean): void {
    const { at, controls } = this;
    const { site, connection } = controls;
    const isPast = site.timeline !== null;
    const shown = connectionState({
      isOver,
      isLoading: site.status === null && !isLostTold,
      isConnected: site.connected,
      isCutOff: isCutOff(site),
      hasWarnings: causes(site).length > 0,
      isPast,
    });
    const hasLatency = shown.state !== "lost" && !isPast;
    const median = hasLatency ? connection.latency.total(performance.now()).p50 : null;
    mark(at("pill"), "data-state", shown.state);
    mark(at("pill").querySelector("use")!, "href", `#icon-${shown.icon}`);
    write(at("pill-text"), shown.text);
    write(at("pill-latency"), median === null ? "" : `· ${milliseconds(median)}`);
  }

  /** Offer the way into the past of a running site, or out of it. */
  private showVisit(): void {
    const { site } = this.controls;
    const visit = this.at("visit");
    const isPast = site.timeline !== null;
    const name = isPast ? "Back to live" : "What just happened?";
    const shortcut = isPast ? "Escape" : "W";
    show(visit, site.connected && site.hello !== null && !site.timeline?.title);
    visit.classList.toggle("primary", isPast);
    mark(visit, "aria-keyshortcuts", shortcut);
    mark(visit.querySelector("use")!, "href", isPast ? "#icon-live" : "#icon-history");
    write(visit.querySelector("span")!, name);
    // Narrow pages show the icon only
    mark(visit, "aria-label", name);
    visit.title = `${name} (${isPast ? "Esc" : "W"})`;
  }
}
