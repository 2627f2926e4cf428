// The ride: what the viewer would see along trajectories of a front, on a desktop, a phone, a headset.
import { addStyle } from "../shared/payload";
import { element } from "./dom";
import { given } from "./model";
import { Page } from "./page";
import css from "./style.css";

addStyle(css);
try {
  new Page(given());
} catch (error) {
  const reason = error instanceof Error ? error.message : String(error);
  const text = /webgl/i.test(reason)
    ? "This browser draws no WebGL, with which the ride is drawn. Another browser, or hardware acceleration in its settings, may."
    : reason;
  document.body.replaceChildren(element("p", "", text));
}
