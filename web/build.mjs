// Bundles each page into ../hpop/view/web/, committed so that installing hpop needs no node.
// `node build.mjs` writes; `node build.mjs --check` builds again and compares byte by byte.
// The first line of a bundle holds the hash of all sources; tests/view/test_bundles.py computes the same.
import { createHash } from "node:crypto";
import { existsSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join, relative, sep } from "node:path";
import { fileURLToPath } from "node:url";
import { build, transform } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const target = join(here, "..", "hpop", "view", "web");
const SOURCES = ["build.mjs", "package.json", "package-lock.json", "tsconfig.json", "src"];
// A page's name, what its bundle starts from, and how it is loaded: a script of a page, or a module.
const BUNDLES = [
  { file: "explorer.js", entry: "src/explorer/main.ts", format: "iife" },
  { file: "widget.js", entry: "src/explorer/widget.ts", format: "esm" },
  { file: "ride.js", entry: "src/ride/main.ts", format: "iife" },
  { file: "live.js", entry: "src/live/main.ts", format: "iife" },
  { file: "study.js", entry: "src/study/main.ts", format: "iife" },
];

function filesOf(path) {
  const entries = readdirSync(path, { withFileTypes: true });
  return entries.flatMap((e) => (e.isDirectory() ? filesOf(join(path, e.name)) : [join(path, e.name)]));
}

function hashOfSources() {
  const files = SOURCES.flatMap((name) => (name === "src" ? filesOf(join(here, name)) : [join(here, name)]));
  const names = files.map((file) => relative(here, file).split(sep).join("/")).sort();
  const hash = createHash("sha256");
  for (const name of names) hash.update(name + "\0").update(readFileSync(join(here, name))).update("\0");
  return hash.digest("hex");
}

// Style sheets are text in a bundle, without their spaces.
const styles = {
  name: "styles",
  setup(build) {
    build.onLoad({ filter: /\.css$/ }, async ({ path }) => {
      const { code } = await transform(readFileSync(path, "utf8"), { loader: "css", minify: true });
      return { contents: code, loader: "text" };
    });
  },
};

async function bundled({ entry, format }, hash) {
  const result = await build({
    absWorkingDir: here,
    entryPoints: [entry],
    bundle: true,
    minify: true,
    format,
    target: "es2022",
    charset: "ascii",
    plugins: [styles],
    legalComments: "inline",
    banner: { js: `/* hpop, sources ${hash} */` },
    write: false,
  });
  return result.outputFiles[0].text;
}

const hash = hashOfSources();
const check = process.argv.includes("--check");
mkdirSync(target, { recursive: true });
for (const bundle of BUNDLES) {
  if (!existsSync(join(here, bundle.entry))) throw new Error(`${bundle.entry} is missing`);
  const text = await bundled(bundle, hash);
  const path = join(target, bundle.file);
  if (!check) writeFileSync(path, text);
  else if (!existsSync(path) || readFileSync(path, "utf8") !== text) {
    process.stderr.write(`${bundle.file} is not what its sources make: run \`make web\` and commit it\n`);
    process.exitCode = 1;
  }
  process.stdout.write(`${bundle.file} ${text.length} bytes\n`);
}
