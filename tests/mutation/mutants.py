"""Small faults in source text, one at a time: what tests that mean something must notice."""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_COMPARISONS: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_OPERATORS: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
}
_FUNCTIONS: Final = {
    "min": "max",
    "max": "min",
    "floor": "ceil",
    "ceil": "floor",
    "all": "any",
    "any": "all",
    "sqrt": "abs",
    "abs": "int",
    "round": "float",
    "int": "float",
    "sorted": "list",
}


@dataclass(frozen=True)
class Mutant:
    """One fault in one file."""

    name: str
    """Where it is and what it is, without line numbers: `within_lag: a < b -> a <= b`."""
    line: int
    source: str
    """The whole file with the fault in it."""


def mutants_of(source: str) -> Iterator[Mutant]:
    """All faults of a file. Annotations, docstrings and other words are left alone."""
    for name, line, tree in _planted(source):
        yield Mutant(name, line, ast.unparse(ast.fix_missing_locations(tree)))


def names_of(source: str) -> Iterator[str]:
    """Of all faults of a file, none of which is written out."""
    return (name for name, _, _ in _planted(source))


def _planted(source: str) -> Iterator[tuple[str, int, ast.Module]]:
    """The name and the line of each fault, and the file with it until the next one is asked for."""
    tree = ast.parse(source)
    seen: Counter[str] = Counter()
    for place in _places(tree):
        for fault in _faults(place.node):
            before = _words(place.node)
            place.put(fault)
            name = f"{place.where}: {before} -> {_words(fault)}"
            seen[name] += 1
            if seen[name] > 1:
                name += f" #{seen[name]}"
            yield name, place.line, tree
            place.put(place.node)


@dataclass(frozen=True)
class _Place:
    """A node, and where in its parent it hangs."""

    node: ast.AST
    parent: ast.AST
    field: str
    index: int | None
    where: str
    line: int

    def put(self, node: ast.AST) -> None:
        if self.index is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.index] = node


def _places(parent: ast.AST, where: str = "module", line: int = 0) -> Iterator[_Place]:
    """Every node in which there may be a fault, outermost first."""
    for field, value in ast.iter_fields(parent):
        if field in ("annotation", "returns", "decorator_list", "bases", "names"):
            continue
        children = value if isinstance(value, list) else [value]
        for index, child in enumerate(children):
            if not isinstance(child, ast.AST):
                continue
            if isinstance(child, ast.keyword) and child.arg == "strict":
                continue  # of zip: says that the lengths are the same, which they are
            here = getattr(child, "lineno", line)
            name = where
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                name = child.name if where == "module" else f"{where}.{child.name}"
            yield _Place(
                child, parent, field, index if isinstance(value, list) else None, name, here
            )
            yield from _places(child, name, here)


def _faults(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand instead of a node."""
    if isinstance(node, ast.Compare):
        for index, operator in enumerate(node.ops):
            for other in _COMPARISONS[type(operator)]:
                operators = [*node.ops[:index], other(), *node.ops[index + 1 :]]
                yield ast.Compare(node.left, operators, node.comparators)
    elif isinstance(node, ast.BinOp):
        if type(node.op) in _OPERATORS:
            yield ast.BinOp(node.left, _OPERATORS[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        for index in range(len(node.values)):
            values = [*node.values[:index], *node.values[index + 1 :]]
            yield values[0] if len(values) == 1 else ast.BoolOp(node.op, values)
    elif isinstance(node, ast.UnaryOp):
        if isinstance(node.op, ast.Not | ast.USub):
            yield node.operand
    elif isinstance(node, ast.Constant):
        yield from _other_constants(node.value)
    elif isinstance(node, ast.Call):
        if isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
            function = ast.Name(_FUNCTIONS[node.func.id], ast.Load())
            yield ast.Call(function, node.args, node.keywords)
    else:
        yield from _other_statements(node)


def _other_constants(value: object) -> Iterator[ast.AST]:
    if isinstance(value, bool):
        yield ast.Constant(not value)
    elif isinstance(value, int):
        yield ast.Constant(value + 1)
    elif isinstance(value, float):
        yield ast.Constant(value * 1.5 + 0.5)


def _other_statements(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.If | ast.IfExp):
        for value in (True, False):
            yield type(node)(ast.Constant(value), node.body, node.orelse)  # type: ignore[arg-type]
    elif isinstance(node, ast.Return):
        if node.value is not None and not _is_none(node.value):
            yield ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Break | ast.Continue | ast.AugAssign | ast.Raise):
        yield ast.Pass()
    elif isinstance(node, ast.Delete):
        if not all(isinstance(target, ast.Name) for target in node.targets):
            yield ast.Pass()  # deleting a name only says that it is not used
    elif isinstance(node, ast.Assign):
        if any(isinstance(target, ast.Attribute) for target in node.targets):
            yield ast.Pass()
    elif isinstance(node, ast.Expr) and not isinstance(node.value, ast.Constant):
        yield ast.Pass()


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _words(node: ast.AST) -> str:
    """A node in one short line."""
    if isinstance(node, ast.If):
        return f"if {ast.unparse(node.test)}"
    return " ".join(ast.unparse(node).split())[:120]
