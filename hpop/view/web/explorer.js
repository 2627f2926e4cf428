/* hpop, sources 17a7feedcf2d4be77d4514e9c22daa7c155fca2ae0e35c4f75556a1e92f19009 */
"use strict";(()=>{function o(t,e){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==t||n.version!==e)throw new Error(`this page reads ${t} version ${e}; its data are something else`);return n}function r(t){let e=document.createElement("style");e.textContent=t,document.head.append(e)}var s=`body { font: 14px system-ui, sans-serif; }
`;r(s);o("hpop-explorer",1);})();
