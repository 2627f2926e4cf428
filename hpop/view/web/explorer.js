/* hpop, sources 07ae6839af826bd200119ea1c5aee4d435003a88ea1823611a869cd1e85a4028 */
"use strict";(()=>{function o(t,e){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==t||n.version!==e)throw new Error(`this page reads ${t} version ${e}; its data are something else`);return n}function r(t){let e=document.createElement("style");e.textContent=t,document.head.append(e)}var s=`body { font: 14px system-ui, sans-serif; }
`;r(s);o("hpop-explorer",1);})();
