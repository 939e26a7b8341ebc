// Bundles src into ../static: the page (app.js, app.css), the phone's page (phone.js, phone.css), the page that maps the room (scan.js,
// scan.css) and its worker, the style of all pages but the first (touch.css), the glossary, the licences.
// The same sources and lock file give the same bytes on every machine.
import { build } from "esbuild";
import { cpSync, existsSync, mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, "../static");
rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
const entries = {
  app: "app.ts",
  phone: "phone.ts",
  scan: "scan.ts",
  "scan-worker": "scan/worker.ts",
  touch: "styles/touch.css",
};
await build({
  absWorkingDir: here,
  entryPoints: Object.fromEntries(Object.entries(entries).map(([name, file]) => [name, `src/${file}`])),
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "none",
  logLevel: "warning",
  charset: "utf8",
  splitting: true,
  chunkNames: "chunk-[hash]", // who sees the plan loads no three.js
});
cpSync(join(here, "public"), out, { recursive: true });
cpSync(join(here, "../../../docs/reference/glossary.md"), join(out, "glossary.md")); // for `?`
const bundled = Object.keys(JSON.parse(readFileSync(join(here, "package.json"))).dependencies).sort();
const licences = bundled.map((name) => {
  const folder = join(here, "node_modules", name);
  const { version } = JSON.parse(readFileSync(join(folder, "package.json")));
  const file = ["LICENSE", "LICENSE.md", "LICENSE.txt"].map((each) => join(folder, each)).find(existsSync);
  if (!file) throw new Error(`${name}: no licence file`);
  return `${name} ${version}\n\n${readFileSync(file, "utf8").trim()}\n`;
});
writeFileSync(join(out, "LICENSES.txt"), licences.join(`\n${"-".repeat(80)}\n\n`));
