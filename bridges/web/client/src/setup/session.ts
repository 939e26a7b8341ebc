/** The set-up of a home as its server has it: what this page asks of it, what was refused, what the network has. */

import type { Controls } from "../controls";
import { foundDevices, freeStrips, type FoundDevice } from "../devices/found";
import type { HomeSetup, SetUpHome } from "../messages";
import { Refusal } from "../site/asks";
import { brokerOf, type Card, cardOf, sentence } from "./setup_words";

/** Time between two questions for the state while a card is shown, and otherwise, ms. */
const READ_MS = 500;
const IDLE_MS = 5_000;
const ACT_MS = 15_000;
const SEARCH_MS = 15_000;
/** Time after which a text that was taken away counts as a new one, ms. */
const ANNOUNCE_MS = 100;
/** A lamp shows which one it is after the pointer has rested on its row, ms. */
const REST_MS = 300;

/** What a person does, and the token of Home Assistant or the password of a broker with it. */
type Act = Partial<SetUpHome> & { token?: string };

/** A server of lamps that was found in the network. */
export interface Home {
  readonly label: string;
  readonly url: string;
}

export class SetupSession {
  setup: HomeSetup | null = null;
  /** A card that was put aside waits until it is opened again. */
  isPutAside = false;
  isSearching = false;
  homes: readonly Home[] = [];
  lights: readonly FoundDevice[] = [];
  private isActing = false;
  /** Reason why the last act was not done, or "": until the server has told its state, which has it as well. */
  private refusal = "";
  private isSilent = false;
  private restTimer = 0;

  /** @param changed called after each change, to draw it. */
  constructor(
    readonly controls: Controls,
    private readonly changed: () => void,
  ) {
    void this.poll();
  }

  get card(): Card {
    return this.setup ? cardOf(this.setup) : "";
  }

  get isShown(): boolean {
    return this.card !== "" && !this.isPutAside;
  }

  /** What is wrong, in a sentence, or "". */
  get problem(): string {
    return this.isSilent ? "" : sentence(this.refusal || (this.setup?.problem ?? ""));
  }

  /** Names of lamps that have come since the last choice. */
  get added(): string[] {
    const lamps = this.setup?.lamps ?? [];
    return lamps.filter((lamp) => lamp.is_new).map((lamp) => lamp.label || lamp.id);
  }

  /** Do something. Returns whether it was done; else the reason is said. */
  async act(act: Act): Promise<boolean> {
    this.isActing = true;
    this.refusal = "";
    this.changed();
    const isDone = await this.ask(act, true);
    this.isActing = false;
    return isDone;
  }

  /** Do one of the choices of the next step. They are acts. */
  choose(id: string): Promise<boolean> {
    return this.act({ choice: id as SetUpHome["choice"] });
  }

  /** Say why something was not done, until the next act. */
  refuse(reason: string): void {
    // Empty meanwhile: the same reason once more is then read out once more
    this.isSilent = true;
    this.changed();
    setTimeout(() => {
      this.isSilent = false;
      this.refusal = reason;
      this.changed();
    }, ANNOUNCE_MS);
  }

  /** Look for Home Assistants and lights in the network. */
  async search(): Promise<void> {
    if (!this.controls.mayDo("find_devices")) return;
    this.isSearching = true;
    this.changed();
    try {
      this.found(await this.controls.connection.ask({ deed: "find_devices" }, SEARCH_MS));
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
    } finally {
      this.isSearching = false;
      this.changed();
    }
  }

  /** Let a lamp show which one it is, when the pointer rests on its row. */
  showLamp(id: string): void {
    clearTimeout(this.restTimer);
    this.restTimer = window.setTimeout(() => void this.ask({ act: "show", lamps: [id] }, false), REST_MS);
  }

  /** Connect a light of the network: its strip, or that of the map which waits for one, can be chosen then. */
  async connectLight({ kind, plugin, address, label }: FoundDevice): Promise<void> {
    const { site } = this.controls;
    const name = stripName(label);
    const free = freeStrips(site.map?.strips ?? [], site.status?.devices ?? []);
    const strip = free.find(({ id }) => id === name);
    await this.controls.askAloud(
      { deed: "connect_device", query: { kind, plugin, address, name: strip?.id ?? name } },
      ACT_MS,
    );
  }

  private async poll(): Promise<void> {
    for (;;) {
      if (this.controls.mayDo("set_up_home") && !this.isActing) await this.ask({ act: "read" }, false);
      await new Promise((resolve) => setTimeout(resolve, this.isShown ? READ_MS : IDLE_MS));
    }
  }

  private async ask({ token, ...query }: Act, isLoud: boolean): Promise<boolean> {
    try {
      const reply = await this.controls.connection.ask(
        { deed: "set_up_home", query: token ? { query, token } : { query } },
        ACT_MS,
      );
      this.take(reply as unknown as HomeSetup);
      return true;
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      if (isLoud || !this.setup) this.refuse(error.message);
      if (isLoud && !this.isShown) this.controls.toasts.show("error", sentence(error.message));
      return false;
    }
  }

  private take(setup: HomeSetup): void {
    const before = this.card;
    this.setup = setup;
    if (!this.isActing) this.refusal = "";
    // Without the zero of the device nobody can point
    if (this.card === "align" && before !== "align") this.isPutAside = false;
    this.changed();
    this.controls.changed();
  }

  private found(reply: Record<string, unknown>): void {
    const listed = Array.isArray(reply["homes"]) ? (reply["homes"] as Record<string, unknown>[]) : [];
    const homes = listed.map((home) => ({ label: String(home["label"]), url: String(home["url"] ?? "") }));
    this.lights = foundDevices(reply).filter(({ kind }) => kind === "light");
    const brokers = this.lights.filter(({ plugin }) => plugin === "mqtt").map(({ address }) => address);
    const onBrokers = [...new Set(brokers)].map((address) => ({
      label: `MQTT broker at ${address}`,
      url: brokerOf(address),
    }));
    this.homes = [...homes.filter(({ url }) => url), ...onBrokers];
  }
}

/** Name of a strip after its light's own. */
export function stripName(label: string): string {
  return label.split(",")[0]!.trim().slice(0, 60) || "light";
}
