/** Which lamps do you want to point at? Those of Home Assistant, by area, and lights of the network. */

import { useState } from "preact/hooks";
import { capital } from "../../format";
import type { HomeLamp } from "../../messages";
import { Button } from "../../ui/elements";
import { useOwnId } from "../../ui/ids";
import { stripName, type SetupSession } from "../session";
import { byArea, isBroker, LEAD, lightsText, stateText } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";

export function ChooseCard(props: CardProps) {
  const { session, setup } = props;
  const { lamps, url } = setup;
  /** What was ticked here, by lamp; the others are as they are kept. */
  const [ticks, setTicks] = useState<ReadonlyMap<string, boolean>>(new Map());
  const [hasLooked, setLooked] = useState(false);
  const areas = byArea(lamps);
  const isTicked = (lamp: HomeLamp): boolean => ticks.get(lamp.id) ?? lamp.is_chosen;
  const isWaiting = url !== "" && !setup.is_connected;
  const nothing = isWaiting ? "Waiting for your lamps …" : "No lamps are found yet.";
  const offered = session.lights.filter(({ plugin }) => plugin !== "mqtt" || !isBroker(url));
  const free = offered.filter(({ label }) => !lamps.some((lamp) => lamp.label === stripName(label)));

  function look(): void {
    setLooked(true);
    void session.search();
  }

  function choose(): void {
    const chosen = areas.flatMap(([, own]) => own).filter(isTicked);
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
        {areas.map(([area, own]) => (
          <fieldset key={area}>
            <legend>{area || "Elsewhere"}</legend>
            {own.map((lamp) => (
              <LampRow
                key={lamp.id}
                session={session}
                lamp={lamp}
                isTicked={isTicked(lamp)}
                onTick={(isOn) => setTicks(new Map(ticks).set(lamp.id, isOn))}
              />
            ))}
          </fieldset>
        ))}
      </div>
      <Status>{lamps.length ? "" : nothing}</Status>
      <Status class="muted">{hasLooked ? lightsText(session.isSearching, free.length) : ""}</Status>
      <ul class="muted">
        {setup.advice.map((sentence) => (
          <li>{capital(sentence)}</li>
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
      <span id={`${id}-name`}>{`${lamp.label || lamp.id}${lamp.is_new ? " (new)" : ""}`}</span>
      <span class="muted" id={`${id}-state`}>
        {stateText(lamp.state)}
      </span>
    </label>
  );
}
