/** The cards that set up a home: one question each, over the scene; what is answered is kept by the server at once. */

import { render, type FunctionComponent } from "preact";
import type { Controls } from "../controls";
import { LOOK_ID } from "../devices/devices_part";
import { el, mark, show } from "../dom";
import type { HomeSetup } from "../messages";
import type { Pairing } from "../people/pairing";
import { SET_UP, type Panel } from "../panel/panel";
import type { CardProps } from "./cards/card";
import { ChooseCard } from "./cards/choose";
import { ConnectCard } from "./cards/connect";
import { HandCard } from "./cards/hand";
import { TurnCard, WalkCard } from "./cards/placing";
import { TryCard } from "./cards/try";
import { thingTiles } from "../site/things";
import { nextStepOf } from "../words";
import { HomeView, type HomePointing } from "./home_view";
import { SetupSession } from "./session";
import type { Card } from "./setup_words";

/** User in the events of a switch that nobody pointed at, as of `pointit things try`. */
const OPERATOR = "operator";
/** Key of the browser's session under which the page of a site is shown in place of the home. */
const ADVANCED = "pointit-advanced";
const AGAIN = "Home in Set up opens each card again.";
const CARDS: Record<Exclude<Card, "">, FunctionComponent<CardProps>> = {
  connect: ConnectCard,
  choose: ChooseCard,
  hand: HandCard,
  align: TurnCard,
  place: TurnCard,
  walk: WalkCard,
  try: TryCard,
};

export class SetupCards {
  private readonly session: SetupSession;
  private readonly element = el("section", {
    className: "setup",
    "aria-labelledby": "setup-title",
    hidden: true,
  });
  /** The home, once it is set up: it lies over the page. */
  private readonly home = el("section", {
    className: "home-view",
    "aria-labelledby": "home-title",
    hidden: true,
  });
  /** The page of a site is shown in place of the home. */
  private isAdvanced = sessionStorage.getItem(ADVANCED) !== null;
  private readonly backHome = el(
    "button",
    { type: "button", className: "home-back", hidden: true, onclick: () => this.showAdvanced(false) },
    "Home",
  );
  private isThere = true;
  private isDue = false;
  /** Control that opened the card: the focus returns to it. */
  private opener: HTMLElement | null = null;

  constructor(
    private readonly controls: Controls,
    private readonly pairing: Pairing,
    private readonly panel: Panel,
  ) {
    document.querySelector("main")!.append(this.element);
    document.body.append(this.home, this.backHome);
    addEventListener("keydown", (event) => this.onKey(event), true);
    addEventListener("keyup", (event) => this.keepSpace(event), true);
    this.session = new SetupSession(controls, () => this.wake());
  }

  /** Names of lamps that have come since the last choice. */
  get added(): string[] {
    return this.session.added;
  }

  /** Return to a card, from the control that has the focus. */
  async go(step: HomeSetup["step"]): Promise<void> {
    this.opener = document.activeElement instanceof HTMLElement ? document.activeElement : null;
    this.session.isPutAside = false;
    if (await this.session.act({ act: "go", step })) this.focusTitle(); // also at the card that was put aside
  }

  update(isThere: boolean): void {
    this.isThere = isThere;
    this.wake();
  }

  /** Draw soon. What a component does while it is drawn may change the session, and must not draw within that. */
  private wake(): void {
    if (this.isDue) return;
    this.isDue = true;
    queueMicrotask(() => this.draw());
  }

  /** Draw the card, or hide it. The focus of one that goes returns to where it was opened, else to the panel. */
  private draw(): void {
    const { element, session } = this;
    const { card, setup } = session;
    this.isDue = false;
    const hadFocus = element.contains(document.activeElement);
    const isShown = this.isThere && session.isShown;
    show(element, isShown);
    mark(element, "data-card", card);
    if (card && setup) {
      const View = CARDS[card];
      render(
        <View
          key={card}
          session={session}
          setup={setup}
          pairing={this.pairing}
          later={() => this.later()}
          openDevices={() => this.openDevices()}
          finish={() => void this.finish()}
        />,
        element,
      );
    } else render(null, element);
    this.drawHome(isShown);
    if (!hadFocus) return;
    if (!isShown) this.returnFocus();
    else if (!element.contains(document.activeElement)) this.focusTitle(); // its control has gone
  }

  /** Draw the home, or hide it: while a card is open, before it is set up, and while the page is shown. */
  private drawHome(hasCard: boolean): void {
    const { controls, session } = this;
    const { setup } = session;
    const isReady = this.isThere && setup?.step === "done" && !hasCard;
    const isHome = isReady && !this.isAdvanced;
    const wasHidden = this.home.hidden;
    show(this.home, isHome);
    show(this.backHome, isReady && this.isAdvanced);
    document.body.classList.toggle("is-home", isHome);
    if (!isHome || !setup) return;
    render(
      <HomeView
        lamps={setup.lamps}
        things={thingTiles(controls.site)}
        pointing={this.pointing()}
        added={session.added}
        switchThing={(id) =>
          void controls.ask({ key: "selector/{user}/set_thing", name: OPERATOR, query: { thing: id } })
        }
        pair={() => this.pairing.open()}
        placeAgain={() => void this.go("place")}
        addLamps={() => void this.go("choose")}
        showAdvanced={() => this.showAdvanced(true)}
      />,
      this.home,
    );
    if (wasHidden && (document.activeElement === document.body || document.activeElement === null))
      document.getElementById("home-title")?.focus();
  }

  /** Who points, and their next step. */
  private pointing(): HomePointing {
    const { controls } = this;
    const { person } = controls;
    if (person?.interaction?.state !== "pointing")
      return { title: "Nobody points now", next: "Pair a phone, and point at a lamp." };
    return { title: `${controls.user} points`, next: nextStepOf(controls.site, person) };
  }

  private showAdvanced(isAdvanced: boolean): void {
    this.isAdvanced = isAdvanced;
    if (isAdvanced) sessionStorage.setItem(ADVANCED, "1");
    else sessionStorage.removeItem(ADVANCED);
    this.draw();
    if (isAdvanced) document.getElementById("panel")?.focus();
    else document.getElementById("home-title")?.focus();
  }

  private focusTitle(): void {
    document.getElementById("setup-title")?.focus();
  }

  private returnFocus(): void {
    const isOpenerShown = this.opener !== null && this.opener.offsetParent !== null;
    const target = isOpenerShown ? this.opener : document.getElementById("panel");
    target?.focus();
    this.opener = null;
  }

  private later(): void {
    this.session.isPutAside = true;
    this.wake();
    this.controls.toasts.show("info", `The set-up waits. ${AGAIN}`);
  }

  private async finish(): Promise<void> {
    if (await this.session.act({ act: "finish" })) this.controls.toasts.show("done", "Your home is set up.");
  }

  /** Show the devices of the panel. The card waits meanwhile. */
  private openDevices(): void {
    this.later();
    this.draw(); // the panel is there without a card only
    this.panel.open(SET_UP);
    document.getElementById(LOOK_ID)?.focus();
  }

  /** Space presses at the cards that place lamps, unless it is for a control that has the focus. */
  private onKey(event: KeyboardEvent): void {
    const { card } = this.session;
    const isTurn = (card === "place" || card === "align") && !this.element.hidden;
    if (this.keepSpace(event) || event.key !== " " || !isTurn || document.querySelector("dialog[open]"))
      return;
    if (
      event.target instanceof Element &&
      event.target.matches("button, input, select, textarea, summary, a")
    )
      return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) void this.session.act({ act: "press" });
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
