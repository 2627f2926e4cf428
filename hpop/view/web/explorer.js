/* hpop, sources ac07350fad65a0d439a06a0fba91b877bd87056fffa7e67eeff3fb2578ea1df2 */
"use strict";(()=>{function o(t,e){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==t||n.version!==e)throw new Error(`this page reads ${t} version ${e}; its data are something else`);return n}function r(t){let e=document.createElement("style");e.textContent=t,document.head.append(e)}var s=`body { font: 14px system-ui, sans-serif; }
`;r(s);o("hpop-explorer",1);})();
