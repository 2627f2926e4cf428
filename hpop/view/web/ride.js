/* hpop, sources a5ad276ef82eac4c498f0f2e55171c660674e91857f62f5ce74772147503bc5f */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body{font:14px system-ui,sans-serif}
`;s(r);o("hpop-ride",1);})();
