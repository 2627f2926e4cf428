/* hpop, sources 8a7ee800fa2fbb367ab5b9d45f7ca372561073aecd42306ddb5f5224a708e37a */
"use strict";(()=>{function o(e,t){let a=document.getElementById("payload")?.textContent??"",n=JSON.parse(a);if(n.schema!==e||n.version!==t)throw new Error(`this page reads ${e} version ${t}; its data are something else`);return n}function s(e){let t=document.createElement("style");t.textContent=e,document.head.append(t)}var r=`body{font:14px system-ui,sans-serif}
`;s(r);o("hpop-ride",1);})();
