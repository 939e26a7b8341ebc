/** The home: its lamps by room, who points and how to begin. All else of the page is under *Advanced*. */

import type { HomeLamp } from "../messages";
import { Button, Icon } from "../ui/elements";
import { roomsOf, type HomeThing, type HomeTile } from "./home_rooms";
import { KIND_ICONS } from "./kind_icons";

/** Who points, in words, and what to do next. */
export interface HomePointing {
  title: string;
  next: string;
}

interface HomeViewProps {
  lamps: readonly HomeLamp[];
  things: readonly HomeThing[];
  pointing: HomePointing;
  /** Names of lamps that have come since the last choice. */
  added: readonly string[];
  switchThing(id: string): void;
  pair(): void;
  placeAgain(): void;
  addLamps(): void;
  showAdvanced(): void;
}

export function HomeView(props: HomeViewProps) {
  const { pointing, added } = props;
  const rooms = roomsOf(props.things, props.lamps);
  return (
    <>
      <header>
        <h2 tabindex={-1} id="home-title">
          Home
        </h2>
        <Button name="Advanced" kind="quiet" icon="sliders" onClick={props.showAdvanced} />
      </header>
      <section class="home-pointing" aria-label="How to point">
        <Icon name="point" />
        <div>
          <strong>{pointing.title}</strong>
          <p>{pointing.next}</p>
        </div>
        <Button name="Point with a phone" kind="primary" icon="phone" onClick={props.pair} />
      </section>
      {added.length > 0 && <p class="muted">New lamps: {added.join(", ")}.</p>}
      <div class="home-rooms">
        {rooms.map(([room, tiles]) => (
          <section key={room} aria-label={room || "Elsewhere"}>
            <h3>{room || (rooms.length > 1 ? "Elsewhere" : "Lamps")}</h3>
            <ul>
              {tiles.map((tile) => (
                <Tile key={tile.id} tile={tile} switchThing={props.switchThing} />
              ))}
            </ul>
          </section>
        ))}
      </div>
      <div class="home-actions">
        <Button name="Place again" icon="place" onClick={props.placeAgain} />
        <Button name="Add lamps" icon="plus" onClick={props.addLamps} />
      </div>
    </>
  );
}

interface TileProps {
  tile: HomeTile;
  switchThing(id: string): void;
}

/** One lamp on one line: what it is, its name, its state, a switch. */
function Tile({ tile, switchThing }: TileProps) {
  const { id, name, isOn, kind, quality, canBeTried, state } = tile;
  return (
    <li data-on={isOn ? "" : undefined}>
      <span class="home-icon">
        <Icon name={KIND_ICONS[kind]} />
      </span>
      <span class="home-name">{name}</span>
      <span class="muted">{quality === "again" ? "place it again" : state}</span>
      <button
        type="button"
        class="home-switch"
        role="switch"
        aria-checked={isOn}
        aria-label={name}
        aria-disabled={canBeTried ? undefined : "true"}
        onClick={() => {
          if (canBeTried) switchThing(id);
        }}
      />
    </li>
  );
}
