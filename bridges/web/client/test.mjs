// Bundles every src/**/*.test.ts(x), and runs it and the rules of the sources (*.test.mjs here) with `node --test`.
import { build } from "esbuild";
import { mkdtempSync, readdirSync, rmSync } from "node:fs";
import { spawnSync } from "node:child_process";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const tests = readdirSync(join(here, "src"), { recursive: true })
  .filter((file) => /\.test\.tsx?$/.test(file))
  .sort();
const rules = readdirSync(here)
  .filter((file) => file.endsWith(".test.mjs"))
  .sort();
const out = mkdtempSync(join(tmpdir(), "pointit-page-"));
try {
  await build({
    absWorkingDir: here,
    entryPoints: tests.map((file) => `src/${file}`),
    outdir: out,
    bundle: true,
    platform: "node",
    format: "esm",
    outExtension: { ".js": ".mjs" },
    logLevel: "warning",
  });
  const ran = spawnSync(
    process.execPath,
    [
      "--test",
      ...tests.map((file) => join(out, file.replace(/\.tsx?$/, ".mjs"))),
      ...rules.map((file) => join(here, file)),
    ],
    { stdio: "inherit" },
  );
  process.exitCode = ran.status ?? 1;
} finally {
  rmSync(out, { recursive: true, force: true });
}
