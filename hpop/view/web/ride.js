/* hpop, sources 2335e5a87fc2ec6841b63b502f812c9002ca535aeddbfc5494d1c7936b5c13c3 */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body{font:14px system-ui,sans-serif}
`;s(r);o("hpop-ride",1);})();
