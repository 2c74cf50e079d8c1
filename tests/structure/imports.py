"""Who imports whom, when, and in which circles.

An import happens when its module is loaded, or later in a function, or only for the type checker.
A circle of the first kind breaks a program; one of the others only keeps a reader going round.
"""

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from typing import Final, NamedTuple

from tests.structure.sources import Figures, Source

_SHORT: Final = 120
"""Lines under which a module with one importer beside it belongs into that importer."""


class When(Enum):
    """When an import is carried out."""

    LOADED = "loaded"
    CALLED = "called"
    TYPE_CHECKED = "type_checked"


class Import(NamedTuple):
    """One module needs another."""

    importer: str
    imported: str
    when: When


Graph = dict[str, set[str]]


def imports_of(sources: Sequence[Source]) -> set[Import]:
    """Every import of one of these modules by another."""
    known = {source.module for source in sources}
    return {
        Import(source.module, imported, when)
        for source in sources
        for names, when in _statements(source)
        for imported in _resolved(names, known)
        if imported != source.module
    }


def circles(sources: Sequence[Source]) -> Figures:
    """Circles of modules and of packages: as loaded, and with every kind of import."""
    imports = imports_of(sources)
    package_of = {source.module: source.package for source in sources}
    figures: Figures = {}
    for name, kinds in (
        ("as_loaded", {When.LOADED}),
        ("with_imports_in_functions", {When.LOADED, When.CALLED}),
        ("with_type_checking_too", set(When)),
    ):
        pairs = [(one.importer, one.imported) for one in imports if one.when in kinds]
        between = [(package_of[a], package_of[b]) for a, b in pairs]
        figures[f"modules_{name}"] = strongly_connected(graph_of(pairs))
        figures[f"packages_{name}"] = strongly_connected(graph_of(between))
        figures[f"package_pairs_{name}"] = _mutual(graph_of(between))
    return figures


def single_importers(sources: Sequence[Source]) -> Figures:
    """Modules that one neighbour in the same folder imports, and nobody else."""
    imports = imports_of(sources)
    importers = defaultdict(set)
    for one in imports:
        importers[one.imported].add(one.importer)
    by_name = {source.module: source for source in sources}
    only: list[Source] = []
    for source in sources:
        found = importers[source.module]
        if len(found) == 1 and not source.is_package:
            (importer,) = found
            if by_name[importer].package == source.package:
                only.append(source)
    short = [source for source in only if source.lines < _SHORT]
    return {
        "modules_with_one_importer_beside_them": len(only),
        "lines_of_these": sum(source.lines for source in only),
        "of_these_under_120_lines": len(short),
        "short_ones": {
            source.module: f"{next(iter(importers[source.module]))} ({source.lines} lines)"
            for source in short
        },
    }


def graph_of(pairs: Iterable[tuple[str, str]]) -> Graph:
    """Without edges from a node to itself."""
    graph: Graph = defaultdict(set)
    for here, there in pairs:
        if here != there:
            graph[here].add(there)
            graph.setdefault(there, set())
    return graph


def strongly_connected(graph: Graph) -> list[list[str]]:
    """Sets of nodes, two or more, each of which leads to each other one: Tarjan's algorithm."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    path: list[str] = []
    found: list[list[str]] = []
    for root in sorted(graph):
        if root in number:
            continue
        # An explicit stack: a chain of imports may be longer than the interpreter lets calls nest.
        number[root] = lowest[root] = len(number)
        path.append(root)
        walk = [(root, iter(sorted(graph[root])))]
        while walk:
            node, rest = walk[-1]
            following = next(rest, None)
            if following is None:
                walk.pop()
                if walk:
                    above = walk[-1][0]
                    lowest[above] = min(lowest[above], lowest[node])
                if lowest[node] == number[node]:
                    component = path[path.index(node) :]
                    del path[path.index(node) :]
                    found += [sorted(component)] * (len(component) > 1)
            elif following not in number:
                number[following] = lowest[following] = len(number)
                path.append(following)
                walk.append((following, iter(sorted(graph[following]))))
            elif following in path:
                lowest[node] = min(lowest[node], number[following])
    return sorted(found)


def _mutual(graph: Graph) -> list[list[str]]:
    return sorted([a, b] for a in graph for b in graph[a] if a < b and a in graph[b])


def _statements(source: Source) -> Iterator[tuple[list[str], When]]:
    """The dotted names that a file asks for, the longest meaning of each first."""
    for node, when in _walk(source.tree.body, When.LOADED):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield [alias.name], when
        elif isinstance(node, ast.ImportFrom):
            base = _base(node, source)
            for alias in node.names:
                yield [f"{base}.{alias.name}", base], when


def _walk(body: Iterable[ast.AST], when: When) -> Iterator[tuple[ast.AST, When]]:
    for node in body:
        if isinstance(node, ast.expr):  # in which nothing is imported
            continue
        yield node, when
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            later = When.CALLED if when is When.LOADED else when
            yield from _walk(ast.iter_child_nodes(node), later)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            yield from _walk(node.body, When.TYPE_CHECKED)
            yield from _walk(node.orelse, when)
        else:
            yield from _walk(ast.iter_child_nodes(node), when)


def _base(node: ast.ImportFrom, source: Source) -> str:
    if not node.level:
        return node.module or ""
    parts = source.package.split(".")
    parts = parts[: len(parts) - node.level + 1]
    return ".".join([*parts, *([node.module] if node.module else [])])


def _resolved(names: list[str], known: set[str]) -> list[str]:
    """The module that is meant: `from a.b import c` asks for a.b.c if that is one, else for a.b."""
    for name in names:
        if name in known:
            return [name]
    return []
