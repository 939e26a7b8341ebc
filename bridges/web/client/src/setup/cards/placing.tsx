/** Where is each lamp? The next step is the server's own sentence, which the phone has too, with its choices. */

import { Button } from "../../ui/elements";
import { LEAD, pressText, repeatText } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";
import { LampRows } from "./lamp_rows";

/** Point at a lamp and press: one after another, or one that finds the zero of a device again. */
export function TurnCard(props: CardProps) {
  const { session, setup } = props;
  const isQuestion = setup.beside !== "";
  return (
    <CardFrame
      {...props}
      buttons={
        <>
          {setup.choices.map(({ id, label }) => (
            <Button
              name={label}
              key={id}
              kind={isQuestion ? "" : "quiet"}
              onClick={() => void session.choose(id)}
            />
          ))}
          <Button
            name="Press"
            kind="primary"
            isOff={setup.is_waiting}
            onClick={() => void session.act({ act: "press" })}
          />
        </>
      }
    >
      <Status class="setup-turn" id={LEAD}>
        {setup.next_step}
      </Status>
      <p class="muted">{pressText(setup.hand)}</p>
      <LampRows session={session} setup={setup} summary={repeatText(setup)} />
    </CardFrame>
  );
}

/** A step without pointing: the usual choice is the green button. */
export function WalkCard(props: CardProps) {
  const { session, setup } = props;
  const [usual, ...others] = setup.choices;
  return (
    <CardFrame
      {...props}
      buttons={
        <>
          {others.map(({ id, label }) => (
            <Button name={label} key={id} kind="quiet" onClick={() => void session.choose(id)} />
          ))}
          {usual && (
            <Button name={usual.label} kind="primary" onClick={() => void session.choose(usual.id)} />
          )}
        </>
      }
    >
      <Status class="setup-turn" id={LEAD}>
        {setup.next_step}
      </Status>
      <p class="muted">
        From two places, pointing works in between, too. If you always sit in one chair, stay: pointing works
        from that chair only.
      </p>
    </CardFrame>
  );
}
