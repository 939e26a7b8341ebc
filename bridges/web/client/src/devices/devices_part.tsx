/** Devices: those connected, and those within reach of the page's machine, to connect. */

import { useState } from "preact/hooks";
import type { Controls } from "../controls";
import { capital } from "../format";
import { Button, Icon } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";
import type { DeviceLine } from "../wire";
import { DeviceSession } from "./device_session";
import { command, freeNameFor, freeStrips, newStripName, wristFigures, type FoundDevice } from "./found";
import { Wearing } from "./wearing";

/** Id of the button that searches. */
export const LOOK_ID = "look-for-devices";
/** Value of the strip that is yet to be made. */
const NEW_STRIP = "";
const MAX_NAME_CHARACTERS = 64;

export function devicesPart(controls: Controls): PanelPart {
  const session = new DeviceSession(controls);
  const wearing = new Wearing(controls);
  return {
    ...titledPart(
      "Devices",
      () => controls.mayDo("find_devices"),
      () => <Devices session={session} fit={(line) => wearing.open(line)} />,
    ),
    follow() {
      const arrived = session.arrived();
      if (arrived) wearing.open(arrived);
      else wearing.update();
    },
  };
}

interface DevicesProps {
  session: DeviceSession;
  /** Show how a wrist is worn. */
  fit(line: DeviceLine): void;
}

export function Devices({ session, fit }: DevicesProps) {
  const { free, homes, problems, progress, status } = session;
  const isSearching = progress !== null;
  return (
    <>
      <ul class="devices">
        {session.lines.map((line) => (
          <ConnectedDevice key={line.id} session={session} line={line} fit={fit} />
        ))}
      </ul>
      <Button
        name="Look for devices"
        icon="watch"
        id={LOOK_ID}
        isOff={isSearching}
        onClick={() => void session.search()}
      />
      {isSearching && <progress max={1} value={progress} aria-label="Search for devices" />}
      <p class="muted" role="status">
        {status}
      </p>
      <ul class="devices">
        {free.map((device) => (
          <FreeDevice key={`${device.plugin} ${device.address}`} session={session} device={device} />
        ))}
        {homes.map((home) => (
          <li key={home.command}>
            <strong>{home.label}</strong>
            <p class="muted">Home Assistant</p>
            <code>{home.command}</code>
          </li>
        ))}
      </ul>
      {problems.length > 0 && (
        <details open={free.length + homes.length === 0}>
          <summary>
            Not searched
            <Icon name="chevron" />
          </summary>
          <ul class="muted devices">
            {problems.map((problem) => (
              <li key={problem}>{problem}</li>
            ))}
          </ul>
        </details>
      )}
    </>
  );
}

interface ConnectedProps extends DevicesProps {
  line: DeviceLine;
}

function ConnectedDevice({ session, line, fit }: ConnectedProps) {
  const { controls } = session;
  return (
    <li>
      <strong>{line.kind === "wrist" ? line.name : `Strip ${line.name}`}</strong>
      <p class="muted">{`${line.label} · ${line.plugin}`}</p>
      <p class={line.problem ? "reason" : "muted"}>{capital(stateOf(controls, line))}</p>
      {controls.mayDo("forget_device") && (
        <div class="pairs">
          <DeviceAction session={session} line={line} fit={fit} />
          <Button
            name="Forget"
            label={`Forget ${line.label}`}
            onClick={() => void controls.askAloud({ deed: "forget_device", query: { id: line.id } })}
          />
        </div>
      )}
    </li>
  );
}

/** What can be done with a connected device: connect it again, fit a wrist, or test a light. */
function DeviceAction({ session, line, fit }: ConnectedProps) {
  if (line.problem && !line.is_on)
    return (
      <Button
        name="Again"
        label={`Connect ${line.name} again`}
        isOff={session.isConnecting(line)}
        onClick={() => void session.connect(line, line.name)}
      />
    );
  if (line.kind === "wrist")
    return (
      <Button
        name="Fit"
        label={`Fit: how ${line.name} wears it`}
        isOff={!line.is_on}
        onClick={() => fit(line)}
      />
    );
  return (
    <Button
      name="Test"
      label={`Test pattern on strip ${line.name}`}
      isOff={!line.is_on}
      onClick={() => void session.controls.askAloud({ deed: "show_device", query: { id: line.id } })}
    />
  );
}

function stateOf({ site }: Controls, line: DeviceLine): string {
  if (line.problem) return line.problem;
  if (!line.is_on) return "connecting …";
  const figures = line.kind === "wrist" ? wristFigures(site.health.get(`imu-bridge.${line.name}`)) : "";
  return figures || "connected";
}

interface FreeProps {
  session: DeviceSession;
  device: FoundDevice;
}

function FreeDevice({ session, device }: FreeProps) {
  return (
    <li>
      <strong>{device.label}</strong>
      <p class="muted">{device.plugin}</p>
      {session.canConnect ? (
        <ConnectForm session={session} device={device} />
      ) : (
        <code>{command(device)}</code>
      )}
    </li>
  );
}

/** A name for who wears a wrist, or the strip that a light shows, and the button that connects it. */
function ConnectForm({ session, device }: FreeProps) {
  const { map, people } = session.controls.site;
  const strips = map?.strips ?? [];
  /** Name that was typed or chosen here; null: the one that is proposed. */
  const [chosen, setChosen] = useState<string | null>(null);
  const isWrist = device.kind === "wrist";
  const free = freeStrips(strips, session.lines);
  const wrists = session.free.filter(({ kind }) => kind === "wrist");
  // The person of a wrist that was just connected may not have come yet
  const taken = [...people.keys(), ...session.lines.map(({ name }) => name)];
  const proposed = isWrist ? freeNameFor(device, wrists, taken) : (free[0]?.id ?? NEW_STRIP);
  const value = chosen ?? proposed;

  function connect(event: Event): void {
    event.preventDefault();
    const name = value || newStripName(device, strips);
    void session.connect(device, name);
  }

  return (
    <form onSubmit={connect}>
      <label>
        <span class="muted">{isWrist ? "Who wears it" : "Shows strip"}</span>
        {isWrist ? (
          <input
            type="text"
            value={value}
            maxlength={MAX_NAME_CHARACTERS}
            required
            autocomplete="off"
            spellcheck={false}
            onInput={({ currentTarget }) => setChosen(currentTarget.value)}
          />
        ) : (
          <select value={value} onChange={({ currentTarget }) => setChosen(currentTarget.value)}>
            {free.map(({ id, pixels }) => (
              <option key={id} value={id}>{`${id} (${pixels})`}</option>
            ))}
            <option value={NEW_STRIP}>A new strip in the map</option>
          </select>
        )}
      </label>
      <button type="submit" aria-disabled={session.isConnecting(device) ? "true" : undefined}>
        <Icon name="plus" />
        <span>Connect</span>
      </button>
    </form>
  );
}
