/* hpop, sources 07ae6839af826bd200119ea1c5aee4d435003a88ea1823611a869cd1e85a4028 */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body { font: 14px system-ui, sans-serif; }
`;s(r);o("hpop-ride",1);})();
