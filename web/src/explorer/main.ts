import { addStyle, payloadOf } from "../shared/payload";
import css from "./style.css";

addStyle(css);
payloadOf("hpop-explorer", 1);
