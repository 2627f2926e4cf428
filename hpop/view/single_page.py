"""Web page in one HTML file: a bundled script and its data, without any network access.

A content security policy enforces this: it allows only the page's own scripts, by hash, no connections, and no
evaluation of text. Data are in an element that is not executed, with ``</`` escaped, so that a name such as
``</script><b>`` stays a name. The bundle is deflated to about a third of its size; a short first script inflates it and
adds it to the page.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import zlib
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from hpop.base.text import printable, shown
from hpop.errors import OptionError

PAGE = """<!doctype html>
<html lang="{language}">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<link rel="icon" href="data:,">
<title>{title}</title>
</head>
<body>
<noscript>{noscript}</noscript>
<script type="application/json" id="payload">{payload}</script>
<script type="text/plain" id="bundle">{bundle}</script>
<script>{loader}</script>
</body>
</html>
"""
NOSCRIPT = {
    "en": "This page needs JavaScript to draw the content of this file. It sends nothing anywhere.",
    "de": "Diese Seite braucht JavaScript, um den Inhalt dieser Datei zu zeichnen. Sie sendet nichts.",
    "fi": "Tämä sivu tarvitsee JavaScriptiä tiedoston sisällön piirtämiseen. Se ei lähetä mitään minnekään.",
}
LOADER = """
(async () => {
  const deflated = Uint8Array.from(atob(document.getElementById("bundle").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.body.append(script);
})();
"""
LEVEL = 9  # compression level, of 9; takes 10 ms
ENDINGS = (".html", ".htm")


def page_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a page to write; raise OptionError unless its name ends in .html or .htm."""
    target = Path(path)
    if target.suffix.lower() not in ENDINGS:
        raise OptionError(f"expected a file name that ends in .html, got {shown(target.name)}; pages are HTML files")
    return target


@cache
def bundle(name: str) -> str:
    """Return the text of a script bundled by web/build.mjs: "explorer.js", "live.js", "ride.js", "study.js", ..."""
    return resources.files("hpop.view").joinpath("web", name).read_text(encoding="utf-8")


def single_page(
    script: str,
    title: str,
    payload: Mapping[str, Any],
    *,
    connect: str = "'none'",
    images: str = "",
    frames: Iterable[str] = (),
    language: str = "en",
) -> str:
    """Return the HTML text of a page that contains the bundled script ``script`` and its data ``payload``.

    connect   where the page may load data and media from (a source of its Content-Security-Policy); "'none'", except
              for a page that a server of hpop serves
    images    origin from which the page may load images, besides its own; "" for none
    frames    hashes of the scripts of pages that this page embeds, so that its policy allows these scripts too
    language  language code of the texts, such as "en"
    """
    code = bundle(script).encode()
    scripts = " ".join(dict.fromkeys((_hash_of(LOADER.encode()), _hash_of(code), *frames)))
    seen = " ".join(filter(None, ("data: blob:", images)))
    policy = (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; "
        f"img-src {seen}; connect-src {connect}; media-src {connect}; base-uri 'none'; form-action 'none'"
    )
    data = (
        json.dumps(payload, allow_nan=False, separators=(",", ":")).replace("</", "<\\/").replace("<!--", "<\\u0021--")
    )
    return PAGE.format(
        language=html.escape(language),
        noscript=NOSCRIPT.get(language, NOSCRIPT["en"]),
        policy=policy,
        title=html.escape(printable(title)),
        payload=data,
        bundle=_compressed_script(code),
        loader=LOADER,
    )


@lru_cache(maxsize=4)
def _compressed_script(code: bytes) -> str:
    """Return a script compressed as base64 text; cached, because a study writes a page for each participant."""
    return base64.b64encode(zlib.compress(code, LEVEL)).decode()


def _hash_of(script: bytes) -> str:
    """Return the hash of a script in the form of a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"
