// The ride: the viewer's view along trajectories of a front, on a desktop, a phone or a headset; or a stimulus of a study,
// which is shown once and reveals nothing; or an arm among its obstacles, in which joints are moved.
import { arm } from "../arm/model";
import { Page as ArmPage } from "../arm/page";
import armCss from "../arm/style.css";
import { addStyle, schemaOfPayload } from "../shared/payload";
import { element } from "../shared/dom";
import { ride, stimulus } from "./model";
import { Page } from "./page";
import { StimulusPage, tell } from "./stimulus";
import css from "./style.css";

addStyle(css + armCss);
try {
  const schema = schemaOfPayload();
  if (schema === "hpop-arm") new ArmPage(arm());
  else if (schema === "hpop-stimulus") new StimulusPage(stimulus());
  else new Page(ride());
} catch (error) {
  const reason = error instanceof Error ? error.message : String(error);
  const text = /webgl/i.test(reason)
    ? "This browser cannot draw WebGL, which this page needs. Try another browser, or turn on hardware acceleration in its settings."
    : reason;
  document.body.replaceChildren(element("p", "", text));
  tell({ kind: "failed", reason: text });
}
