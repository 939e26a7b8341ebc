/** Where is each lamp? Pointing at one lamp after another, from one place or two; and the zero of a device found again. */

import type { ComponentChildren } from "preact";
import { Button } from "../../ui/elements";
import { LEAD, placingText, pressText, progressText, STAY, WALK } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";

export function PlaceCard(props: CardProps) {
  const { session, setup } = props;
  return (
    <Turn
      {...props}
      progress={progressText(setup)}
      buttons={
        <>
          <Button name="Skip this lamp" kind="quiet" onClick={() => void session.act({ act: "skip" })} />
          <Button
            name="Take back"
            kind="quiet"
            isOff={!setup.can_take_back}
            onClick={() => void session.act({ act: "take_back" })}
          />
        </>
      }
    />
  );
}

export function AlignCard(props: CardProps) {
  const { session, setup } = props;
  const skip = <Button name="Skip" kind="quiet" onClick={() => void session.act({ act: "skip" })} />;
  return (
    <Turn
      {...props}
      progress="The zero of your device may have changed: this finds it again."
      buttons={setup.step === "place" ? null : skip}
    />
  );
}

interface TurnProps extends CardProps {
  progress: string;
  buttons: ComponentChildren;
}

/** The turn of one lamp, which ends with a press. */
function Turn({ progress, buttons, ...props }: TurnProps) {
  const { session, setup } = props;
  return (
    <CardFrame
      {...props}
      buttons={
        <>
          {buttons}
          <Button name="Press" kind="primary" onClick={() => void session.act({ act: "press" })} />
        </>
      }
    >
      <Status class="setup-turn" id={LEAD}>
        {placingText(setup)}
      </Status>
      <p class="muted">{progress}</p>
      <p class="muted">{pressText(setup.hand)}</p>
    </CardFrame>
  );
}

export function WalkCard(props: CardProps) {
  const { session } = props;
  return (
    <CardFrame
      {...props}
      buttons={
        <>
          <Button name="Take back" kind="quiet" onClick={() => void session.act({ act: "take_back" })} />
          <Button name="I stay here" onClick={() => void session.act({ act: "stay" })} />
          <Button name="I am there" kind="primary" onClick={() => void session.act({ act: "walk" })} />
        </>
      }
    >
      <p class="setup-turn" id={LEAD}>
        {WALK}
      </p>
      <p class="muted">{STAY}</p>
    </CardFrame>
  );
}
