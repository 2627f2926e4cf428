/* hpop, sources ac07350fad65a0d439a06a0fba91b877bd87056fffa7e67eeff3fb2578ea1df2 */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body { font: 14px system-ui, sans-serif; }
`;s(r);o("hpop-ride",1);})();
