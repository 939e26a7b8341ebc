/** The cards that set up a home: one question each, over the scene; what is answered is kept by the server at once. */

import type { Controls } from "../controls";
import { foundDevices, freeStrips, type FoundDevice } from "../devices/found";
import { el, mark, renew, show, write } from "../dom";
import { byName, capital } from "../format";
import type { HomeLamp, HomeSetup, SetUpHome } from "../messages";
import type { Pairing } from "../panel/pairing";
import type { Panel } from "../panel/panel";
import { Refusal } from "../site/asks";
import {
  byArea,
  type Card,
  cardOf,
  countOf,
  lampText,
  placingText,
  profileOf,
  progressText,
  STAY,
  stepBefore,
  titleOf,
  USUAL_URL,
  WALK,
} from "./setup_words";

/** Time between two questions for the state while a card is shown, and otherwise, ms. */
const READ_MS = 500;
const IDLE_MS = 5_000;
const ACT_MS = 15_000;
const SEARCH_MS = 15_000;
/** A lamp shows which one it is after the pointer has rested on its row, ms. */
const REST_MS = 300;
/** Tab *Set up* of the panel, with the devices. */
const SET_UP = 1;
const HANDS: readonly (readonly [HomeSetup["hand"], string])[] = [
  ["phone", "A phone"],
  ["wrist", "A wristband or tracker"],
  ["mouse", "The mouse, only to try it out: lamps get places side by side"],
];

/** What a person does, and the token of Home Assistant with it. */
type Act = Partial<SetUpHome> & { token?: string };

export class SetupCards {
  /** Names of lamps that Home Assistant has gained since the last choice. */
  added: string[] = [];
  private setup: HomeSetup | null = null;
  private card: Card = "";
  private isActing = false;
  private isClosed = false;
  /** Reason why the last act was not done, or "". */
  private refusal = "";
  private restTimer = 0;
  private homes: { label: string; url: string }[] = [];
  private lights: FoundDevice[] = [];
  private readonly count = el("p", { className: "muted" });
  private readonly title = el("h2", { tabindex: -1, id: "setup-title" });
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

  /** Return to a card. */
  async go(step: HomeSetup["step"]): Promise<void> {
    this.isClosed = false;
    await this.act({ act: "go", step });
  }

  update(isThere: boolean): void {
    show(this.element, isThere && this.card !== "" && !this.isClosed);
  }

  private close(): void {
    this.isClosed = true;
    this.update(true);
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
      return false;
    }
  }

  private take(setup: HomeSetup): void {
    this.setup = setup;
    this.added = setup.lamps.filter((lamp) => lamp.is_new).map((lamp) => lamp.label || lamp.id);
    const card = cardOf(setup);
    write(this.problem, capital(this.refusal || setup.problem));
    if (card !== this.card) {
      this.card = card;
      if (card) this.open(card, setup);
    }
    this.renewCard(setup);
    this.controls.changed();
    this.update(true);
  }

  /** Say why an act was not done, until the next one. */
  private refuse(reason: string): void {
    this.refusal = reason;
    write(this.problem, capital(reason));
  }

  private open(card: Exclude<Card, "">, setup: HomeSetup): void {
    this.isClosed = false;
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
    show(this.element, true);
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
    const found = el("fieldset", {});
    const state = el("p", { role: "status" });
    const tell = (): void => {
      mark(profile, "href", profileOf(url.value) || null);
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
          const secret = token.value.trim();
          if (!secret && !this.setup?.has_token)
            return this.refuse("paste the token first: it lets PointIt switch your lamps");
          void this.act({ act: "connect", url: url.value, ...(secret ? { token: secret } : {}) }).then(
            (isDone) => {
              if (isDone) token.value = "";
            },
          );
        },
      },
      el("label", { className: "field" }, el("span", { text: "Address of Home Assistant" }), url),
      el("label", { className: "field" }, el("span", { text: "Access token" }), token),
      el(
        "p",
        { className: "muted" },
        profile,
        ". It stays on this computer, in a file that only you can read.",
      ),
    );
    this.body.append(found, form, state);
    this.button("There is no Home Assistant", () => this.act({ act: "without" }), "quiet");
    this.buttons.append(
      el("button", { type: "submit", className: "primary", text: "Connect", form: "setup-form" }),
    );
    this.renewCard = ({ url: used, is_connected, problem }) => {
      write(state, used && !is_connected && !problem ? `Connecting to ${used} …` : "");
      renew(found, JSON.stringify(this.homes), () =>
        this.homes.map((home) =>
          el("button", {
            type: "button",
            text: home.label,
            onclick: () => {
              url.value = home.url;
              tell();
              token.focus();
            },
          }),
        ),
      );
    };
    void this.search();
  }

  /** Look for Home Assistants and lights in the network. */
  private async search(): Promise<void> {
    if (!this.controls.mayDo("find_devices")) return;
    try {
      const reply = await this.controls.connection.ask({ deed: "find_devices" }, SEARCH_MS);
      const homes = Array.isArray(reply["homes"]) ? (reply["homes"] as Record<string, unknown>[]) : [];
      this.homes = homes
        .map((home) => ({ label: String(home["label"]), url: String(home["url"] ?? "") }))
        .filter((home) => home.url);
      this.lights = foundDevices(reply).filter(({ kind }) => kind === "light");
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
    }
    if (this.setup) this.renewCard(this.setup);
  }

  choose(): void {
    const list = el("div", { className: "setup-body" });
    const nearby = el("fieldset", {});
    const states = new Map<string, HTMLElement>();
    const row = (lamp: HomeLamp): HTMLElement => {
      const state = el("span", { className: "muted" });
      states.set(lamp.id, state);
      const box = el("input", {
        type: "checkbox",
        name: lamp.id,
        checked: lamp.is_chosen,
        onfocus: () => this.showLamp(lamp.id),
      });
      return el(
        "label",
        { onpointerenter: () => this.showLamp(lamp.id) },
        box,
        el("span", { text: `${lamp.label || lamp.id}${lamp.is_new ? " (new)" : ""}` }),
        state,
      );
    };
    this.body.append(
      el("p", { className: "muted", text: "Rest on a row, and its lamp shows which one it is." }),
      list,
      nearby,
    );
    this.button("Look for lights in the network", () => this.search(), "quiet");
    this.button(
      "Next",
      () =>
        this.act({
          act: "choose",
          lamps: [...list.querySelectorAll<HTMLInputElement>("input:checked")].map(({ name }) => name),
        }),
      "primary",
    );
    this.renewCard = ({ lamps, is_connected, url }) => {
      renew(list, JSON.stringify(lamps.map(({ id, label, area }) => [id, label, area])), () =>
        lamps.length
          ? byArea(lamps).map(([area, own]) =>
              el("fieldset", {}, el("legend", { text: area || "Elsewhere" }), ...own.map(row)),
            )
          : [
              el("p", {
                role: "status",
                text: url && !is_connected ? "Waiting for Home Assistant …" : "No lamps are found yet.",
              }),
            ],
      );
      for (const lamp of lamps) write(states.get(lamp.id)!, lamp.state);
      const free = this.lights.filter(({ label }) => !lamps.some((lamp) => lamp.label === stripName(label)));
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
    const state = el("p", { role: "status" });
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
    const look = this.button("Look for wristbands", () => this.panel.open(SET_UP));
    this.body.append(
      el("fieldset", {}, el("legend", { text: "Point with" }), ...radios),
      el("label", { className: "field" }, el("span", { text: "Person" }), person),
      state,
    );
    this.button("Next", () => this.act({ act: "hand", hand: chosen(), user: person.value }), "primary");
    this.renewCard = () => {
      const users = [...controls.site.people.keys()].sort(byName);
      renew(person, users.join(" "), () =>
        users.map((user) => el("option", { value: user, text: user, selected: user === setup.user })),
      );
      const hand = chosen();
      const line = controls.site.people.get(person.value)?.line;
      show(pair, hand === "phone");
      show(look, hand === "wrist");
      write(
        state,
        hand !== "phone" || !person.value
          ? ""
          : line?.moved_by === "phone"
            ? "The phone points."
            : `${capital(line?.phone || "no phone is paired yet")}.`,
      );
    };
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
    const text = el("p", { className: "setup-turn", role: "status" });
    const progress = el("p", { className: "muted" });
    this.body.append(
      text,
      progress,
      el("p", {
        className: "muted",
        text: "Press by the button of your wrist, a tap on the phone, or Space here.",
      }),
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
        if (act === "take_back") buttons[index]!.disabled = !setup.can_take_back;
      });
    };
  }

  walk(): void {
    this.body.append(
      el("p", { className: "setup-turn", role: "status", text: WALK }),
      el("p", { className: "muted", text: STAY }),
    );
    this.button("Take back", () => this.act({ act: "take_back" }), "quiet");
    this.button("I stay here", () => this.act({ act: "stay" }));
    this.button("I am there", () => this.act({ act: "walk" }), "primary");
  }

  try(): void {
    const list = el("ul", {});
    const advice = el("ul", { className: "muted" });
    const text = el("p", { className: "setup-turn" });
    const stands = el("div", { className: "pairs" });
    this.body.append(text, list, advice, stands);
    this.button("Find my direction again", () => this.act({ act: "align" }), "quiet");
    this.button("Done", () => this.act({ act: "finish" }), "primary");
    this.renewCard = (setup) => {
      write(
        text,
        setup.hand === "mouse"
          ? "Take the arm with the mouse (M), and stay on a lamp: it switches."
          : "Point at each lamp: it brightens if it is on. Stay on it, or press, and it switches.",
      );
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
                text: `I stand at ${place}`,
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
