/** Notices over the scene: why it stands still, or is not yet there. */

import { render } from "preact";
import type { Controls } from "../controls";
import { show, write } from "../dom";
import { outage } from "../outage";
import { Button, Icon } from "../ui/elements";

/** Attempts to connect after which the page says more than that it tries. */
const MAX_QUIET_ATTEMPTS = 6;
const MAX_FIRST_ATTEMPTS = 3;

/** What a lost connection is told by. */
export interface LostFacts {
  /** The server does not know this page's token any more. */
  readonly isRefused: boolean;
  /** The page has been connected before. */
  readonly wasConnected: boolean;
  readonly attempts: number;
  /** Reason of the server for which it closed the connection, or "". */
  readonly reason: string;
}

/** Why there is no connection, in a sentence. */
export function lostSentence({ isRefused, wasConnected, attempts, reason }: LostFacts): string {
  if (isRefused) return "PointIt was restarted: open the link that it prints.";
  if (wasConnected && attempts <= MAX_QUIET_ATTEMPTS)
    return "The connection is lost. What you see is old; trying again …";
  if (reason) return reason;
  if (attempts > MAX_FIRST_ATTEMPTS)
    return "PointIt does not answer. Open the link that it printed when it was started.";
  return "Connecting …";
}

export class Notices {
  private attempts = 0;

  /** @param openHealth shows the health tab, which has the whole of what is wrong. */
  constructor(
    private readonly at: (id: string) => HTMLElement,
    private readonly controls: Controls,
    private readonly openHealth: () => void,
  ) {}

  /** Whether a notice says that the connection is lost. */
  get isLostTold(): boolean {
    return !this.at("lost").hidden;
  }

  /** Note a change of the connection. */
  connectionChanged(isConnected: boolean, attempts: number): void {
    this.attempts = attempts;
    document.body.classList.toggle("stale", !isConnected && this.controls.site.hello !== null);
  }

  /** Say that the connection is lost; not when the run has ended, which is said instead. */
  showLost(isOver: boolean): void {
    const { at, attempts } = this;
    const { site, connection } = this.controls;
    const wasConnected = site.hello !== null;
    const isLost = !site.connected && !isOver && (wasConnected || attempts > 1 || connection.isRefused);
    const { isRefused, reason } = connection;
    show(at("lost"), isLost);
    write(at("lost-text"), isLost ? lostSentence({ isRefused, wasConnected, attempts, reason }) : "");
  }

  /** Say why the scene stands still, or is not yet there; without `pui` there is no map to draw. */
  showOutage(isDrawn: boolean): void {
    const { at, controls } = this;
    const { site } = controls;
    const told = site.connected ? outage(site) : null;
    const isAwaited = site.status === null || (!site.timeline && controls.isPresent("pui"));
    show(at("drawing"), !isDrawn && !told && isAwaited && !this.isLostTold);
    show(at("outage"), told !== null);
    render(
      told && (
        <>
          <Icon name="warning" />
          <span id="outage-text">
            <strong>{told.title}</strong> <span class="detail">{told.detail}</span>
          </span>
          <Button name="More" label="More about it in Health" onClick={this.openHealth} />
        </>
      ),
      at("outage"),
    );
  }
}
