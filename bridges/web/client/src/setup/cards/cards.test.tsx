import assert from "node:assert/strict";
import { test } from "node:test";
import { renderToString } from "preact-render-to-string";

import { emptyPerson, emptySite } from "../../site/site";
import type { CardProps } from "./card";
import { ChooseCard } from "./choose";
import { HandCard } from "./hand";

const LAMP = {
  id: "light.desk",
  label: "Desk",
  area: "Office",
  state: "off",
  is_chosen: false,
  is_new: true,
};

/** What a card needs of its session and of the home. */
function props(changes: object): CardProps {
  const site = emptySite();
  for (const user of ["anna", "bob"]) site.people.set(user, emptyPerson(user));
  const setup = {
    step: "choose",
    url: "",
    is_connected: true,
    lamps: [LAMP],
    advice: [],
    user: "anna",
    hand: "phone",
  };
  const session = { controls: { site }, homes: [], lights: [], isSearching: false, problem: "" };
  const none = (): void => {};
  return {
    session,
    setup: { ...setup, ...changes },
    pairing: { open: none },
    later: none,
    openDevices: none,
    finish: none,
  } as never;
}

test("a lamp that is no longer new is no longer called so", () => {
  assert.match(renderToString(<ChooseCard {...props({})} />), />Desk \(new\)</);
  const known = props({ lamps: [{ ...LAMP, is_new: false }] });
  assert.match(renderToString(<ChooseCard {...known} />), />Desk</);
});

test("who points is the person that the home has kept, or the first", () => {
  const selected = (page: string): string | undefined => /<option[^>]*selected[^>]*>(\w+)/.exec(page)?.[1];
  assert.equal(selected(renderToString(<HandCard {...props({ step: "hand", user: "bob" })} />)), "bob");
  assert.equal(selected(renderToString(<HandCard {...props({ step: "hand", user: "gone" })} />)), "anna");
});
