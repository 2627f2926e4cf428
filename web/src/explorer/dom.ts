// Elements by name, class and text. Text is set as text, whatever it contains.

type Attributes = Readonly<Record<string, string>>;

/** An element with a class, its text or children, and attributes. */
export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  className = "",
  content: string | readonly (Node | string)[] = [],
  attributes: Attributes = {},
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (typeof content === "string") element.textContent = content;
  else element.append(...content);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

/** A button that does something; its title says what, and its label where the text is a sign. */
export function button(text: string, title: string, act: () => void, className = ""): HTMLButtonElement {
  const element = make("button", className, text, { type: "button", title });
  if (text.length < 3) element.setAttribute("aria-label", title);
  element.addEventListener("click", act);
  return element;
}

/** A part of the page with a heading. */
export function panel(name: string, heading: string, ...content: readonly HTMLElement[]): HTMLElement {
  const id = `hpop-${name}-heading`;
  const title = make("h2", "", heading, { id });
  return make("section", `panel ${name}`, [make("div", "panel-head", [title]), ...content], {
    "aria-labelledby": id,
  });
}

/** Where the head of a panel takes its buttons. */
export function headOf(element: HTMLElement): HTMLElement {
  return element.querySelector<HTMLElement>(".panel-head")!;
}
