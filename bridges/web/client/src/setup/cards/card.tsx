/** What all cards have: a title that says the question, a body, what is wrong, and buttons. */

import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef, useState } from "preact/hooks";
import type { Pairing } from "../../people/pairing";
import type { HomeSetup } from "../../messages";
import { Button } from "../../ui/elements";
import type { SetupSession } from "../session";
import { cardOf, countOf, LEAD, stepBefore, titleOf, type Card } from "../setup_words";

export interface CardProps {
  session: SetupSession;
  setup: HomeSetup;
  pairing: Pairing;
  /** Put the card aside. */
  later(): void;
  /** Show the devices of the panel. */
  openDevices(): void;
  finish(): void;
}

interface FrameProps extends CardProps {
  children: ComponentChildren;
  buttons: ComponentChildren;
}

/** The frame of a card. One that opens has the focus at its title, so that it is read out. */
export function CardFrame({ session, setup, later, children, buttons }: FrameProps) {
  const title = useRef<HTMLHeadingElement>(null);
  const card = cardOf(setup) as Exclude<Card, "">;
  const before = card === "align" ? null : stepBefore(setup);
  useLayoutEffect(() => title.current!.focus(), []);
  return (
    <>
      <header>
        <div>
          <p class="muted" id="setup-count">
            {countOf(setup)}
          </p>
          <h2 tabindex={-1} id="setup-title" aria-describedby={`setup-count ${LEAD}`} ref={title}>
            {titleOf(card)}
          </h2>
        </div>
        <Button name="Later" kind="quiet" onClick={later} />
      </header>
      <div class="setup-body">{children}</div>
      <p class="reason" role="alert">
        {session.problem}
      </p>
      <div class="setup-buttons">
        {before && (
          <Button
            name="Back"
            kind="quiet"
            class="setup-back"
            onClick={() => void session.act({ act: "go", step: before })}
          />
        )}
        {buttons}
      </div>
    </>
  );
}

interface StatusProps {
  children: string;
  id?: string;
  class?: string;
}

/** Text that is read out when it changes. It comes after its element: what comes with it is not read out. */
export function Status({ children: text, id, class: look }: StatusProps) {
  const [said, say] = useState("");
  useLayoutEffect(() => say(text), [text]);
  return (
    <p role="status" id={id} class={look}>
      {said}
    </p>
  );
}
