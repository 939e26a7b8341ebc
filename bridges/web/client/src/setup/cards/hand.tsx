/** What do you point with? A phone, a wristband, or the mouse. */

import { useState } from "preact/hooks";
import { byName } from "../../format";
import type { HomeSetup } from "../../messages";
import { Button } from "../../ui/elements";
import { handText, LEAD } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";

const HANDS: readonly (readonly [HomeSetup["hand"], string])[] = [
  ["phone", "A phone"],
  ["wrist", "A wristband or tracker"],
  ["mouse", "The mouse, only to try it out"],
];

export function HandCard(props: CardProps) {
  const { session, setup } = props;
  const { controls } = session;
  const [hand, setHand] = useState<HomeSetup["hand"]>(setup.hand || "phone");
  const [chosen, setChosen] = useState(setup.user);
  const users = [...controls.site.people.keys()].sort(byName);
  const user = users.includes(chosen) ? chosen : (users[0] ?? "");
  const line = controls.site.people.get(user)?.line ?? null;
  // The phone is paired first, and then it goes on
  const isWaiting = hand === "phone" && line?.moved_by !== "phone";

  function pair(): void {
    controls.choose(user);
    props.pairing.open();
  }

  return (
    <CardFrame
      {...props}
      buttons={
        <>
          <Button
            name="Pair a phone"
            hidden={hand !== "phone"}
            kind={isWaiting ? "primary" : ""}
            onClick={pair}
          />
          <Button name="Look for wristbands" hidden={hand !== "wrist"} onClick={props.openDevices} />
          <Button
            name="Next"
            kind={isWaiting ? "" : "primary"}
            onClick={() => void session.act({ act: "hand", hand, user })}
          />
        </>
      }
    >
      <div role="radiogroup" aria-labelledby="setup-title">
        {HANDS.map(([value, name]) => (
          <label key={value}>
            <input
              type="radio"
              name="hand"
              value={value}
              checked={value === hand}
              onChange={() => setHand(value)}
            />
            <span>{name}</span>
          </label>
        ))}
      </div>
      <label class="field" hidden={users.length < 2}>
        <span>Person</span>
        <select value={user} onChange={({ currentTarget }) => setChosen(currentTarget.value)}>
          {users.map((each) => (
            <option key={each} value={each}>
              {each}
            </option>
          ))}
        </select>
      </label>
      <Status id={LEAD}>{handText(hand, line)}</Status>
    </CardFrame>
  );
}
