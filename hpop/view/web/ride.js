/* hpop, sources 04adf40a760be58a57ba917203c1e04b8a817158bea445eb56f1bf575b2ca1af */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body { font: 14px system-ui, sans-serif; }
`;s(r);o("hpop-ride",1);})();
