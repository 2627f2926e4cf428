/* hpop, sources 1347dd10381130d31107de77b09fc274f326f3ee17779267acd11b6618e94d0a */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body{font:14px system-ui,sans-serif}
`;s(r);o("hpop-ride",1);})();
