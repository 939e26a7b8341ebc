/** Try it: each lamp in turn. It reacts, or another one does, which is corrected here. */

import { Button } from "../../ui/elements";
import { lampText, LEAD, placeName, tryCountText } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";
import { LampRow } from "./lamp_rows";

export function TryCard(props: CardProps) {
  const { session, setup } = props;
  const { hand, lamps, advice, places_m: places, tried, choices } = setup;
  const [usual, ...others] = choices;
  const choose = (id: string): void => (id === "finish" ? props.finish() : void session.choose(id));
  return (
    <CardFrame
      {...props}
      buttons={
        <>
          {tried !== "" && <Button name="Done" kind="quiet" onClick={props.finish} />}
          {others.map(({ id, label }) => (
            <Button name={label} key={id} onClick={() => choose(id)} />
          ))}
          {usual && <Button name={usual.label} kind="primary" onClick={() => choose(usual.id)} />}
        </>
      }
    >
      <Status class="setup-turn" id={LEAD}>
        {setup.next_step}
      </Status>
      <p class="muted">{hand === "mouse" ? "" : tryCountText(lamps)}</p>
      <details class="setup-rows">
        <summary>All lamps</summary>
        <ul>
          {lamps.map((lamp) =>
            setup.may_repeat.length ? (
              <LampRow key={lamp.id} session={session} setup={setup} lamp={lamp} />
            ) : (
              <li key={lamp.id}>{lampText(lamp)}</li>
            ),
          )}
        </ul>
        <ul class="muted">
          {advice.map((sentence) => (
            <li key={sentence}>{sentence}</li>
          ))}
        </ul>
        <div class="pairs">
          {hand !== "mouse" && (
            <Button
              name="Find my direction again"
              kind="quiet"
              onClick={() => void session.act({ act: "align" })}
            />
          )}
          {places.length > 1 &&
            (["A", "B"] as const).map((place) => (
              <Button
                name={`I stand at the ${placeName(place)}`}
                key={place}
                onClick={() => void session.act({ act: "stand", place })}
              />
            ))}
        </div>
      </details>
    </CardFrame>
  );
}
