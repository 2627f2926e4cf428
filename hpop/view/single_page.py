"""A page in one file: a bundled script with its data, that asks nothing of any network.

The browser is told to hold it to that: the policy of the page allows its own script, known by its hash, and no other;
no connection, no evaluation of text. Data lie in an element that is not run, and ``</`` in them is escaped: a name
such as ``</script><b>`` stays a name.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

from hpop.text import printable

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
</head>
<body>
<noscript>This page needs JavaScript: it draws with it what the file holds, and sends nothing anywhere.</noscript>
<script type="application/json" id="payload">{payload}</script>
<script>{script}</script>
</body>
</html>
"""


@cache
def bundle(name: str) -> str:
    """The script of a page, as web/build.mjs bundled it: "explorer.js" or "ride.js"."""
    return resources.files("hpop.view").joinpath("web", name).read_text(encoding="utf-8")


def single_page(script: str, title: str, payload: Mapping[str, Any], *, connect: str = "'none'") -> str:
    """The text of a page: the bundle called ``script`` with its payload.

    connect  what the page may connect to, as a policy says it; nothing unless a server of ours serves the page
    """
    code = bundle(script).replace("</", "<\\/")
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
    data = (
        json.dumps(payload, allow_nan=False, separators=(",", ":")).replace("</", "<\\/").replace("<!--", "<\\u0021--")
    )
    return PAGE.format(policy=policy, title=html.escape(printable(title)), payload=data, script=code)
