/** Which lamps do you want to point at? Lamps by area, other things folded below, and lights of the network. */

import { useState } from "preact/hooks";
import { capital } from "../../format";
import type { HomeLamp } from "../../messages";
import { Button, Icon } from "../../ui/elements";
import { useOwnId } from "../../ui/ids";
import { stripName, type SetupSession } from "../session";
import { KIND_ICONS } from "../kind_icons";
import { byArea, isBroker, isFound, isLamp, LEAD, lightsText, stateText } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";

/** Number of things from which there is a search. */
const MANY = 12;

export function ChooseCard(props: CardProps) {
  const { session, setup } = props;
  const { lamps, url } = setup;
  /** What was ticked here, by lamp; the others are as they are kept. */
  const [ticks, setTicks] = useState<ReadonlyMap<string, boolean>>(new Map());
  const [hasLooked, setLooked] = useState(false);
  const [search, setSearch] = useState("");
  const isTicked = (lamp: HomeLamp): boolean => ticks.get(lamp.id) ?? lamp.is_chosen;
  const tick = (own: readonly HomeLamp[], isOn: boolean): void =>
    setTicks(new Map([...ticks, ...own.map(({ id }) => [id, isOn] as const)]));
  const shown = lamps.filter((lamp) => isFound(lamp, search));
  const others = shown.filter((lamp) => !isLamp(lamp));
  const isWaiting = url !== "" && !setup.is_connected;
  const nothing = isWaiting ? "Waiting for your lamps …" : "No lamps are found yet.";
  const offered = session.lights.filter(({ plugin }) => plugin !== "mqtt" || !isBroker(url));
  const free = offered.filter(({ label }) => !lamps.some((lamp) => lamp.label === stripName(label)));
  const areaProps = { session, isTicked, tick };

  function look(): void {
    setLooked(true);
    void session.search();
  }

  function choose(): void {
    const chosen = byArea(lamps)
      .flatMap(([, own]) => own)
      .filter(isTicked);
    void session.act({ act: "choose", lamps: chosen.map(({ id }) => id) });
  }

  return (
    <CardFrame
      {...props}
      buttons={
        <>
          <Button
            name="Look for lights in the network"
            kind="quiet"
            isOff={session.isSearching}
            onClick={look}
          />
          <Button name="Next" kind="primary" onClick={choose} />
        </>
      }
    >
      <p class="muted" id={LEAD}>
        Rest on a row, and its lamp shows which one it is.
      </p>
      <div class="setup-body">
        {lamps.length > MANY && (
          <label class="field">
            <span>Search</span>
            <input
              type="search"
              value={search}
              autocomplete="off"
              onInput={({ currentTarget }) => setSearch(currentTarget.value)}
            />
          </label>
        )}
        <Areas {...areaProps} lamps={shown.filter(isLamp)} />
        {others.length > 0 && (
          <details class="setup-rows" open={search !== "" || others.some(isTicked)}>
            <summary>Other things ({others.length})</summary>
            <p class="muted">What can do harm, such as a garage door or a lock, wants a press as well.</p>
            <Areas {...areaProps} lamps={others} />
          </details>
        )}
      </div>
      <Status>{lamps.length ? "" : nothing}</Status>
      <Status class="muted">{hasLooked ? lightsText(session.isSearching, free.length) : ""}</Status>
      <ul class="muted">
        {setup.advice.map((sentence) => (
          <li key={sentence}>{capital(sentence)}</li>
        ))}
      </ul>
      <div class="pairs">
        {free.map((light) => (
          <Button
            name={`Connect ${light.label}`}
            key={light.address}
            onClick={() => void session.connectLight(light)}
          />
        ))}
      </div>
    </CardFrame>
  );
}

interface AreasProps {
  session: SetupSession;
  lamps: readonly HomeLamp[];
  isTicked(lamp: HomeLamp): boolean;
  tick(lamps: readonly HomeLamp[], isOn: boolean): void;
}

/** Lamps by area. A whole area is ticked at once. */
function Areas({ session, lamps, isTicked, tick }: AreasProps) {
  return (
    <>
      {byArea(lamps).map(([area, own]) => {
        const name = area || "Elsewhere";
        const isWhole = own.every(isTicked);
        return (
          <fieldset key={area}>
            <legend>{name}</legend>
            {own.length > 1 && (
              <Button
                name={isWhole ? `None of ${name}` : `All of ${name}`}
                kind="quiet"
                class="setup-all"
                onClick={() => tick(own, !isWhole)}
              />
            )}
            {own.map((lamp) => (
              <LampRow
                key={lamp.id}
                session={session}
                lamp={lamp}
                isTicked={isTicked(lamp)}
                onTick={(isOn) => tick([lamp], isOn)}
              />
            ))}
          </fieldset>
        );
      })}
    </>
  );
}

interface LampRowProps {
  session: SetupSession;
  lamp: HomeLamp;
  isTicked: boolean;
  onTick(isOn: boolean): void;
}

function LampRow({ session, lamp, isTicked, onTick }: LampRowProps) {
  const id = useOwnId("setup-lamp");
  const show = (): void => session.showLamp(lamp.id);
  return (
    <label onPointerEnter={show}>
      <input
        type="checkbox"
        checked={isTicked}
        aria-labelledby={`${id}-name`}
        aria-describedby={`${id}-state`}
        onFocus={show}
        onChange={({ currentTarget }) => onTick(currentTarget.checked)}
      />
      <Icon name={KIND_ICONS[lamp.kind]} />
      <span id={`${id}-name`}>{`${lamp.label || lamp.id}${lamp.is_new ? " (new)" : ""}`}</span>
      <span class="muted" id={`${id}-state`}>
        {stateText(lamp.state)}
      </span>
    </label>
  );
}
