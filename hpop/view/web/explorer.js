/* hpop, sources 6600b53513a46c3d73a981048ce53479156643f5238c0be8f144c4d29d995ee3 */
"use strict";(()=>{function o(t,e){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==t||n.version!==e)throw new Error(`this page reads ${t} version ${e}; its data are something else`);return n}function r(t){let e=document.createElement("style");e.textContent=t,document.head.append(e)}var s=`body { font: 14px system-ui, sans-serif; }
`;r(s);o("hpop-explorer",1);})();
