/** The cards that set up a home: one question each, over the scene; what is answered is kept by the server at once. */

import type { Controls } from "../controls";
import { LOOK_ID } from "../devices/devices_part";
import { foundDevices, freeStrips, type FoundDevice } from "../devices/found";
import { el, enable, mark, renew, show, write } from "../dom";
import { byName, capital } from "../format";
import type { HomeLamp, HomeSetup, SetUpHome } from "../messages";
import type { Pairing } from "../panel/pairing";
import type { Panel } from "../panel/panel";
import { Refusal } from "../site/asks";
import {
  BROKER,
  brokerOf,
  byArea,
  type Card,
  cardOf,
  countOf,
  handText,
  isBroker,
  lampText,
  LEAD,
  lightsText,
  placeName,
  placingText,
  pressText,
  profileOf,
  progressText,
  searchText,
  sentence,
  stateText,
  STAY,
  stepBefore,
  titleOf,
  tryText,
  USUAL_URL,
  WALK,
} from "./setup_words";

/** Time between two questions for the state while a card is shown, and otherwise, ms. */
const READ_MS = 500;
const IDLE_MS = 5_000;
const ACT_MS = 15_000;
const SEARCH_MS = 15_000;
/** Time after which a text that was taken away counts as a new one, ms. */
const ANNOUNCE_MS = 100;
/** A lamp shows which one it is after the pointer has rested on its row, ms. */
const REST_MS = 300;
/** Tab *Set up* of the panel, with the devices. */
const SET_UP = 1;
const AGAIN = "Home in Set up opens each card again.";
const HANDS: readonly (readonly [HomeSetup["hand"], string])[] = [
  ["phone", "A phone"],
  ["wrist", "A wristband or tracker"],
  ["mouse", "The mouse, only to try it out"],
];

/** What a person does, and the token of Home Assistant or the password of a broker with it. */
type Act = Partial<SetUpHome> & { token?: string };

export class SetupCards {
  /** Names of lamps that have come since the last choice. */
  added: string[] = [];
  private setup: HomeSetup | null = null;
  private card: Card = "";
  private isActing = false;
  private isClosed = false;
  /** Reason why the last act was not done, or "". */
  private refusal = "";
  private restTimer = 0;
  private homes: { label: string; url: string }[] = [];
  private isSearching = false;
  private lights: FoundDevice[] = [];
  /** Control that opened the card: the focus returns to it. */
  private opener: HTMLElement | null = null;
  private readonly count = el("p", { className: "muted", id: "setup-count" });
  private readonly title = el("h2", {
    tabindex: -1,
    id: "setup-title",
    "aria-describedby": `setup-count ${LEAD}`,
  });
  private readonly body = el("div", { className: "setup-body" });
  private readonly problem = el("p", { className: "reason", role: "alert" });
  private readonly buttons = el("div", { className: "setup-buttons" });
  private readonly element = el(
    "section",
    { className: "setup", "aria-labelledby": "setup-title", hidden: true },
    el(
      "header",
      {},
      el("div", {}, this.count, this.title),
      el("button", { type: "button", className: "quiet", text: "Later", onclick: () => this.close() }),
    ),
    this.body,
    this.problem,
    this.buttons,
  );
  /** Brings the present card up to date. */
  private renewCard: (setup: HomeSetup) => void = () => {};

  constructor(
    private readonly controls: Controls,
    private readonly pairing: Pairing,
    private readonly panel: Panel,
  ) {
    document.querySelector("main")!.append(this.element);
    addEventListener("keydown", (event) => this.onKey(event), true);
    addEventListener("keyup", (event) => this.keepSpace(event), true);
    void this.poll();
  }

  /** Return to a card, from the control that has the focus. */
  async go(step: HomeSetup["step"]): Promise<void> {
    this.opener = document.activeElement instanceof HTMLElement ? document.activeElement : null;
    this.isClosed = false;
    if (await this.act({ act: "go", step })) this.title.focus(); // also at the card that was put aside
  }

  /** Show the card, or not. The focus of one that goes returns to where the card was opened, else to the panel. */
  update(isThere: boolean): void {
    const hadFocus = this.element.contains(document.activeElement);
    show(this.element, isThere && this.card !== "" && !this.isClosed);
    if (!hadFocus || !this.element.hidden) return;
    const isOpenerShown = this.opener !== null && this.opener.offsetParent !== null;
    const target = isOpenerShown ? this.opener : document.getElementById("panel");
    target?.focus();
    this.opener = null;
  }

  private close(): void {
    this.isClosed = true;
    this.update(true);
    this.controls.toasts.show("info", `The set-up waits. ${AGAIN}`);
  }

  private async finish(): Promise<void> {
    if (await this.act({ act: "finish" })) this.controls.toasts.show("done", `Your home is set up. ${AGAIN}`);
  }

  private async poll(): Promise<void> {
    for (;;) {
      if (this.controls.mayDo("set_up_home") && !this.isActing) await this.ask({ act: "read" }, false);
      const isShown = this.card !== "" && !this.isClosed;
      await new Promise((resolve) => setTimeout(resolve, isShown ? READ_MS : IDLE_MS));
    }
  }

  private async act(act: Act): Promise<boolean> {
    this.isActing = true;
    this.refusal = "";
    write(this.problem, "");
    const isDone = await this.ask(act, true);
    this.isActing = false;
    return isDone;
  }

  /** Do something and show the state that follows; say why not. Returns whether it was done. */
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
      if (isLoud && this.element.hidden) this.controls.toasts.show("error", sentence(error.message));
      return false;
    }
  }

  private take(setup: HomeSetup): void {
    this.setup = setup;
    this.added = setup.lamps.filter((lamp) => lamp.is_new).map((lamp) => lamp.label || lamp.id);
    const card = cardOf(setup);
    this.showProblem();
    if (card !== this.card) {
      this.card = card;
      if (card) this.open(card, setup);
    }
    const hadFocus = this.element.contains(document.activeElement);
    this.renewCard(setup);
    const hasFocus = this.element.contains(document.activeElement);
    if (hadFocus && !hasFocus) this.title.focus(); // its control has gone
    this.controls.changed();
    this.update(true);
  }

  /** Say why an act was not done, until the next one. */
  private refuse(reason: string): void {
    this.refusal = reason;
    // Empty meanwhile: the same reason once more is then read out once more
    write(this.problem, "");
    setTimeout(() => this.showProblem(), ANNOUNCE_MS);
  }

  private showProblem(): void {
    write(this.problem, sentence(this.refusal || (this.setup?.problem ?? "")));
  }

  private open(card: Exclude<Card, "">, setup: HomeSetup): void {
    this.element.dataset.card = card;
    write(this.title, titleOf(card));
    write(this.count, countOf(setup));
    this.renewCard = () => {};
    this.body.replaceChildren();
    const before = stepBefore(setup);
    const back =
      card !== "align" && before
        ? [this.button("Back", () => this.act({ act: "go", step: before }), "setup-back quiet")]
        : [];
    this.buttons.replaceChildren(...back);
    this[card](setup);
    // A card that was put aside waits until it is opened again. Without the zero of the device nobody can point
    if (card === "align") this.isClosed = false;
    this.update(true);
    this.title.focus();
  }

  private button(name: string, run: () => Promise<unknown> | void, className = ""): HTMLButtonElement {
    const button = el("button", { type: "button", text: name, className, onclick: () => void run() });
    this.buttons.append(button);
    return button;
  }

  // Cards.

  connect(setup: HomeSetup): void {
    const url = el("input", {
      type: "text",
      inputmode: "url",
      value: setup.url || USUAL_URL,
      spellcheck: "false",
      autocomplete: "off",
    });
    const token = el("input", { type: "password", autocomplete: "off", spellcheck: "false" });
    const profile = el("a", {
      target: "_blank",
      rel: "noreferrer",
      text: "Make a token in your profile there, under Security",
    });
    const lead = el("p", { className: "muted", role: "status", id: LEAD });
    const hint = el(
      "p",
      { className: "muted" },
      profile,
      ". It stays on this computer, in a file that only you can read.",
    );
    const urlName = el("span", {});
    const tokenName = el("span", {});
    const found = el("fieldset", { className: "pairs", "aria-labelledby": LEAD });
    const state = el("p", { role: "status" });
    const tell = (): void => {
      const hasBroker = isBroker(url.value);
      write(urlName, hasBroker ? "Address of the broker" : "Address of Home Assistant");
      write(tokenName, hasBroker ? "Password, if the address has a user" : "Access token");
      show(hint, !hasBroker);
      mark(profile, "href", profileOf(url.value) || null);
    };
    const use = (address: string, next: HTMLInputElement): void => {
      url.value = address;
      tell();
      next.focus();
    };
    url.addEventListener("input", tell);
    tell();
    const form = el(
      "form",
      {
        className: "setup-body",
        id: "setup-form",
        onsubmit: (event) => {
          event.preventDefault();
          const hasBroker = isBroker(url.value);
          const secret = hasBroker ? token.value : token.value.trim();
          if (!secret && !hasBroker && !this.setup?.has_token)
            return this.refuse("paste the token first: it lets PointIt switch your lamps");
          void this.act({ act: "connect", url: url.value, ...(secret ? { token: secret } : {}) }).then(
            (isDone) => {
              if (isDone) token.value = "";
            },
          );
        },
      },
      el("label", { className: "field" }, urlName, url),
      el("label", { className: "field" }, tokenName, token),
      hint,
    );
    this.body.append(lead, found, form, state);
    const again = this.button("Look again", () => this.search(), "quiet");
    this.button("There is no Home Assistant", () => this.act({ act: "without" }), "quiet");
    this.button("Lamps on an MQTT broker", () => use(BROKER, url), "quiet");
    this.buttons.append(
      el("button", { type: "submit", className: "primary", text: "Connect", form: "setup-form" }),
    );
    this.renewCard = ({ url: used, is_connected, problem }) => {
      write(lead, searchText(this.isSearching, this.homes.length));
      show(found, this.homes.length > 0);
      enable(again, !this.isSearching);
      write(state, used && !is_connected && !problem ? `Connecting to ${used} …` : "");
      renew(found, JSON.stringify(this.homes), () =>
        this.homes.map((home) =>
          el("button", {
            type: "button",
            text: home.label,
            onclick: () => use(home.url, token),
          }),
        ),
      );
    };
    void this.search();
  }

  /** Look for Home Assistants and lights in the network. */
  private async search(): Promise<void> {
    if (!this.controls.mayDo("find_devices")) return;
    this.isSearching = true;
    if (this.setup) this.renewCard(this.setup);
    try {
      const reply = await this.controls.connection.ask({ deed: "find_devices" }, SEARCH_MS);
      const homes = Array.isArray(reply["homes"]) ? (reply["homes"] as Record<string, unknown>[]) : [];
      this.homes = homes
        .map((home) => ({ label: String(home["label"]), url: String(home["url"] ?? "") }))
        .filter((home) => home.url);
      this.lights = foundDevices(reply).filter(({ kind }) => kind === "light");
      const brokers = this.lights.filter(({ plugin }) => plugin === "mqtt").map(({ address }) => address);
      for (const address of new Set(brokers))
        this.homes.push({ label: `MQTT broker at ${address}`, url: brokerOf(address) });
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
    } finally {
      this.isSearching = false;
    }
    if (this.setup) this.renewCard(this.setup);
  }

  choose(): void {
    const list = el("div", { className: "setup-body" });
    const nearby = el("div", { className: "pairs" });
    const emptyState = el("p", { role: "status" });
    const lookState = el("p", { className: "muted", role: "status" });
    const refused = el("ul", { className: "muted" });
    let hasLooked = false;
    const states = new Map<string, HTMLElement>();
    /** Ticks of this page: the list is made anew when Home Assistant gains a lamp. */
    const ticks = new Map<string, boolean>();
    const row = (lamp: HomeLamp): HTMLElement => {
      const number = states.size;
      const name = el("span", {
        id: `setup-lamp-${number}`,
        text: `${lamp.label || lamp.id}${lamp.is_new ? " (new)" : ""}`,
      });
      const state = el("span", { className: "muted", id: `setup-state-${number}` });
      states.set(lamp.id, state);
      const box = el("input", {
        type: "checkbox",
        name: lamp.id,
        checked: ticks.get(lamp.id) ?? lamp.is_chosen,
        "aria-labelledby": name.id,
        "aria-describedby": state.id,
        onfocus: () => this.showLamp(lamp.id),
        onchange: ({ target }) => ticks.set(lamp.id, (target as HTMLInputElement).checked),
      });
      return el("label", { onpointerenter: () => this.showLamp(lamp.id) }, box, name, state);
    };
    this.body.append(
      el("p", {
        className: "muted",
        id: LEAD,
        text: "Rest on a row, and its lamp shows which one it is.",
      }),
      list,
      emptyState,
      lookState,
      refused,
      nearby,
    );
    const look = (): Promise<void> => {
      hasLooked = true;
      return this.search();
    };
    const again = this.button("Look for lights in the network", look, "quiet");
    this.button(
      "Next",
      () =>
        this.act({
          act: "choose",
          lamps: [...list.querySelectorAll<HTMLInputElement>("input:checked")].map(({ name }) => name),
        }),
      "primary",
    );
    this.renewCard = ({ lamps, is_connected, url, advice }) => {
      renew(refused, JSON.stringify(advice), () =>
        advice.map((sentence) => el("li", { text: capital(sentence) })),
      );
      renew(list, JSON.stringify(lamps.map(({ id, label, area }) => [id, label, area])), () => {
        states.clear();
        return byArea(lamps).map(([area, own]) =>
          el("fieldset", {}, el("legend", { text: area || "Elsewhere" }), ...own.map(row)),
        );
      });
      const isWaiting = url !== "" && !is_connected;
      const nothing = isWaiting ? "Waiting for your lamps …" : "No lamps are found yet.";
      write(emptyState, lamps.length ? "" : nothing);
      for (const lamp of lamps) write(states.get(lamp.id)!, stateText(lamp.state));
      const offered = this.lights.filter(({ plugin }) => plugin !== "mqtt" || !isBroker(url));
      const free = offered.filter(({ label }) => !lamps.some((lamp) => lamp.label === stripName(label)));
      enable(again, !this.isSearching);
      write(lookState, hasLooked ? lightsText(this.isSearching, free.length) : "");
      renew(nearby, JSON.stringify(free), () =>
        free.map((light) =>
          el("button", {
            type: "button",
            text: `Connect ${light.label}`,
            onclick: () => void this.connectLight(light),
          }),
        ),
      );
    };
  }

  /** Connect a light of the network: its strip, or that of the map which waits for one, can be chosen then. */
  private async connectLight({ kind, plugin, address, label }: FoundDevice): Promise<void> {
    const { site } = this.controls;
    const free = freeStrips(site.map?.strips ?? [], site.status?.devices ?? []).find(
      ({ id }) => id === stripName(label),
    );
    await this.controls.askAloud(
      { deed: "connect_device", query: { kind, plugin, address, name: free?.id ?? stripName(label) } },
      ACT_MS,
    );
  }

  private showLamp(id: string): void {
    clearTimeout(this.restTimer);
    this.restTimer = window.setTimeout(() => void this.ask({ act: "show", lamps: [id] }, false), REST_MS);
  }

  hand(setup: HomeSetup): void {
    const { controls } = this;
    const person = el("select", {});
    const who = el("label", { className: "field" }, el("span", { text: "Person" }), person);
    const state = el("p", { role: "status", id: LEAD });
    const radios = HANDS.map(([hand, name]) =>
      el(
        "label",
        {},
        el("input", { type: "radio", name: "hand", value: hand, checked: (setup.hand || "phone") === hand }),
        el("span", { text: name }),
      ),
    );
    const chosen = (): HomeSetup["hand"] =>
      (this.body.querySelector<HTMLInputElement>("input[name=hand]:checked")?.value ??
        "phone") as HomeSetup["hand"];
    const pair = this.button("Pair a phone", () => {
      controls.choose(person.value);
      this.pairing.open();
    });
    const look = this.button("Look for wristbands", () => this.openDevices());
    const choice = el("div", { role: "radiogroup", "aria-labelledby": this.title.id }, ...radios);
    choice.addEventListener("change", () => this.renewCard(this.setup ?? setup));
    this.body.append(choice, who, state);
    const next = this.button("Next", () => this.act({ act: "hand", hand: chosen(), user: person.value }));
    this.renewCard = () => {
      const users = [...controls.site.people.keys()].sort(byName);
      renew(person, users.join(" "), () =>
        users.map((user) => el("option", { value: user, text: user, selected: user === setup.user })),
      );
      show(who, users.length > 1);
      const hand = chosen();
      const line = controls.site.people.get(person.value)?.line ?? null;
      show(pair, hand === "phone");
      show(look, hand === "wrist");
      // The phone is paired first, and then it goes on
      const isWaiting = hand === "phone" && line?.moved_by !== "phone";
      pair.classList.toggle("primary", isWaiting);
      next.classList.toggle("primary", !isWaiting);
      write(state, handText(hand, line));
    };
  }

  /** Show the devices of the panel. A card that lies over them waits meanwhile. */
  private openDevices(): void {
    this.panel.open(SET_UP);
    const panel = document.getElementById("panel")!;
    const isOver = this.element.getBoundingClientRect().right > panel.getBoundingClientRect().left;
    if (isOver) this.close();
    document.getElementById(LOOK_ID)?.focus();
  }

  place(): void {
    this.turn([
      ["Skip this lamp", "skip"],
      ["Take back", "take_back"],
      ["Press", "press"],
    ]);
  }

  align(): void {
    this.turn(
      this.setup?.step === "place"
        ? [["Press", "press"]]
        : [
            ["Skip", "skip"],
            ["Press", "press"],
          ],
    );
  }

  private turn(acts: readonly (readonly [string, SetUpHome["act"]])[]): void {
    const text = el("p", { className: "setup-turn", role: "status", id: LEAD });
    const progress = el("p", { className: "muted" });
    this.body.append(
      text,
      progress,
      el("p", { className: "muted", text: pressText(this.setup?.hand ?? "") }),
    );
    const buttons = acts.map(([name, act], index) =>
      this.button(name, () => this.act({ act }), index === acts.length - 1 ? "primary" : "quiet"),
    );
    this.renewCard = (setup) => {
      write(text, placingText(setup));
      write(
        progress,
        setup.is_aligning
          ? "The zero of your device may have changed: this finds it again."
          : progressText(setup),
      );
      acts.forEach(([, act], index) => {
        if (act === "take_back") enable(buttons[index]!, setup.can_take_back);
      });
    };
  }

  walk(): void {
    this.body.append(
      el("p", { className: "setup-turn", id: LEAD, text: WALK }),
      el("p", { className: "muted", text: STAY }),
    );
    this.button("Take back", () => this.act({ act: "take_back" }), "quiet");
    this.button("I stay here", () => this.act({ act: "stay" }));
    this.button("I am there", () => this.act({ act: "walk" }), "primary");
  }

  try(): void {
    const list = el("ul", {});
    const advice = el("ul", { className: "muted" });
    const text = el("p", { className: "setup-turn", id: LEAD });
    const stands = el("div", { className: "pairs" });
    this.body.append(text, list, advice, stands);
    if (this.setup?.hand !== "mouse")
      this.button("Find my direction again", () => this.act({ act: "align" }), "quiet");
    this.button("Done", () => this.finish(), "primary");
    this.renewCard = (setup) => {
      write(text, tryText(setup.hand));
      renew(list, JSON.stringify(setup.lamps), () =>
        setup.lamps.map((lamp) => el("li", { text: lampText(lamp) })),
      );
      renew(advice, JSON.stringify(setup.advice), () =>
        setup.advice.map((sentence) => el("li", { text: capital(sentence) })),
      );
      renew(stands, String(setup.places_m.length), () =>
        setup.places_m.length < 2
          ? []
          : (["A", "B"] as const).map((place) =>
              el("button", {
                type: "button",
                text: `I stand at the ${placeName(place)}`,
                onclick: () => void this.act({ act: "stand", place }),
              }),
            ),
      );
    };
  }

  /** Space presses at the cards that place lamps, unless it is for a control that has the focus. */
  private onKey(event: KeyboardEvent): void {
    const isTurn = (this.card === "place" || this.card === "align") && !this.element.hidden;
    if (this.keepSpace(event) || event.key !== " " || !isTurn || document.querySelector("dialog[open]"))
      return;
    if (
      event.target instanceof Element &&
      event.target.matches("button, input, select, textarea, summary, a")
    )
      return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) void this.act({ act: "press" });
  }

  /** Space at a control of a card is for that control, not the button of a wrist. Returns whether it was. */
  private keepSpace(event: KeyboardEvent): boolean {
    const isOwn =
      event.key === " " &&
      event.target instanceof Element &&
      this.element.contains(event.target) &&
      event.target.matches("button, input, select, a");
    if (isOwn) event.stopPropagation();
    return isOwn;
  }
}

/** Name of a strip after its light's own. */
function stripName(label: string): string {
  return label.split(",")[0]!.trim().slice(0, 60) || "light";
}
