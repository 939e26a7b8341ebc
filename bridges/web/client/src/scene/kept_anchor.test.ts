import assert from "node:assert/strict";
import { test } from "node:test";
import { keepAnchor, keptAnchor } from "./kept_anchor";

const stored = new Map<string, string>();
const storage = {
  getItem: (key: string) => stored.get(key) ?? null,
  setItem: (key: string, text: string) => void stored.set(key, text),
  removeItem: (key: string) => void stored.delete(key),
};

test("an anchor is kept until it is removed, and what is no anchor counts as none", () => {
  Object.assign(globalThis, { localStorage: storage });
  const anchor = { map: "shelf", handle: "a-handle", at: [1, 2, 0.5], yaw: 0.3 } as const;
  assert.equal(keptAnchor(), null);
  keepAnchor({ ...anchor, at: [1, 2, 0.5] });
  assert.deepEqual(keptAnchor(), anchor);
  for (const other of [
    "",
    "{",
    "null",
    "[]",
    "7",
    { ...anchor, handle: "" },
    { ...anchor, at: [1, 2] },
    { ...anchor, at: [1, "2", 3] },
    { ...anchor, yaw: null },
    { ...anchor, map: 3 },
  ]) {
    stored.set("pointit-anchor", typeof other === "string" ? other : JSON.stringify(other));
    assert.equal(keptAnchor(), null, JSON.stringify(other));
  }
  keepAnchor(null);
  assert.equal(stored.size, 0);
});

test("where storage is forbidden nothing is kept, and nothing fails", () => {
  const forbidden = (): never => {
    throw new DOMException("forbidden", "SecurityError");
  };
  Object.assign(globalThis, {
    localStorage: { getItem: forbidden, setItem: forbidden, removeItem: forbidden },
  });
  keepAnchor({ map: "shelf", handle: "a", at: [0, 0, 0], yaw: 0 });
  assert.equal(keptAnchor(), null);
});
