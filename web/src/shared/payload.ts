// What the page was given: strict JSON in a script element that no browser runs.

function parsed(): { schema?: unknown; version?: unknown } {
  const text = document.getElementById("payload")?.textContent ?? "";
  return JSON.parse(text) as { schema?: unknown; version?: unknown };
}

/** What the page's data say that they are. */
export function schemaOfPayload(): unknown {
  return parsed().schema;
}

/** The page's data, or an error that says what is wrong with the file. */
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
