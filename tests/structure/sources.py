"""The files of a checkout, their lines and their functions, without importing any of them."""

import ast
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

Figures = dict[str, Any]

MOST_FILES: Final = 12
"""In a folder, without `__init__.py`: what house rules allow before it is two concepts."""
MOST_ARGUMENTS: Final = 8
"""Of a kernel, before named tuples are clearer."""
_NOT_PRODUCT: Final = "tests"
_COMPILERS: Final = frozenset({"njit", "jit"})
_LONGEST_SHOWN: Final = 10


@dataclass(frozen=True)
class Source:
    """One file of Python."""

    path: Path
    module: str
    package: str
    """Dotted name of its folder."""
    lines: int
    tree: ast.Module

    @property
    def is_package(self) -> bool:
        return self.path.name == "__init__.py"


def read_sources(root: Path) -> list[Source]:
    """Every file of the product's top-level packages, in order of its name."""
    tops = sorted(path.parent for path in root.glob("*/__init__.py"))
    paths = [p for top in tops if top.name != _NOT_PRODUCT for p in sorted(top.rglob("*.py"))]
    return [_read(path, root) for path in paths]


def _read(path: Path, root: Path) -> Source:
    text = path.read_text()
    parts = path.relative_to(root).with_suffix("").parts
    package = ".".join(parts[:-1])
    module = package if path.name == "__init__.py" else ".".join(parts)
    return Source(path, module, package, len(text.splitlines()), ast.parse(text))


def sizes(sources: Sequence[Source]) -> Figures:
    """Files and lines, how they spread, and which folders are full."""
    files = [source for source in sources if not source.is_package]
    lines = [source.lines for source in files]
    folders = Counter(source.package for source in files)
    return {
        "files": len(files),
        "package_files": len(sources) - len(files),
        "lines": sum(source.lines for source in sources),
        "lines_of_a_file": spread(lines),
        "files_under_50": sum(count < 50 for count in lines),
        "files_under_80": sum(count < 80 for count in lines),
        "files_over_400": sum(count > 400 for count in lines),
        "files_over_500": sum(count > 500 for count in lines),
        "longest_files": _longest({source.module: source.lines for source in files}),
        "folders": len(folders),
        "folders_above_12_files": _longest(
            {name: count for name, count in folders.items() if count > MOST_FILES}, shown=99
        ),
    }


def functions(sources: Sequence[Source]) -> Figures:
    """How long functions are, and how many arguments the compiled ones take."""
    all_lines: list[int] = []
    arguments: dict[str, int] = {}
    for source in sources:
        decorators = _compiling_names(source.tree)
        for function in _functions_of(source.tree):
            all_lines.append((function.end_lineno or function.lineno) - function.lineno + 1)
            if any(_is_compiler(one, decorators) for one in function.decorator_list):
                arguments[f"{source.module}.{function.name}"] = _argument_count(function)
    counts = list(arguments.values())
    return {
        "functions": len(all_lines),
        "lines_of_a_function": spread(all_lines),
        "kernels": len(counts),
        "most_arguments_of_a_kernel": max(counts, default=0),
        "kernels_above_8_arguments": sum(count > MOST_ARGUMENTS for count in counts),
        "kernels_with_most_arguments": _longest(arguments),
    }


def spread(values: Sequence[int]) -> Figures:
    """Quantiles."""
    if not values:
        return {}
    ordered = sorted(values)
    cuts = {"p10": 0.1, "p25": 0.25, "p75": 0.75, "p90": 0.9, "p99": 0.99}
    found = {
        name: ordered[min(len(ordered) - 1, int(q * len(ordered)))] for name, q in cuts.items()
    }
    return {"median": statistics.median(ordered), **found, "max": ordered[-1]}


def _longest(counted: dict[str, int], shown: int = _LONGEST_SHOWN) -> dict[str, int]:
    return dict(sorted(counted.items(), key=lambda item: (-item[1], item[0]))[:shown])


def _functions_of(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def _compiling_names(tree: ast.Module) -> set[str]:
    """What this module calls numba's decorators, with their options."""
    return {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign) and _is_compiler(node.value, set())
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def _is_compiler(decorator: ast.expr, names: set[str]) -> bool:
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
    return name in _COMPILERS or name in names


def _argument_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    arguments = function.args
    return len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs)
