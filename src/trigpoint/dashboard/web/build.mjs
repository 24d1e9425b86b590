// Builds ../static from these sources; `make page` runs it after the type check.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "..", "static");
const sha256 = (bytes) => createHash("sha256").update(bytes).digest("hex");

// Must agree with digest_of_sources in tests/dashboard/test_dashboard_bundle.py.
function sources() {
  const top = ["build.mjs", "index.html", "package-lock.json", "package.json", "tsconfig.json"];
  const inner = readdirSync(join(here, "src"), { recursive: true, withFileTypes: true })
    .filter((entry) => entry.isFile())
    .map((entry) => relative(here, join(entry.parentPath, entry.name)).split("\\").join("/"));
  return [...top, ...inner].sort();
}

function digest() {
  const hash = createHash("sha256");
  for (const name of sources()) hash.update(`${name}\0${sha256(readFileSync(join(here, name)))}\n`);
  return hash.digest("hex");
}

function licences() {
  const lock = JSON.parse(readFileSync(join(here, "package-lock.json"), "utf8"));
  const parts = [];
  for (const [folder, entry] of Object.entries(lock.packages)) {
    if (!folder || entry.dev) continue;
    const file = readdirSync(join(here, folder)).find((name) => /^licen[cs]e/i.test(name));
    const text = file ? readFileSync(join(here, folder, file), "utf8").trim() : `Licence: ${entry.license}`;
    parts.push(`${folder.replace("node_modules/", "")} ${entry.version}\n\n${text}\n`);
  }
  return `The page holds code of these packages.\n\n${parts.join(`\n${"-".repeat(80)}\n\n`)}`;
}

const embedded = digest();
rmSync(out, { recursive: true, force: true });
await build({
  entryPoints: [join(here, "src", "app.ts"), join(here, "src", "page.css")],
  outdir: out,
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  define: { SOURCES: JSON.stringify(embedded) },
  banner: { js: `/* Built by \`make page\` from dashboard/web; sources sha256 ${embedded}; licences: licences.txt */` },
});
copyFileSync(join(here, "index.html"), join(out, "index.html"));
copyFileSync(join(here, "src", "icon.svg"), join(out, "icon.svg"));
writeFileSync(join(out, "licences.txt"), licences());
const files = Object.fromEntries(readdirSync(out).sort().map((name) => [name, sha256(readFileSync(join(out, name)))]));
writeFileSync(join(out, "built.json"), `${JSON.stringify({ sources: embedded, files }, null, 1)}\n`);
console.log(`page: ${Object.keys(files).length + 1} files, app.js ${readFileSync(join(out, "app.js")).length} bytes`);
