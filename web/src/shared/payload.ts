// The page's data: strict JSON in a script element that browsers do not run.

function parsed(): { schema?: unknown; version?: unknown } {
  const text = document.getElementById("payload")?.textContent ?? "";
  return JSON.parse(text) as { schema?: unknown; version?: unknown };
}

/** Schema that the page's data name. */
export function schemaOfPayload(): unknown {
  return parsed().schema;
}

/** The page's data; throws an error that names the fault of the file. */
export function payloadOf(schema: string, version: number): unknown {
  const payload = parsed();
  if (payload.schema !== schema || payload.version !== version) {
    throw new Error(`this page reads ${schema} version ${version}; its data are something else`);
  }
  return payload;
}

/** Adds a style sheet to the page. */
export function addStyle(css: string): void {
  const style = document.createElement("style");
  style.textContent = css;
  document.head.append(style);
}
