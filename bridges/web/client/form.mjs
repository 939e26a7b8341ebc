// Measures the form of every source of the page by the TypeScript compiler, and says where it breaks the limits, which
// are the same for all files. `node form.mjs --list` names each place.
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import ts from "typescript";

const SOURCE = join(dirname(fileURLToPath(import.meta.url)), "src");
/** Written by types.mjs. */
const GENERATED = new Set(["messages.ts", "topics.ts", "wire.ts"]);
/** Lines of a function. */
const MAX_LINES = 60;
/** How often each rule may be broken in all sources together, as long as older functions break it. They only fall. */
const LIMITS = { "long function": 25, "nested conditional": 70, "several declarations": 0 };

const found = Object.fromEntries(Object.keys(LIMITS).map((rule) => [rule, []]));

function isFunction(node) {
  return (
    ts.isFunctionDeclaration(node) ||
    ts.isFunctionExpression(node) ||
    ts.isArrowFunction(node) ||
    ts.isMethodDeclaration(node) ||
    ts.isConstructorDeclaration(node) ||
    ts.isAccessor(node)
  );
}

/** A conditional expression within a branch of another one, without a function between them. */
function isNestedConditional(node) {
  if (!ts.isConditionalExpression(node)) return false;
  let inner = node;
  let outer = node.parent;
  while (outer && !isFunction(outer) && !ts.isStatement(outer)) {
    if (ts.isConditionalExpression(outer) && inner !== outer.condition) return !ts.isJsxExpression(inner);
    // A branch of markup is a tree of its own
    if (ts.isJsxElement(outer) || ts.isJsxFragment(outer) || ts.isJsxSelfClosingElement(outer)) return false;
    inner = outer;
    outer = outer.parent;
  }
  return false;
}

function measure(file) {
  const text = readFileSync(join(SOURCE, file), "utf8");
  const kind = file.endsWith(".tsx") ? ts.ScriptKind.TSX : ts.ScriptKind.TS;
  const tree = ts.createSourceFile(file, text, ts.ScriptTarget.Latest, true, kind);
  const lineOf = (position) => tree.getLineAndCharacterOfPosition(position).line + 1;

  function note(rule, node, detail) {
    found[rule].push(`${file}:${lineOf(node.getStart())} ${detail}`);
  }

  function visit(node) {
    if (isFunction(node)) {
      const lines = lineOf(node.end) - lineOf(node.getStart()) + 1;
      if (lines > MAX_LINES)
        note("long function", node, `${node.name?.getText() ?? "function"}: ${lines} lines`);
    }
    if (isNestedConditional(node))
      note("nested conditional", node, node.getText().split("\n")[0].slice(0, 60));
    if (ts.isVariableStatement(node) && node.declarationList.declarations.length > 1)
      note("several declarations", node, node.getText().split("\n")[0].slice(0, 60));
    ts.forEachChild(node, visit);
  }

  visit(tree);
}

const files = readdirSync(SOURCE, { recursive: true }).filter(
  (file) => /\.tsx?$/.test(file) && !GENERATED.has(file) && !file.endsWith(".d.ts"),
);
for (const file of files.sort()) measure(file);
let isBroken = false;
for (const [rule, places] of Object.entries(found)) {
  const isOver = places.length > LIMITS[rule];
  isBroken ||= isOver;
  if (isOver || process.argv.includes("--list")) {
    console.log(`${rule}: ${places.length}, limit ${LIMITS[rule]}`);
    for (const place of places) console.log(`  ${place}`);
  }
}
process.exitCode = isBroken ? 1 : 0;
