/* hpop, sources 6600b53513a46c3d73a981048ce53479156643f5238c0be8f144c4d29d995ee3 */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body { font: 14px system-ui, sans-serif; }
`;s(r);o("hpop-ride",1);})();
