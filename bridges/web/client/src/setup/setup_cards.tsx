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
import { AlignCard, PlaceCard, WalkCard } from "./cards/placing";
import { TryCard } from "./cards/try";
import { SetupSession } from "./session";
import type { Card } from "./setup_words";

const AGAIN = "Home in Set up opens each card again.";
const CARDS: Record<Exclude<Card, "">, FunctionComponent<CardProps>> = {
  connect: ConnectCard,
  choose: ChooseCard,
  hand: HandCard,
  align: AlignCard,
  place: PlaceCard,
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
    if (!hadFocus) return;
    if (!isShown) this.returnFocus();
    else if (!element.contains(document.activeElement)) this.focusTitle(); // its control has gone
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
    if (await this.session.act({ act: "finish" }))
      this.controls.toasts.show("done", `Your home is set up. ${AGAIN}`);
  }

  /** Show the devices of the panel. A card that lies over them waits meanwhile. */
  private openDevices(): void {
    this.panel.open(SET_UP);
    const panel = document.getElementById("panel")!;
    const isOver = this.element.getBoundingClientRect().right > panel.getBoundingClientRect().left;
    if (isOver) this.later();
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
