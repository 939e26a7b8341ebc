import assert from "node:assert/strict";
import { test } from "node:test";

import { connectionState } from "./header";
import { lostSentence } from "./notices";

const LIVE = {
  isOver: false,
  isLoading: false,
  isConnected: true,
  isCutOff: false,
  hasWarnings: false,
  isPast: false,
};

test("the most important state of the connection is shown", () => {
  const text = (changes: object): string => connectionState({ ...LIVE, ...changes }).text;
  const look = (changes: object): string => connectionState({ ...LIVE, ...changes }).state;

  assert.deepEqual([text({}), look({})], ["Live", "live"]);
  assert.deepEqual([text({ hasWarnings: true }), look({ hasWarnings: true })], ["Live", "warning"]);
  assert.deepEqual([text({ isPast: true }), look({ isPast: true, hasWarnings: true })], ["Past", "warning"]);
  assert.deepEqual([text({ isCutOff: true }), look({ isCutOff: true })], ["Cut off", "lost"]);
  assert.equal(text({ isConnected: false, hasWarnings: true }), "Lost");
  assert.equal(text({ isLoading: true, isConnected: false }), "Connecting");
  assert.equal(text({ isOver: true, isConnected: false }), "Ended");
});

test("a lost connection is told by its reason once it lasts", () => {
  const lost = { isRefused: false, wasConnected: true, attempts: 1, reason: "" };
  assert.match(lostSentence(lost), /^The connection is lost/);
  assert.equal(lostSentence({ ...lost, attempts: 7, reason: "The server is full." }), "The server is full.");
  assert.equal(lostSentence({ ...lost, wasConnected: false }), "Connecting …");
  assert.match(lostSentence({ ...lost, wasConnected: false, attempts: 4 }), /does not answer/);
  assert.match(lostSentence({ ...lost, isRefused: true }), /was restarted/);
});
