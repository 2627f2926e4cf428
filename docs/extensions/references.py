"""References in docstrings and signatures: a link if the site has it, code if it only exists, else a warning.

Docstrings name what is public, which has a page, and what is not, such as the module that holds a kernel. Both shall
be true. So a reference that Sphinx does not resolve is looked up among all names of the package, read from its sources:
what is documented under another name (`hpop.problems.problem.Problem` is `hpop.Problem`) becomes a link, what is only
there becomes code. A name that exists nowhere stays unresolved, and with ``nitpicky`` and ``-W`` fails the build. Names
of other projects are imported to see that they are there; nothing is fetched.

The pages of source code link back to what documents it. Sphinx guesses the name by the module that it saw last, which
is wrong where a module's classes are public in several places; so these links are looked up too.
"""

from __future__ import annotations

import ast
import pkgutil
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import hpop

PACKAGE = Path(__file__).resolve().parents[2] / "hpop"
OTHERS = {"np": "numpy", "nx": "networkx", "ca": "casadi"}
BACK = re.compile(r'(class="viewcode-back" href=")[^"#]*#([^"]*)"')
OWN_NAMES = {"hpop.frontier", "hpop.search"}  # modules with a Front, a Point and a Graph of their own
PUBLIC = {name: f"hpop.{name}" for name in hpop.__all__} | {"Point": "hpop.problems.front.Point"}
ROOTS = (
    "builtins",
    "typing",
    "collections.abc",
    "numpy",
    "numpy.typing",
    "pathlib",
    "concurrent.futures",
    "os",
    "types",
)


def names_within(body: list[ast.stmt], above: str) -> Iterator[str]:
    """Dotted names that statements define: classes and what is in them, functions, attributes, type variables."""
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield f"{above}.{node.name}"
            if isinstance(node, ast.ClassDef):
                yield from names_within(node.body, f"{above}.{node.name}")
                for method in node.body:
                    if isinstance(method, ast.FunctionDef):
                        yield from own_attributes(method, f"{above}.{node.name}")
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            for target in [node.target] if isinstance(node, ast.AnnAssign) else node.targets:
                if isinstance(target, ast.Name):
                    yield f"{above}.{target.id}"
        elif isinstance(node, ast.ImportFrom | ast.Import):
            for alias in node.names:
                yield f"{above}.{alias.asname or alias.name}"
        elif isinstance(node, ast.If):
            yield from names_within([*node.body, *node.orelse], above)


def own_attributes(method: ast.FunctionDef, above: str) -> Iterator[str]:
    """Names that a method gives to ``self``."""
    for node in ast.walk(method):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "self":
            yield f"{above}.{node.attr}"


def defined(package: Path = PACKAGE) -> dict[str, set[str]]:
    """All dotted names of a package, by each of their ends: ``World``, ``world.World``, ``hpop.world.World``."""
    by_end: dict[str, set[str]] = defaultdict(set)
    for file in package.rglob("*.py"):
        parts = [package.name, *file.relative_to(package).with_suffix("").parts]
        module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        for name in {module, *names_within(ast.parse(file.read_text(encoding="utf-8")).body, module)}:
            pieces = name.split(".")
            for begin in range(len(pieces)):
                by_end[".".join(pieces[begin:])].add(name)
    return by_end


def is_elsewhere(target: str) -> bool:
    """Return True if Python, NumPy or another project has the name."""
    first, _, rest = target.partition(".")
    candidates = [target, f"{OTHERS.get(first, first)}.{rest}" if rest else target]
    if target == "ellipsis":  # the type of ``...``
        return True
    for name in [*candidates, *(f"{root}.{target}" for root in ROOTS)]:
        try:
            pkgutil.resolve_name(name)
        except (ImportError, AttributeError, ValueError):
            continue
        return True
    return False


def places(app: Sphinx, target: str) -> dict[tuple[str, str], str]:
    """Pages and places in them that document what ends so, each with its name."""
    objects = app.env.domains.python_domain.objects
    return {
        (objects[name].docname, objects[name].node_id): name
        for name in sorted(app._hpop_names.get(target, ()))
        if name in objects
    }


def documented(app: Sphinx, target: str) -> dict[tuple[str, str], str]:
    """Pages and places in them that document a name with this end, such as a method that a package's name gives."""
    objects = app.env.domains.python_domain.objects
    return {(it.docname, it.node_id): name for name, it in objects.items() if name.endswith(f".{target}")}


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Element) -> nodes.Node | None:
    """Return the link or the code for an unresolved reference to Python; None if the name exists nowhere."""
    if node.get("refdomain") != "py":
        return None
    target = str(node["reftarget"]).lstrip(".~")
    if target not in app._hpop_names:
        return content if is_elsewhere(target) else None
    found = places(app, target)
    if len(found) != 1:
        return content
    (((docname, place), name),) = found.items()
    uri = app.builder.get_relative_uri(node["refdoc"], docname)
    return nodes.reference("", "", content, internal=True, refuri=f"{uri}#{place}", reftitle=name)


def prefer_public(app: Sphinx, doctree: nodes.document) -> None:
    """Resolve a bare name in a signature, such as ``Front``, to the public name unless its module documents another."""
    for node in doctree.findall(pending_xref):
        target = str(node["reftarget"])
        if node.get("refdomain") == "py" and target in PUBLIC and node.get("py:module") not in OWN_NAMES:
            node["reftarget"] = PUBLIC[target]


def lead_back(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document | None) -> None:
    """Links of a page of source code, to where its names are documented."""
    if not page.startswith("_modules/hpop/"):
        return
    module = page.removeprefix("_modules/").replace("/", ".")

    def lead(link: re.Match[str]) -> str:
        pieces = link[2].split(".")
        for begin in range(len(pieces)):
            within = ".".join(pieces[begin:])
            found = places(app, f"{module}.{within}") or places(app, within) or documented(app, within)
            if len(found) == 1:
                ((docname, place),) = found
                return f'{link[1]}{app.builder.get_relative_uri(page, docname)}#{place}"'
        return link[0]

    context["body"] = BACK.sub(lead, context["body"])


def read_names(app: Sphinx) -> None:
    """Read the package's names once."""
    app._hpop_names = defined()


def setup(app: Sphinx) -> dict[str, bool]:
    """Look names up where Sphinx does not know them."""
    app.connect("builder-inited", read_names)
    app.connect("doctree-read", prefer_public)
    app.connect("missing-reference", resolve)
    app.connect("html-page-context", lead_back)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
