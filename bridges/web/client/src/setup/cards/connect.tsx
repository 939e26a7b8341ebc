/** Where are your lamps? The address of a Home Assistant or a broker, and what lets PointIt in. */

import { useEffect, useRef, useState } from "preact/hooks";
import { Button } from "../../ui/elements";
import { BROKER, isBroker, LEAD, profileOf, searchText, USUAL_URL } from "../setup_words";
import { CardFrame, Status, type CardProps } from "./card";

const FORM = "setup-form";
const HOW = "Make a token in your profile there, under Security";

export function ConnectCard(props: CardProps) {
  const { session, setup } = props;
  const [url, setUrl] = useState(setup.url || USUAL_URL);
  const [token, setToken] = useState("");
  const urlField = useRef<HTMLInputElement>(null);
  const tokenField = useRef<HTMLInputElement>(null);
  const hasBroker = isBroker(url);
  const profile = profileOf(url);
  const isWaiting = setup.url !== "" && !setup.is_connected && !setup.problem;
  useEffect(() => void session.search(), []);

  async function connect(): Promise<void> {
    const secret = hasBroker ? token : token.trim();
    if (!secret && !hasBroker && !setup.has_token)
      return session.refuse("paste the token first: it lets PointIt switch your lamps");
    const isDone = await session.act({ act: "connect", url, ...(secret ? { token: secret } : {}) });
    if (isDone) setToken("");
  }

  return (
    <CardFrame
      {...props}
      buttons={
        <>
          <Button
            name="Look again"
            kind="quiet"
            isOff={session.isSearching}
            onClick={() => void session.search()}
          />
          <Button
            name="There is no Home Assistant"
            kind="quiet"
            onClick={() => void session.act({ act: "without" })}
          />
          <Button
            name="Lamps on an MQTT broker"
            kind="quiet"
            onClick={() => {
              setUrl(BROKER);
              urlField.current!.focus();
            }}
          />
          <button type="submit" class="primary" form={FORM}>
            Connect
          </button>
        </>
      }
    >
      <Status class="muted" id={LEAD}>
        {searchText(session.isSearching, session.homes.length)}
      </Status>
      <fieldset class="pairs" aria-labelledby={LEAD} hidden={session.homes.length === 0}>
        {session.homes.map((home) => (
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
        <label class="field">
          <span>{hasBroker ? "Address of the broker" : "Address of Home Assistant"}</span>
          <input
            type="text"
            inputmode="url"
            spellcheck={false}
            autocomplete="off"
            ref={urlField}
            value={url}
            onInput={({ currentTarget }) => setUrl(currentTarget.value)}
          />
        </label>
        <label class="field">
          <span>{hasBroker ? "Password, if the address has a user" : "Access token"}</span>
          <input
            type="password"
            autocomplete="off"
            spellcheck={false}
            ref={tokenField}
            value={token}
            onInput={({ currentTarget }) => setToken(currentTarget.value)}
          />
        </label>
        {!hasBroker && (
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
      <Status>{isWaiting ? `Connecting to ${setup.url} …` : ""}</Status>
    </CardFrame>
  );
}
