import assert from "node:assert/strict";
import { test } from "node:test";
import { renderToString } from "preact-render-to-string";

import { ListView } from "./list";

test("what is read out of a row is what is seen, also when its name has become another one", () => {
  const drawn = (name: string): string => {
    const objects = [{ key: "a-1", name, text: "at bay 1" }];
    const rows = { people: [], robots: [], objects, lamps: [] };
    return renderToString(<ListView rows={rows} isOpen canPoint followed="" follow={() => {}} />);
  };
  for (const name of ["red object 1", "red object a-1"]) {
    assert.match(drawn(name), new RegExp(`<strong>${name}</strong>.*aria-label="Point at ${name}"`));
  }
});
