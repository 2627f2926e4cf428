// The page of one participant's session in a study.
import { addStyle } from "../shared/payload";
import { element } from "../shared/dom";
import { given } from "./model";
import { Session } from "./session";
import css from "./style.css";

addStyle(css);
try {
  void new Session(given()).begin();
} catch (error) {
  document.body.replaceChildren(element("p", "", error instanceof Error ? error.message : String(error)));
}
