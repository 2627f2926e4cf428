/* hpop, sources 8cfddf1a160fb9a6e74c6a13f460910077f46bfa0b457a8c77ad4ecb3ddc839b */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body { font: 14px system-ui, sans-serif; }
`;s(r);o("hpop-ride",1);})();
