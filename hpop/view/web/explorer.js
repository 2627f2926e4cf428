/* hpop, sources 04adf40a760be58a57ba917203c1e04b8a817158bea445eb56f1bf575b2ca1af */
"use strict";(()=>{function o(t,e){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==t||n.version!==e)throw new Error(`this page reads ${t} version ${e}; its data are something else`);return n}function r(t){let e=document.createElement("style");e.textContent=t,document.head.append(e)}var s=`body { font: 14px system-ui, sans-serif; }
`;r(s);o("hpop-explorer",1);})();
