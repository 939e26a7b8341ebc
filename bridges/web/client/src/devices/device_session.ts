/** Devices within reach of the page's machine: the search for them, and their connection. */

import type { Controls } from "../controls";
import type { DeviceLine } from "../wire";
import { foundDevices, foundHomes, isConnected, type FoundDevice, type FoundHome } from "./found";

/** Duration of a search, ms, and the most that it may take. */
const SEARCH_MS = 3_500;
const SEARCH_TIMEOUT_MS = 15_000;
/** A connection may first end a process, or write the map. */
const CONNECT_TIMEOUT_MS = 20_000;
const PROGRESS_PERIOD_MS = 100;
const BEFORE = "Wristbands, trackers, lights and Home Assistants near the machine that serves this page.";
const BELONGS_TO_NO_RUN =
  "This page belongs to no run: a command connects a device, in a terminal on that machine.";

export class DeviceSession {
  /** What the search has come to, in a sentence. */
  status = BEFORE;
  /** Share of the search that is over, or null while none runs. */
  progress: number | null = null;
  homes: readonly FoundHome[] = [];
  /** Searches that could not run, and why. */
  problems: readonly string[] = [];
  /** This page may connect; otherwise a command does. */
  canConnect = false;
  private found: readonly FoundDevice[] = [];
  /** Addresses that are being connected. */
  private readonly connecting = new Set<string>();
  /** Id of the wrist whose person is about to appear, to be shown how to wear it. */
  private awaited = "";

  constructor(readonly controls: Controls) {}

  /** Connected devices. */
  get lines(): readonly DeviceLine[] {
    return this.controls.site.status?.devices ?? [];
  }

  /** Devices that were found and are not connected. */
  get free(): readonly FoundDevice[] {
    return this.found.filter((each) => !isConnected(each, this.lines));
  }

  isConnecting({ address }: FoundDevice | DeviceLine): boolean {
    return this.connecting.has(address);
  }

  async search(): Promise<void> {
    this.status = "Looking …";
    const began = performance.now();
    this.progress = 0;
    const timer = setInterval(() => {
      this.progress = (performance.now() - began) / SEARCH_MS;
      this.controls.changed();
    }, PROGRESS_PERIOD_MS);
    this.controls.changed();
    const reply = await this.controls.ask({ deed: "find_devices" }, SEARCH_TIMEOUT_MS);
    clearInterval(timer);
    this.progress = null;
    this.take(reply);
    this.controls.changed();
  }

  async connect(device: FoundDevice | DeviceLine, name: string): Promise<void> {
    if (this.isConnecting(device)) return;
    const { kind, plugin, address } = device;
    this.connecting.add(address);
    this.controls.changed();
    const reply = await this.controls.askAloud(
      { deed: "connect_device", query: { kind, plugin, address, name } },
      CONNECT_TIMEOUT_MS,
    );
    this.connecting.delete(address);
    this.controls.changed();
    if (reply && kind === "wrist") this.awaited = String(reply["id"]);
  }

  /** Return the wrist that was connected here and has come now, once; else null. */
  arrived(): DeviceLine | null {
    const line = this.lines.find(({ id }) => id === this.awaited);
    if (!line?.is_on && !line?.problem) return null;
    this.awaited = "";
    return line.is_on ? line : null;
  }

  private take(reply: Record<string, unknown> | null): void {
    const listed: unknown = reply?.["problems"];
    this.found = foundDevices(reply ?? {});
    this.homes = foundHomes(reply ?? {});
    this.canConnect = reply?.["can_connect"] === true;
    this.problems = Array.isArray(listed) ? listed.map(String) : [];
    this.status = reply ? this.resultText() : "";
  }

  private resultText(): string {
    const searches = this.problems.length ? " by the searches that could run" : "";
    if (this.found.length + this.homes.length === 0)
      return `None found${searches}. Is it switched on, and in the same network?`;
    return this.canConnect ? "" : BELONGS_TO_NO_RUN;
  }
}
