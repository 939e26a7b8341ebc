/** The lamps that were pointed at, folded: each can be pointed at once more, from either place. */

import type { HomeLamp, HomeSetup } from "../../messages";
import { Button } from "../../ui/elements";
import type { SetupSession } from "../session";
import { lampText, placeName } from "../setup_words";

interface LampRowsProps {
  session: SetupSession;
  setup: HomeSetup;
  summary: string;
}

export function LampRows({ session, setup, summary }: LampRowsProps) {
  const pressed = setup.lamps.filter(({ places, reason }) => places > 0 || reason);
  if (pressed.length === 0) return null;
  return (
    <details class="setup-rows">
      <summary>{summary}</summary>
      <ul>
        {pressed.map((lamp) => (
          <LampRow key={lamp.id} session={session} setup={setup} lamp={lamp} />
        ))}
      </ul>
    </details>
  );
}

interface LampRowProps {
  session: SetupSession;
  setup: HomeSetup;
  lamp: HomeLamp;
}

/** One lamp, with what is known of it, and a button for each place. */
export function LampRow({ session, setup, lamp }: LampRowProps) {
  return (
    <li>
      <span>{lampText(lamp)}</span>
      <span class="pairs">
        {setup.may_repeat.map((place) => (
          <Button
            name={setup.may_repeat.length > 1 ? `Again from the ${placeName(place)}` : "Again"}
            key={place}
            kind="quiet"
            onClick={() => void session.act({ choice: "repeat", lamps: [lamp.id], place })}
          />
        ))}
      </span>
    </li>
  );
}
