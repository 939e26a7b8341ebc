/** Where are your lamps? A Home Assistant, an MQTT broker, or lights of the network alone. */

import { useEffect, useRef, useState } from "preact/hooks";
import { Button } from "../../ui/elements";
import { Choice } from "../../ui/choice";
import {
  addressOf,
  homeKindOf,
  HOME_KINDS,
  isBroker,
  LEAD,
  profileOf,
  searchText,
  USUAL_URL,
  type HomeServer,
} from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";

const FORM = "setup-form";
const HOW = "Make a token in your profile there, under Security";
const FIELDS = {
  home: { address: "Address of Home Assistant", secret: "Access token", usual: USUAL_URL },
  broker: { address: "Address of the broker", secret: "Password, if the address has a user", usual: "" },
};

export function ConnectCard(props: CardProps) {
  const { session, setup } = props;
  const [kind, setKind] = useState<HomeServer>(isBroker(setup.url) ? "broker" : "home");
  const [url, setUrl] = useState(setup.url || USUAL_URL);
  const [token, setToken] = useState("");
  const urlField = useRef<HTMLInputElement>(null);
  const tokenField = useRef<HTMLInputElement>(null);
  const profile = profileOf(url);
  const isWaiting = setup.url !== "" && !setup.is_connected && !setup.problem;
  const homes = session.homes.filter((home) => isBroker(home.url) === (kind === "broker"));
  useEffect(() => void session.search(), []);

  function choose(chosen: HomeServer): void {
    setKind(chosen);
    if (chosen !== "none")
      setUrl(isBroker(setup.url) === (chosen === "broker") ? setup.url : FIELDS[chosen].usual);
  }

  /** The address as typed. That of a broker shows the fields of one, and none loses what was chosen. */
  function type(typed: string): void {
    setUrl(typed);
    if (kind !== "none" && homeKindOf(typed) === "broker") setKind("broker");
  }

  async function connect(): Promise<void> {
    if (kind === "none") return void (await session.act({ act: "without" }));
    const hasBroker = kind === "broker";
    const secret = hasBroker ? token : token.trim();
    if (!secret && !hasBroker && !setup.has_token)
      return session.refuse("paste the token first: it lets PointIt switch your lamps");
    // What was typed stays in its field until it is accepted: then the card goes on
    const address = addressOf(url, kind);
    await session.act({ act: "connect", url: address, ...(secret ? { token: secret } : {}) });
    tokenField.current?.select(); // another one that is typed replaces it
  }

  return (
    <CardFrame
      {...props}
      buttons={
        <button type="submit" class="primary" form={FORM}>
          {kind === "none" ? "Next" : "Connect"}
        </button>
      }
    >
      <Choice
        legend="Where are your lamps?"
        isBare
        options={HOME_KINDS}
        value={kind}
        onChoose={(chosen) => {
          choose(chosen as HomeServer);
          if (chosen === "broker") setTimeout(() => urlField.current?.focus());
        }}
      />
      <div class="setup-search" hidden={kind === "none"}>
        <Status class="muted" id={LEAD}>
          {searchText(session.isSearching, homes.length, kind)}
        </Status>
        <Button
          name="Look again"
          kind="quiet"
          isOff={session.isSearching}
          onClick={() => void session.search()}
        />
      </div>
      <fieldset class="pairs" aria-labelledby={LEAD} hidden={homes.length === 0 || kind === "none"}>
        {homes.map((home) => (
          <Button
            name={home.label}
            key={home.url}
            onClick={() => {
              setUrl(home.url);
              tokenField.current!.focus();
            }}
          />
        ))}
      </fieldset>
      <form
        class="setup-body"
        id={FORM}
        onSubmit={(event) => {
          event.preventDefault();
          void connect();
        }}
      >
        {kind === "none" ? (
          <p>Strips and lamps of this map are used, and lights that the next card finds in your network.</p>
        ) : (
          <>
            <label class="field">
              <span>{FIELDS[kind].address}</span>
              <input
                type="text"
                inputmode="url"
                spellcheck={false}
                autocomplete="off"
                placeholder={kind === "broker" ? "mqtt://homeassistant.local" : USUAL_URL}
                ref={urlField}
                value={url}
                onInput={({ currentTarget }) => type(currentTarget.value)}
              />
            </label>
            <label class="field">
              <span>{FIELDS[kind].secret}</span>
              <input
                type="password"
                autocomplete="off"
                spellcheck={false}
                ref={tokenField}
                value={token}
                onInput={({ currentTarget }) => setToken(currentTarget.value)}
              />
            </label>
          </>
        )}
        {kind === "home" && (
          <p class="muted">
            {profile ? (
              <a href={profile} target="_blank" rel="noreferrer">
                {HOW}
              </a>
            ) : (
              HOW
            )}
            . It stays on this computer, in a file that only you can read.
          </p>
        )}
      </form>
      <Status>{isWaiting && kind !== "none" ? `Connecting to ${setup.url} …` : ""}</Status>
    </CardFrame>
  );
}
