// What the page was given: strict JSON in a script element that no browser runs.

/** The page's data, or an error that says what is wrong with the file. */
export function payloadOf(schema: string, version: number): unknown {
  const text = document.getElementById("payload")?.textContent ?? "";
  const payload = JSON.parse(text) as { schema?: unknown; version?: unknown };
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
