/** Model of the controls: the site, permitted requests, and the person they are for. */

import type { Reply, Wish } from "./site/asks";
import { Refusal } from "./site/asks";
import type { Connection } from "./site/connection";
import { byName, capital } from "./format";
import type { CancelLocalization, ScenarioOffer, SelectionEvent, Step } from "./messages";
import { seenRobots } from "./site/robots";
import type { Settings } from "./settings";
import { siteNow, type Person, type Site } from "./site/site";
import { hasSelected } from "./site/things";
import type { Toasts } from "./toasts";
import { SERVERS, type RequestKey } from "./topics";
import type { Hello, PersonLine } from "./wire";
import { called, friendly, listed, outcome } from "./words";

type Deed = Hello["deeds"][number];

/** An undo or a clear that this page has asked for, and the names of its objects. */
interface TakenBack {
  readonly cause: "undo" | "clear";
  readonly user: string;
  readonly names: string[];
  /** Names of those for which it was too late. */
  readonly late: string[];
}

export class Controls {
  private chosen = "";
  /** Objects that this page has selected, and since when (site time, ns) it moves whose wrist. */
  private readonly own = new Set<string>();
  private lastHeld = "";
  private holds = { user: "", sinceNs: Infinity };
  /** What this page undid or cleared last; its events may come in several batches. */
  private takenBack: TakenBack | null = null;

  constructor(
    readonly site: Site,
    readonly settings: Settings,
    readonly connection: Connection,
    readonly toasts: Toasts,
    /** Redraws everything that depends on the controls. */
    readonly changed: () => void,
  ) {}

  /** Person of the controls: the chosen one, else the one this page moves, else the first. */
  get user(): string {
    const { people } = this.site;
    if (people.has(this.chosen)) return this.chosen;
    return this.mine?.user ?? [...people.keys()].sort(byName)[0] ?? "";
  }

  get person(): Person | null {
    return this.site.people.get(this.user) ?? null;
  }

  /** The person whose wrist this page's mouse moves. */
  get mine(): Person | null {
    for (const person of this.site.people.values()) {
      if (person.line?.is_mine && person.line.moved_by === "mouse") return person;
    }
    return null;
  }

  /** Note whose wrist this page's mouse moves, after each status. */
  follow(): void {
    const user = this.mine?.user ?? "";
    if (user === this.holds.user || !this.site.connected) return;
    if (user && user !== this.lastHeld) this.own.clear();
    this.lastHeld = user || this.lastHeld;
    this.holds = { user, sinceNs: user ? siteNow(this.site) : Infinity };
  }

  /** Whether this page's mouse caused what happened to `user` at `stampNs`, not whoever pointed before. */
  isOwn({ user, stampNs }: { user: string; stampNs: number }): boolean {
    return user !== "" && user === this.holds.user && stampNs >= this.holds.sinceNs;
  }

  /** Note that this page has selected an object, or not any more. */
  setSelected(id: string, isSelected: boolean): void {
    if (isSelected) this.own.add(id);
    else this.own.delete(id);
  }

  /** Whether this page has selected the object. */
  hasSelected(id: string): boolean {
    return this.own.has(id);
  }

  choose(user: string): void {
    this.chosen = user;
    this.changed();
  }

  isPresent(service: string, user = ""): boolean {
    const instance = user ? `${service}.${user}` : service;
    return this.site.status?.services.some((each) => each.present && each.instance === instance) ?? false;
  }

  /** Whether this page may make the request, and its server is present. */
  may(key: RequestKey): boolean {
    const { site } = this;
    if (!site.connected || !site.hello?.requests.includes(key)) return false;
    if (key === "run/scenario") return this.offers.length > 0;
    return this.isPresent(SERVERS[key]) || this.isPresent(SERVERS[key], this.user);
  }

  mayDo(deed: Deed): boolean {
    return this.site.connected && (this.site.hello?.deeds.includes(deed) ?? false);
  }

  /** Scenarios that can be run, with their titles. */
  get offers(): readonly ScenarioOffer[] {
    for (const { offers } of this.site.deployments.values()) if (offers?.length) return offers;
    return [];
  }

  /** Title of the running scenario, or of one that can be run. */
  titleOf(scenario: string): string {
    const running = [...this.site.deployments.values()].find((each) => each.scenario === scenario);
    return capital(
      this.offers.find(({ name }) => name === scenario)?.title ||
        running?.title ||
        scenario.replaceAll("_", " "),
    ); // old recordings have no titles
  }

  /** Name of the running scenario, or "". */
  get scenario(): string {
    const all = [...this.site.deployments.values()];
    return (
      all.find((each) => each.scenario)?.scenario ??
      all.find((each) => each.services.some((s) => !s.user))?.name ??
      ""
    );
  }

  /** Kinds to select. Empty means all. */
  get targetKinds(): readonly string[] {
    return [...new Set([...this.site.deployments.values()].flatMap((each) => each.target_kinds ?? []))];
  }

  /** Whether an object of this kind is one to select; of a scenario that names no kinds, every object is. */
  isWanted(kind: string): boolean {
    const kinds = this.targetKinds;
    return !kind || kinds.length === 0 || kinds.includes(kind);
  }

  /** What moves the arm of `user` while no page or phone has it. */
  sourceOf(user: string): PersonLine["source"] {
    return this.site.people.get(user)?.line?.source ?? "device";
  }

  /** What there is to do here, as the site says in one sentence, or "". */
  get goal(): string {
    return [...this.site.deployments.values()].map(({ goal }) => goal).find(Boolean) ?? "";
  }

  /** Send a request, and show the reason of a refusal. Returns the reply, or null if refused. */
  async ask(wish: Wish, patienceMs?: number): Promise<Reply | null> {
    try {
      return await this.connection.ask(wish, patienceMs);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      if (!this.site.connected) return null; // which is said over the scene
      this.toasts.show("error", friendly(this.site, error.message));
      return null;
    }
  }

  /** Send a request, and show the message of its reply as well. */
  async askAloud(wish: Wish, patienceMs?: number): Promise<Reply | null> {
    const reply = await this.ask(wish, patienceMs);
    const message = reply?.["message"];
    if (typeof message === "string" && message)
      this.toasts.show("info", capital(friendly(this.site, message)));
    return reply;
  }

  /** Whether this page may stop robots: every robot, since the reply says if its service does not answer. */
  get mayStop(): boolean {
    return this.site.connected && (this.site.hello?.requests.includes("robots/{robot}/stop") ?? false);
  }

  /** Robots that this page may stop. */
  get stoppable(): readonly string[] {
    return this.mayStop ? seenRobots(this.site).map(({ name }) => name) : [];
  }

  /** Stop robots, all by default; each is asked for itself, so that one that does not answer holds up no other. */
  async stopRobots(robots: readonly string[] = this.stoppable): Promise<void> {
    const replies = await Promise.all(
      robots.map((name) =>
        this.ask({ key: "robots/{robot}/stop", name, query: { reason: "from the page" } }),
      ),
    );
    const stopped = robots.filter((_, i) => replies[i]);
    if (stopped.length) this.toasts.show("done", `Stopped: ${stopped.join(", ")}.`);
  }

  press(user = this.user): void {
    if (this.mayDo("press") && user) void this.ask({ deed: "press", name: user });
  }

  /** Whether names are announced to the person, so that they can step from one thing to the next. */
  get canStep(): boolean {
    return this.mayDo("step") && Boolean(this.person?.announced);
  }

  /** Whether this page is to speak names, to somebody who may point. */
  get speaks(): boolean {
    return this.mayDo("step") && (this.site.hello?.speaks ?? false);
  }

  step(by: -1 | 1, to: Step["to"]): void {
    void this.ask({ deed: "step", name: this.user, query: { by, to } });
  }

  localize(): void {
    if (this.may("localizer/{user}/start"))
      void this.askAloud({ key: "localizer/{user}/start", name: this.user });
  }

  /** Stop localizing; with `forget_bias`, the next localization by a robot expects no elevation bias. */
  cancel(query: Partial<CancelLocalization> = {}): void {
    if (this.may("localizer/{user}/cancel"))
      void this.askAloud({ key: "localizer/{user}/cancel", name: this.user, query });
  }

  /** Whether the person has selected something that they can clear. */
  get canClear(): boolean {
    return hasSelected(this.site, this.user);
  }

  /** Whether an action of the person can be undone, as the selector tells. */
  get canUndo(): boolean {
    return this.site.selection?.undoable?.includes(this.user) ?? false;
  }

  undo(): void {
    if (this.may("selector/{user}/undo")) void this.takeBack("undo", this.canUndo);
  }

  clear(): void {
    if (this.may("selector/{user}/clear")) void this.takeBack("clear", this.canClear);
  }

  private async takeBack(cause: TakenBack["cause"], can: boolean): Promise<void> {
    const { user } = this;
    if (!can) return this.toasts.show("info", `There is nothing to ${cause} for ${user}.`);
    const asked: TakenBack = { cause, user, names: [], late: [] };
    this.takenBack = asked;
    if (!(await this.ask({ key: `selector/{user}/${cause}`, name: user })) && this.takenBack === asked)
      this.takenBack = null;
  }

  /**
   * Tell of an undone or cleared object, if this page asked for it: all of one action in one toast.
   * Returns whether it did.
   */
  tellTakenBack(event: SelectionEvent): boolean {
    const asked = this.takenBack;
    const { site } = this;
    if (!asked || event.cause !== asked.cause || event.user !== asked.user) return false;
    if (event.event === "refused" && asked.cause === "undo") return true; // which the answer says
    const what = called(site, event.object_id, event.kind);
    const { names, late } = asked;
    const isClear = asked.cause === "clear";
    (event.event === "refused" ? late : names).push(what);
    this.setSelected(event.object_id, event.event === "selected");
    const does = isClear ? "Cleared" : `${outcome(site, event)}${event.event === "selected" ? " again" : ""}`;
    const text = [
      names.length ? `${does}: ${listed(names)}.` : "",
      late.length ? `Too late for ${listed(late)}.` : "",
    ]
      .filter(Boolean)
      .join(" ");
    this.toasts.show(names.length ? "done" : "info", text, {
      action: isClear && names.length ? { name: "Undo", run: () => this.undo() } : undefined,
      topic: asked,
    });
    return true;
  }

  /** Whether people are localized by pointing at lamps; otherwise their poses are configured. */
  get localizes(): boolean {
    return [...this.site.deployments.values()].some((each) => each.localizes && each.services.length > 0);
  }

  /** Whether localizing is useful: the person's pose is not configured, and there are lamps. */
  get canLocalize(): boolean {
    return this.localizes && this.may("localizer/{user}/start") && (this.site.map?.lamps.length ?? 0) > 0;
  }
}
