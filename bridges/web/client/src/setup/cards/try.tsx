/** Try it: what each lamp's direction is known to, and where one stands. */

import { capital } from "../../format";
import { Button } from "../../ui/elements";
import { lampText, LEAD, placeName, tryText } from "../setup_words";
import { CardFrame, type CardProps } from "./card";

export function TryCard(props: CardProps) {
  const { session, setup } = props;
  const { hand, lamps, advice, places_m: places } = setup;
  return (
    <CardFrame
      {...props}
      buttons={
        <>
          {hand !== "mouse" && (
            <Button
              name="Find my direction again"
              kind="quiet"
              onClick={() => void session.act({ act: "align" })}
            />
          )}
          <Button name="Done" kind="primary" onClick={props.finish} />
        </>
      }
    >
      <p class="setup-turn" id={LEAD}>
        {tryText(hand)}
      </p>
      <ul>
        {lamps.map((lamp) => (
          <li key={lamp.id}>{lampText(lamp)}</li>
        ))}
      </ul>
      <ul class="muted">
        {advice.map((sentence) => (
          <li>{capital(sentence)}</li>
        ))}
      </ul>
      <div class="pairs">
        {places.length > 1 &&
          (["A", "B"] as const).map((place) => (
            <Button
              name={`I stand at the ${placeName(place)}`}
              key={place}
              onClick={() => void session.act({ act: "stand", place })}
            />
          ))}
      </div>
    </CardFrame>
  );
}
