// What one component tells another is a field: the client reads no meaning of a sentence of ours.
// The same rule for Python: tests/architecture/test_sentences.py.
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import ts from "typescript";

const SOURCE = join(dirname(fileURLToPath(import.meta.url)), "src");
/** Fields and variables that are sentences for people. */
const SENTENCES = new Set([
  "error",
  "message",
  "next_step",
  "problem",
  "reason",
  "remedy",
  "said",
  "sentence",
]);
/** Methods of a text, or of a pattern, that read a part of it. */
const TEXT_USES = new Set([
  "endsWith",
  "exec",
  "includes",
  "indexOf",
  "match",
  "matchAll",
  "replace",
  "replaceAll",
  "search",
  "split",
  "startsWith",
  "test",
]);
/** Two words: the pattern reads prose. */
const WORDS = /[A-Za-z]{2,} \(?[A-Za-z]{2,}/;

/** What stands in the sources and reads no sentence of ours, with the reason. */
const ALLOWED = new Map([
  ["/^ANGLE Metal Renderer: /", "the browser's name of its renderer"],
  ["/SwiftShader|llvmpipe|softpipe|Software|Basic Render/i", "the browser's name of its renderer"],
]);

/** Whether a file is a source of the page, not a test. */
function isSource(file) {
  return /\.tsx?$/.test(file) && !/\.test\.tsx?$/.test(file);
}

/** Whether the expression is a sentence by its name. */
function isSentence(node) {
  if (ts.isPropertyAccessExpression(node)) return SENTENCES.has(node.name.text);
  return ts.isIdentifier(node) && SENTENCES.has(node.text);
}

/** The source of every expression that reads the meaning of a sentence. */
function readsIn(file, text) {
  const found = [];
  const visit = (node) => {
    if (ts.isRegularExpressionLiteral(node) && WORDS.test(node.text)) found.push(node.getText());
    if (
      ts.isCallExpression(node) &&
      ts.isPropertyAccessExpression(node.expression) &&
      TEXT_USES.has(node.expression.name.text)
    ) {
      if ([node.expression.expression, ...node.arguments].some(isSentence)) found.push(node.getText());
    }
    ts.forEachChild(node, visit);
  };
  visit(ts.createSourceFile(file, text, ts.ScriptTarget.Latest, true));
  return found;
}

test("no code reads a sentence that a field should tell", () => {
  const files = readdirSync(SOURCE, { recursive: true }).filter(isSource);
  assert.ok(files.length > 100);
  const found = files.flatMap((file) =>
    readsIn(file, readFileSync(join(SOURCE, file), "utf8")).map((source) => [source, file]),
  );
  assert.deepEqual(
    found.filter(([source]) => !ALLOWED.has(source)),
    [],
    "give the message a field, and read that",
  );
  assert.deepEqual(
    [...ALLOWED.keys()].filter((source) => !found.some(([each]) => each === source)),
    [],
    "these are gone: remove them from ALLOWED",
  );
});

test("the rule finds each form of reading", () => {
  for (const source of [
    "/button to confirm\\b/.test(text)",
    "/load it again/.test(error.message)",
    "reason.replaceAll(id, '')",
    "why.reason.startsWith(what)",
    "sentence.split(' ')",
  ]) {
    assert.equal(readsIn("a.ts", source).length > 0, true, source);
  }
  for (const source of ["/^-?\\d+$/.test(number)", "names.includes(name)", "path.replace(/[?#].*/, '')"])
    assert.deepEqual(readsIn("a.ts", source), [], source);
});

test("no scenario that comes with PointIt is known by name", () => {
  const names = readdirSync(join(SOURCE, "../../../../pointit/launch/scenarios")).map((file) =>
    file.replace(/\.yaml$/, ""),
  );
  assert.ok(names.includes("scenario_4"));
  const files = readdirSync(SOURCE, { recursive: true }).filter(isSource);
  const found = files.flatMap((file) =>
    names
      .filter((name) => readFileSync(join(SOURCE, file), "utf8").includes(name))
      .map((name) => [name, file]),
  );
  assert.deepEqual(found, []);
});
