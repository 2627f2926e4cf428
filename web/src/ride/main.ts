import { addStyle, payloadOf } from "../shared/payload";
import css from "./style.css";

addStyle(css);
payloadOf("hpop-ride", 1);
